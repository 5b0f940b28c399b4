"""Loading a vision-language model: weights, tokenizer and image processor, for inference and for training."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import torch
from transformers import AutoImageProcessor, AutoModelForImageTextToText, AutoTokenizer
from transformers.utils.logging import disable_progress_bar

from webgym.core.errors import ConfigError
from webgym.inference.rendering import Renderer

disable_progress_bar()  # weights are loaded and saved in the middle of somebody else's output

Dtype: TypeAlias = Literal["float32", "bfloat16"]


@dataclass(frozen=True, slots=True)
class Loaded:
    """A model with all that its requests and replies pass through.

    Attributes:
        model: a transformers image-text-to-text model, in evaluation mode.
        renderer: makes its requests.
    """

    model: Any
    renderer: Renderer

    @property
    def tokenizer(self) -> Any:
        """The tokenizer, with its chat template."""
        return self.renderer.tokenizer

    @property
    def image_processor(self) -> Any:
        """The image processor."""
        return self.renderer.image_processor


def load_model(path: str | Path, *, dtype: Dtype = "float32", device: str = "cpu") -> Loaded:
    """A model from a folder or from the Hugging Face hub; adapters are merged into the weights they are for.

    Args:
        path: a folder with ``config.json`` and ``*.safetensors``, one with ``adapter_config.json``, or the id
            of a model on the hub.
        dtype: of the weights in memory.
        device: as torch names it.

    Raises:
        ConfigError: there is no such model, or it is not whole.
    """
    renderer = load_renderer(path)
    with _one_line(path):
        model = _weights(path, getattr(torch, dtype))
    ends = model.generation_config.eos_token_id if model.generation_config is not None else None
    if ends is not None:
        renderer.end_ids |= {ends} if isinstance(ends, int) else frozenset(ends)
    return Loaded(multiply_patches(model).to(device).eval(), renderer)


class _Patches(torch.nn.Conv3d):
    """A convolution that is given patch by patch, computed as the matrix product that it then is."""

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        if input.shape[2:] != self.weight.shape[2:]:
            return super().forward(input)
        product = torch.nn.functional.linear(input.flatten(1), self.weight.flatten(1), self.bias)
        return product[..., None, None, None]


def multiply_patches(model: Any) -> Any:
    """Have a vision tower embed its patches by a matrix product; the weights and their names stay.

    Qwen-VL cuts the picture up first and convolves every patch by itself: the same numbers, but torch's
    convolution over many tiny volumes is several times slower, backward above all (a fifth of a tiny
    model's update).
    """
    for module in model.modules():
        if type(module) is torch.nn.Conv3d and module.kernel_size == module.stride and module.groups == 1:
            module.__class__ = _Patches
    return model


def load_renderer(path: str | Path) -> Renderer:
    """Tokenizer and image processor alone.

    The image processor is always the one that works with PIL: torchvision's gives other pixels, and whether
    it is installed must not change what a model sees.

    Raises:
        ConfigError: there is no such model, or it is not whole.
    """
    with _one_line(path):
        tokenizer = AutoTokenizer.from_pretrained(str(path))
        image_processor = AutoImageProcessor.from_pretrained(str(path), backend="pil")
    if not tokenizer.chat_template:
        raise ConfigError(f"the model {path} has no chat template", hint="give an instruct model")
    return Renderer(tokenizer, image_processor)


def _weights(path: str | Path, dtype: torch.dtype) -> Any:
    if not (Path(path) / "adapter_config.json").is_file():
        return AutoModelForImageTextToText.from_pretrained(str(path), dtype=dtype)
    import peft  # only where there are adapters

    base = peft.PeftConfig.from_pretrained(str(path)).base_model_name_or_path
    model = AutoModelForImageTextToText.from_pretrained(base, dtype=dtype)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of transformers, about what peft calls
        return peft.PeftModel.from_pretrained(model, str(path)).merge_and_unload()


@contextmanager
def _one_line(path: str | Path) -> Iterator[None]:
    """Whatever the libraries raise over a model that is missing or broken, as one line."""
    try:
        yield
    except (OSError, ValueError, KeyError, RuntimeError, ImportError) as error:
        reason = str(error).strip().split("\n", 1)[0][:200]
        raise ConfigError(
            f"cannot load the model {path}: {reason}",
            hint="give a folder with config.json, weights, tokenizer and image processor, or a hub id",
        ) from error
