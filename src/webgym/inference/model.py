"""Loading a vision-language model: weights, tokenizer and image processor, for inference and for training.

transformers is imported by what loads: its models take twice torch's time, and a training is checked and set
up without them.
"""

from __future__ import annotations

import contextlib
import ctypes
import urllib.request
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

import torch
from huggingface_hub import constants, snapshot_download
from huggingface_hub.errors import HFValidationError, LocalEntryNotFoundError
from torch.nn.attention import SDPBackend, sdpa_kernel

from webgym.core.errors import ConfigError
from webgym.inference.rendering import Renderer
from webgym.llm.client import certificates

Dtype: TypeAlias = Literal["float32", "bfloat16"]

_TRIM_THRESHOLD, _MMAP_MAX = -1, -4  # parameters of mallopt(3)

HUB_SECONDS: Final = 5.0
"""Deadline of the check whether the hub can be reached."""


@dataclass(frozen=True, slots=True)
class Loaded:
    """A model with its renderer.

    Attributes:
        model: a transformers image-text-to-text model, in evaluation mode.
        renderer: renders its requests.
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
    """Load a model from a folder or from the Hugging Face hub; adapters are merged into their base weights.

    Args:
        path: a folder with ``config.json`` and ``*.safetensors``, one with ``adapter_config.json``, or the id
            of a model on the hub.
        dtype: data type of the weights in memory.
        device: device, as torch names it.

    Raises:
        ConfigError: there is no such model, it is incomplete, or there is no such device.
    """
    from webgym.inference.vision import speed_up_vision

    try:
        torch.empty(0, device=device)
    except (AssertionError, RuntimeError) as error:  # the first from a torch that was built without it
        reason = str(error).strip().split("\n", 1)[0][:200]
        raise ConfigError(
            f"torch cannot use the device {device!r} here: {reason}",
            hint="cpu always works; webgym doctor says which GPU there is",
        ) from error
    if torch.device(device).type == "cpu":
        keep_freed_memory()
    renderer = load_renderer(path)
    with loading(path) as source:
        model = _weights(source, getattr(torch, dtype))
    ends = model.generation_config.eos_token_id if model.generation_config is not None else None
    if ends is not None:
        renderer.end_ids |= {ends} if isinstance(ends, int) else frozenset(ends)
    return Loaded(speed_up_vision(model).to(device).eval(), renderer)


def keep_freed_memory() -> None:
    """Make glibc keep freed memory for later allocations; does nothing on other systems.

    On the CPU, every operation allocates its result. By default glibc requests large blocks from the system
    and
    returns them at once, so that each result causes page faults: a third of a small model's time.
    """
    with contextlib.suppress(AttributeError, OSError):
        libc = ctypes.CDLL(None)
        libc.mallopt(_MMAP_MAX, 0)
        libc.mallopt(_TRIM_THRESHOLD, 2**31 - 1)


def fast_backward_attention(device: torch.device | str) -> AbstractContextManager[None]:
    """Context for a forward pass in training, and for its backward pass if that recomputes activations: on
    the CPU, selects the attention with the faster backward pass.

    torch's flash attention on the CPU is fast forward, but its backward pass took a third of a tiny model's
    update.
    """
    if torch.device(device).type == "cpu":
        return sdpa_kernel(SDPBackend.MATH)
    return nullcontext()


def load_renderer(path: str | Path) -> Renderer:
    """Load only tokenizer and image processor.

    The image processor is always the PIL-based one: torchvision's gives other pixel values, and whether it is
    installed must not change a model's input.

    Raises:
        ConfigError: there is no such model, or it is incomplete.
    """
    from transformers import AutoImageProcessor, AutoTokenizer

    with loading(path) as source:
        tokenizer = AutoTokenizer.from_pretrained(source)
        image_processor = AutoImageProcessor.from_pretrained(source, backend="pil")
    if not tokenizer.chat_template:
        raise ConfigError(f"the model {path} has no chat template", hint="use an instruct model")
    return Renderer(tokenizer, image_processor)


def _weights(path: str, dtype: torch.dtype) -> Any:
    from transformers import AutoModelForImageTextToText

    if not (Path(path) / "adapter_config.json").is_file():
        return AutoModelForImageTextToText.from_pretrained(path, dtype=dtype)
    import peft  # only where there are adapters

    with loading(peft.PeftConfig.from_pretrained(path).base_model_name_or_path) as base:
        model = AutoModelForImageTextToText.from_pretrained(base, dtype=dtype)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # by transformers, about calls of peft
        return peft.PeftModel.from_pretrained(model, path).merge_and_unload()


@contextmanager
def loading(path: str | Path) -> Iterator[str]:
    """Context for loading a model with transformers. Yields the folder or id to load from.

    A short request checks once whether the hub can be reached. If not, the downloaded files are used: the
    libraries would retry for every file, and took 47 s to report that a model does not exist.

    Raises:
        ConfigError: there is no such model, or it is incomplete; with the libraries' error in one line.
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
            reason = f"it is not a folder, was never downloaded, and {constants.ENDPOINT} cannot be reached"
        elif not Path(path).exists() and (Path(path).is_absolute() or isinstance(error, HFValidationError)):
            reason = "there is no such folder"
        raise ConfigError(
            f"cannot load the model {path}: {reason}",
            hint="give a folder with config.json, weights, tokenizer and image processor, or a hub id",
        ) from error


def _hub_answers(model: str) -> bool:
    """Whether the hub answers a request for a model, even if the model does not exist."""
    if constants.HF_HUB_OFFLINE:
        return False
    # Its address is huggingface_hub's own setting.
    request = urllib.request.Request(f"{constants.ENDPOINT}/api/models/{model}", method="HEAD")  # noqa: S310
    try:
        urllib.request.urlopen(request, timeout=HUB_SECONDS, context=certificates()).close()  # noqa: S310
    except urllib.request.HTTPError as error:
        return error.code < 500
    except (OSError, ValueError):
        return False
    return True
