"""Loading a vision-language model: weights, tokenizer and image processor, for inference and for training."""

from __future__ import annotations

import contextlib
import ctypes
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

import httpx
import torch
from huggingface_hub import constants, snapshot_download
from huggingface_hub.errors import LocalEntryNotFoundError
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.nn.functional import scaled_dot_product_attention
from transformers import AutoImageProcessor, AutoModelForImageTextToText, AutoTokenizer
from transformers.models.qwen3_vl.modeling_qwen3_vl import (
    Qwen3VLVisionAttention,
    apply_rotary_pos_emb_vision,
)
from transformers.utils.logging import disable_progress_bar

from webgym.core.errors import ConfigError
from webgym.inference.rendering import Renderer

disable_progress_bar()  # weights are loaded and saved in the middle of somebody else's output

Dtype: TypeAlias = Literal["float32", "bfloat16"]

_TRIM_THRESHOLD, _MMAP_MAX = -1, -4  # parameters of mallopt(3)

HUB_SECONDS: Final = 5.0
"""How long the hub may take to say whether it has a model."""


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
    if torch.device(device).type == "cpu":
        keep_freed_memory()
    renderer = load_renderer(path)
    with loading(path) as where:
        model = _weights(where, getattr(torch, dtype))
    ends = model.generation_config.eos_token_id if model.generation_config is not None else None
    if ends is not None:
        renderer.end_ids |= {ends} if isinstance(ends, int) else frozenset(ends)
    return Loaded(quicken_vision(model).to(device).eval(), renderer)


def keep_freed_memory() -> None:
    """Have glibc keep what is freed for what is allocated next; elsewhere nothing happens.

    On a processor every operation allocates its result. By default glibc takes a large block from the system
    and gives it back at once, so that each result is paged in anew: a third of a small model's time.
    """
    with contextlib.suppress(AttributeError, OSError):
        libc = ctypes.CDLL(None)
        libc.mallopt(_MMAP_MAX, 0)
        libc.mallopt(_TRIM_THRESHOLD, 2**31 - 1)


class _Patches(torch.nn.Conv3d):
    """A convolution that is given patch by patch, computed as the matrix product that it then is."""

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        if input.shape[2:] != self.weight.shape[2:]:
            return super().forward(input)
        product = torch.nn.functional.linear(input.flatten(1), self.weight.flatten(1), self.bias)
        return product[..., None, None, None]


class _Together(Qwen3VLVisionAttention):
    """Attention within each picture; pictures of one size are one batch instead of one call each."""

    def forward(self, hidden_states: Any, cu_seqlens: Any, position_embeddings: Any, **others: Any) -> Any:
        lengths = cu_seqlens.diff()
        if (lengths != lengths[0]).any() or "flash" in self.config._attn_implementation:
            return super().forward(hidden_states, cu_seqlens, position_embeddings, **others)
        parts = self.qkv(hidden_states).unflatten(-1, (3, self.num_heads, -1))
        query, key, value = parts.unbind(1)
        query, key = apply_rotary_pos_emb_vision(query, key, *position_embeddings)
        pictures = (part.unflatten(0, (len(lengths), -1)).transpose(1, 2) for part in (query, key, value))
        seen = scaled_dot_product_attention(*pictures)
        return self.proj(seen.transpose(1, 2).flatten(0, 1).flatten(1))


def quicken_vision(model: Any) -> Any:
    """Have a vision tower compute the same numbers faster; the weights and their names stay.

    Patches are embedded by a matrix product: Qwen-VL cuts the picture up first and convolves every patch by
    itself, and torch's convolution over many tiny volumes is several times slower, backward above all. And
    Qwen3-VL's attention is called once for all pictures where they are of one size.
    """
    for module in model.modules():
        if type(module) is torch.nn.Conv3d and module.kernel_size == module.stride and module.groups == 1:
            module.__class__ = _Patches
        if type(module) is Qwen3VLVisionAttention:
            module.__class__ = _Together
    return model


def quick_attention(device: torch.device | str) -> AbstractContextManager[None]:
    """Around a forward pass that is trained on: on a processor, the attention whose gradient is quick.

    torch's flash attention for processors is quick forward, but its backward pass took a third of a tiny
    model's update.
    """
    if torch.device(device).type == "cpu":
        return sdpa_kernel(SDPBackend.MATH)
    return nullcontext()


def load_renderer(path: str | Path) -> Renderer:
    """Tokenizer and image processor alone.

    The image processor is always the one that works with PIL: torchvision's gives other pixels, and whether
    it is installed must not change what a model sees.

    Raises:
        ConfigError: there is no such model, or it is not whole.
    """
    with loading(path) as where:
        tokenizer = AutoTokenizer.from_pretrained(where)
        image_processor = AutoImageProcessor.from_pretrained(where, backend="pil")
    if not tokenizer.chat_template:
        raise ConfigError(f"the model {path} has no chat template", hint="give an instruct model")
    return Renderer(tokenizer, image_processor)


def _weights(path: str, dtype: torch.dtype) -> Any:
    if not (Path(path) / "adapter_config.json").is_file():
        return AutoModelForImageTextToText.from_pretrained(path, dtype=dtype)
    import peft  # only where there are adapters

    with loading(peft.PeftConfig.from_pretrained(path).base_model_name_or_path) as base:
        model = AutoModelForImageTextToText.from_pretrained(base, dtype=dtype)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of transformers, about what peft calls
        return peft.PeftModel.from_pretrained(model, path).merge_and_unload()


@contextmanager
def loading(path: str | Path) -> Iterator[str]:
    """Loading a model with transformers; gives where from.

    The hub is asked once, briefly, whether it is there. If it is not, what was downloaded before is loaded:
    the libraries would try again for every file, which took 47 s to say that there is no such model.

    Raises:
        ConfigError: there is no such model, or it is not whole: whatever the libraries raise, as one line.
    """
    is_hub_id = not Path(path).exists() and not Path(path).is_absolute()
    try:
        if is_hub_id and not _hub_answers(str(path)):
            yield snapshot_download(str(path), local_files_only=True)
        else:
            yield str(path)
    except (OSError, ValueError, KeyError, RuntimeError, ImportError) as error:
        reason = str(error).strip().split("\n", 1)[0][:200]
        if isinstance(error, LocalEntryNotFoundError):
            reason = f"it is no folder, was never downloaded, and {constants.ENDPOINT} is not reached"
        elif Path(path).is_absolute() and not Path(path).exists():  # the hub's rules for ids are no help
            reason = "there is no such folder"
        raise ConfigError(
            f"cannot load the model {path}: {reason}",
            hint="give a folder with config.json, weights, tokenizer and image processor, or a hub id",
        ) from error


def _hub_answers(model: str) -> bool:
    """Whether the hub says anything about a model, be it that there is none."""
    if constants.HF_HUB_OFFLINE:
        return False
    try:
        answer = httpx.head(f"{constants.ENDPOINT}/api/models/{model}", timeout=HUB_SECONDS)
    except (httpx.TransportError, httpx.InvalidURL):
        return False
    return not answer.is_server_error
