"""What an update allocates, in processes that share it."""

from __future__ import annotations

import gc
import json
import weakref
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from tests.inference.tiny import picture
from tests.train.updating import join, launched
from torch.distributed.tensor import DTensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from webgym.core.trajectory import ImageRef, Message
from webgym.inference.model import Loaded
from webgym.inference.rendering import Renderer
from webgym.train import logprobs, update
from webgym.train.config import UpdateConfig
from webgym.train.estimate import Workload
from webgym.train.logprobs import Batch, collate
from webgym.train.objectives import FilteredBC
from webgym.train.samples import Sample

IMAGE, SIZE = 5, (128, 64)
WORK = Workload(pictures=2, picture_patches=32, text_tokens=204, reply_tokens=40)
SHAPES: dict[str, Any] = {
    "text_config": {
        "vocab_size": 2048,
        "hidden_size": 128,
        "intermediate_size": 384,
        "num_hidden_layers": 4,
        "num_attention_heads": 4,
        "num_key_value_heads": 2,
        "head_dim": 32,
        "rope_scaling": {"rope_type": "default", "mrope_section": [4, 6, 6], "mrope_interleaved": True},
    },
    "vision_config": {
        "depth": 3,
        "hidden_size": 96,
        "intermediate_size": 192,
        "num_heads": 4,
        "patch_size": 16,
        "out_hidden_size": 128,
        "num_position_embeddings": 256,
        "deepstack_visual_indexes": [1],
    },
    "tie_word_embeddings": False,
    "image_token_id": IMAGE,
    "video_token_id": 6,
    "vision_start_token_id": 7,
    "vision_end_token_id": 8,
}
RECOMPUTED: dict[str, Any] = {
    "batch": 8,
    "micro_batch": 2,
    "logit_tokens": 64,
    "gradient_checkpointing": True,
}
KEPT = RECOMPUTED | {"gradient_checkpointing": False}


def shapes(vocabulary: int, *, tied: bool) -> Any:
    """The configuration of a small Qwen3-VL."""
    from transformers import Qwen3VLConfig

    text = SHAPES["text_config"] | {"vocab_size": vocabulary, "tie_word_embeddings": tied}
    return Qwen3VLConfig(**(SHAPES | {"text_config": text, "tie_word_embeddings": tied}))


def samples(count: int) -> list[Sample]:
    """Of the workload, each a bit shorter than the one before, so that batches are padded."""
    pictures = {"red": picture("red", SIZE), "blue": picture("blue", SIZE)}
    message = Message("user", tuple(ImageRef(name, *SIZE) for name in pictures))
    image = [7, *[IMAGE] * (WORK.picture_patches // 4), 8]
    found = []
    for number in range(count):
        text = torch.randint(10, 1000, (WORK.text_tokens - 2 * WORK.pictures - number,)).int()
        prompt = torch.cat([torch.tensor(image * WORK.pictures, dtype=torch.int32), text])
        reply = torch.randint(10, 1000, (WORK.reply_tokens,)).int()
        found.append(Sample(prompt, reply, None, 1.0, "", (message,), pictures.__getitem__))
    return found


class Allocated(TorchDispatchMode):
    """Context that measures the most bytes of the storages that operations allocate in it.

    Attributes:
        most: bytes at one time.
    """

    def __init__(self) -> None:
        super().__init__()
        self.most = 0
        self._storages: dict[int, weakref.ref[torch.UntypedStorage]] = {}

    def __torch_dispatch__(self, operation: Any, types: Any, given: Any = (), named: Any = None) -> Any:
        before = {each.untyped_storage()._cdata for each in tensors_in((given, named))}
        result = operation(*given, **(named or {}))
        for each in tensors_in(result):
            storage = each.untyped_storage()
            if storage._cdata not in before:
                self._storages[storage._cdata] = weakref.ref(storage)
        # FSDP2 frees by resizing, which is no operation: each storage is asked for its size.
        alive = {key: storage for key, ref in self._storages.items() if (storage := ref()) is not None}
        self._storages = {key: self._storages[key] for key in alive}
        self.most = max(self.most, sum(each.nbytes() for each in alive.values()))
        return result


def tensors_in(values: Any) -> list[torch.Tensor]:
    """The plain tensors in any nesting, or this process's parts of them."""
    leaves = (each for each in tree_leaves(values) if isinstance(each, torch.Tensor))
    return [each.to_local() if isinstance(each, DTensor) else each for each in leaves]


def measure(rank: int, port: int, processes: int, out: Path, cases: Sequence[Any]) -> None:
    """Write what the first of some processes of FSDP2 holds, and the most that it allocates beside, bytes."""
    from transformers import AutoModelForImageTextToText
    from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

    join(rank, port, processes, **launched("fsdp2"))
    # Attention as on GPUs, and no batches that other threads make.
    for module in (logprobs, update):
        module.fast_backward_attention = lambda _device: nullcontext()  # type: ignore[attr-defined]

    def one_by_one(groups: Any, renderer: Renderer, *, off_policy: bool) -> Iterator[Batch]:
        return (collate(group, renderer, off_policy=off_policy) for group in groups)

    update.batches_ahead = one_by_one  # type: ignore[attr-defined]
    tokenizer = SimpleNamespace(eos_token_id=0, pad_token_id=1, convert_tokens_to_ids=lambda _: IMAGE)
    processor = Qwen2VLImageProcessorPil(patch_size=16, size={"shortest_edge": 1024, "longest_edge": 2**24})
    found = []
    for settings, kind in cases:
        torch.manual_seed(0)
        model = AutoModelForImageTextToText.from_config(shapes(**kind), dtype=torch.float32)
        made = update.Updater(
            UpdateConfig.model_validate(settings),
            FilteredBC(),
            Loaded(model, Renderer(tokenizer, processor)),
        )
        made._greedy_reply = SimpleNamespace()  # type: ignore[assignment]  # no self-test before
        given = samples(8)
        made.update(given)  # FSDP2 prepares itself in the first one
        held = [each.to_local() for each in model.parameters()]
        moments = [
            moment.to_local() for each in made.optimizer.state.values() for moment in list(each.values())[1:]
        ]
        gc.collect()
        with Allocated() as allocated:
            made.update(given)
        sizes = [sum(each.untyped_storage().nbytes() for each in some) for some in (held, moments)]
        found.append({"weights": sizes[0], "optimizer": sizes[1], "rest": allocated.most})
    if rank == 0:
        out.write_text(json.dumps(found))
