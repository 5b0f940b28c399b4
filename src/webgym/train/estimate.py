"""Estimates the memory, tokens and time of an update before training starts.

All figures are for one update (an iteration's training) and the busiest GPU. With N weights in total, T of
them trained, G GPUs, b bytes a weight, c bytes a number in the computation, and t tokens in a micro-batch of
the longest samples of s tokens:

    weights      N b / S                S = G if sharded (FSDP2), else 1
    gradients    T b / S                twice with DDP, whose buckets are copies
    optimizer    2 T b / S              AdamW's two moments
    gathered     c (R + 2 P)            sharded: P weights in the largest layer, R beside layers and tables;
                 c T                    else autocast's copies of float32 weights
    activations  a L + ends             a layer's t (2 (4 + 2c) h + (4 + 5c) q + (4 + c) k + 4c i + c s), the
                                        vision tower's p (10 c h + 2 c i) with p patches; ends are pixels,
                                        merged pictures and the last norm
                 t h c L + ends         with gradient checkpointing
    working      the largest of         what comes and goes in the backward pass:
                 n V (12 + c) + 2 c E   logits of n reply tokens at once, the head's weights and gradient
                 a + 2 t c i + 4 max(P, E)   a layer that is recomputed, gradients of its MLP, and in float32
                                        those of the weights before it, which are being split
                 (4 + c) E              the gradient of the input's table, once all activations are gone
    local model  N b                    if one replies in this process, with its own b

    (L layers of width h; q and k the widths of queries and of keys; i of the MLP; a table of V words has E
    weights)

    compute      (2 + 2 + 2 T / N) N per token for forward, backward to activations, backward to weights; one
                 more forward with gradient checkpointing, and one for an off-policy objective;
                 attention 4 q s / 2 per token, layer and pass, for sequences of s tokens
    time         compute / (G x peak x utilisation)
    a reply      of a local model: a forward pass over the request, and for each reply token as many calls of
                 kernels as its L layers need (:data:`LAYER_SECONDS`), for as many replies as are made at once

    disk         weights and moments of training, N b + 2 T b, twice while they are replaced; and weights for
                 servers, N c, of the iterations that stay, the best one and the one that is written
    host memory  the model while it is read (N b, sharded in one process of a machine, else in each), and the
                 batches that each process has made ahead
    saving       what one update writes, at :data:`DISK_BYTES` a second

Embeddings are looked up, not multiplied, so they count for memory but not for compute; the head counts for
reply tokens only. tests/train/test_estimate.py holds the memory to what two processes of FSDP2 allocate.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import torch

from webgym.core.errors import ConfigError
from webgym.inference.local import LocalConfig
from webgym.inference.model import loading
from webgym.train.config import LearnConfig, UpdateConfig
from webgym.train.logprobs import AHEAD
from webgym.train.objectives import make_objective

GIB: Final = 2**30

QWEN3_VL_8B: Final[dict[str, Any]] = {
    "text_config": {
        "vocab_size": 151936,
        "hidden_size": 4096,
        "intermediate_size": 12288,
        "num_hidden_layers": 36,
        "num_attention_heads": 32,
        "num_key_value_heads": 8,
        "head_dim": 128,
    },
    "vision_config": {
        "depth": 27,
        "hidden_size": 1152,
        "intermediate_size": 4304,
        "num_heads": 16,
        "patch_size": 16,
        "out_hidden_size": 4096,
        "deepstack_visual_indexes": [8, 16, 24],
    },
    "tie_word_embeddings": False,
}
"""Configuration of the paper's model, so that its estimate needs no download."""


DISK_BYTES: Final = 1e9
"""Assumed bytes a second that all processes together write."""

UTILISATION: Final = 0.4
"""Assumed share of a GPU's peak that training reaches."""

LAYER_SECONDS: Final = 1e-3
"""Assumed seconds that transformers takes for a layer and a token of a reply, for all replies of a batch."""


_STEPS = 1800
"""Assumed, where all usable steps are drawn: the paper's."""
_TRAJECTORY_STEPS = 9
"""Assumed, where whole trajectories are drawn: AsyncWebRL's failures have 12.5, its successes 5.1."""


@dataclass(frozen=True, slots=True)
class Gpus:
    """The GPUs to train on.

    Attributes:
        count: number of GPUs.
        memory_gib: memory of each GPU.
        peak_tflops: peak of each GPU, bf16 without sparsity.
        sharded: whether weights, gradients and optimizer state are sharded over the GPUs, by FSDP2.
    """

    count: int = 1
    memory_gib: float = 80.0
    peak_tflops: float = 989.0
    sharded: bool = True


KNOWN_GPUS: Final = {
    "a100": Gpus(memory_gib=80, peak_tflops=312),
    "h100": Gpus(memory_gib=80, peak_tflops=989),
    "h200": Gpus(memory_gib=141, peak_tflops=989),
    "b200": Gpus(memory_gib=180, peak_tflops=2250),
}
"""Peaks from NVIDIA's data sheets, for dense bf16."""


def present_gpus() -> Gpus | None:
    """The GPUs that this process was launched to train on.

    ``None`` if there is none, and under DeepSpeed, where autocast keeps copies of gathered weights.
    """
    if not torch.cuda.is_available() or os.environ.get("ACCELERATE_USE_DEEPSPEED") == "true":
        return None
    return Gpus(
        count=int(os.environ.get("WORLD_SIZE") or 1),
        memory_gib=torch.cuda.get_device_properties(0).total_memory / GIB,
        sharded=os.environ.get("ACCELERATE_USE_FSDP") == "true",
    )


def peak_flops() -> float | None:
    """Peak operations per second of all GPUs of the launch; ``None`` without GPUs, or of an unknown kind."""
    if not torch.cuda.is_available():
        return None
    name = torch.cuda.get_device_name().lower()
    peaks = (gpu.peak_tflops for kind, gpu in KNOWN_GPUS.items() if kind in name)
    each = next(peaks, None)
    return None if each is None else each * 1e12 * int(os.environ.get("WORLD_SIZE") or 1)


@dataclass(frozen=True, slots=True)
class Workload:
    """Size of a trajectory's step as model input.

    Attributes:
        pictures: in a request: those of the history and the current one.
        picture_patches: of the vision tower per picture: 1280 x 768 pixels in squares of 16.
        text_tokens: in a request besides pictures.
        reply_tokens: in a reply.
    """

    pictures: int = 4
    picture_patches: int = 3840
    text_tokens: int = 2500
    reply_tokens: int = 300


@dataclass(frozen=True, slots=True)
class Part:
    """A tower of a model, with layers of equal shape; widths are numbers of features.

    Attributes:
        layers: their number.
        width, queries, keys, inner: of a layer.
        is_text: whether it is the language model, not the vision tower.
        parameters: of all layers, and of what belongs to the tower beside them.
        layer_parameters: of one layer.
    """

    layers: int
    width: int
    queries: int
    keys: int
    inner: int
    is_text: bool
    parameters: int
    layer_parameters: int

    def layer_bytes(self, tokens: int, sequence: int, number: int) -> float:
        """Bytes of a layer's activations for the backward pass, with this many bytes a number."""
        if not self.is_text:
            return float(tokens * number * (10 * self.width + 2 * self.inner))
        norms = 2 * (4 + 2 * number) * self.width + (4 + number) * (self.queries + self.keys)
        return float(tokens * (norms + number * (4 * self.queries + 4 * self.inner + sequence)))

    def activation_bytes(self, tokens: int, sequence: int, number: int, *, checkpointing: bool) -> float:
        """Bytes of activations that are kept for the backward pass."""
        if checkpointing:
            return float(tokens * self.width * number * self.layers)
        return self.layer_bytes(tokens, sequence, number) * self.layers

    def forward_flops(self, tokens: int, sequence: int, *, causal: bool) -> float:
        """Operations of a forward pass over ``tokens`` tokens, which attend to ``sequence`` tokens."""
        attention = 4.0 * self.layers * self.queries * sequence * (0.5 if causal else 1.0)
        return tokens * (2.0 * self.parameters + attention)


@dataclass(frozen=True, slots=True)
class Shapes:
    """The sizes of a model's parts. ``embeddings`` counts input and output embeddings.

    ``mergers`` is the number of places at which pictures enter the language model, ``patch`` the number of
    values in a patch of a picture.
    """

    text: Part
    vision: Part
    embeddings: int
    vocabulary: int
    merge: int
    mergers: int
    patch: int
    is_tied: bool

    @property
    def parameters(self) -> int:
        """Number of all weights."""
        return self.text.parameters + self.vision.parameters + self.embeddings


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimated cost of an update.

    Attributes:
        parameters, trained: number of weights, and of trained ones.
        memory: bytes on the busiest GPU, by purpose.
        host: bytes of the machines' memory.
        written: bytes that are saved after an update.
        disk: most bytes of weights and optimizer on disk.
        fits: whether their sum is below 90 % of a GPU's memory.
        tokens: input tokens of an update, over all passes.
        reply_tokens: those among them with a loss.
        optimizer_steps: in an update.
        flops: floating point operations of an update.
        seconds: of an update, at the assumed utilisation.
        reply_seconds: for a reply of the model in the first process, at least; 0 if there is none on a GPU.
    """

    parameters: int
    trained: int
    memory: dict[str, float]
    host: float
    written: float
    disk: float
    fits: bool
    tokens: int
    reply_tokens: int
    optimizer_steps: int
    flops: float
    seconds: float
    reply_seconds: float

    def lines(self) -> list[str]:
        """The estimate as lines of text."""
        total = sum(self.memory.values()) / GIB
        share = ", ".join(f"{name} {value / GIB:.1f}" for name, value in self.memory.items())
        verdict = "fits" if self.fits else "DOES NOT FIT"
        return [
            f"model      {self.parameters / 1e9:.2f} B weights, {self.trained / 1e9:.3f} B trained",
            f"memory     {total:.1f} GiB per GPU, {verdict}: {share}",
            f"host       {self.host / GIB:.0f} GiB of memory, beside browsers and what replies",
            f"disk       {self.disk / GIB:.0f} GiB at most; an update writes {self.written / GIB:.0f} GiB "
            f"({self.written / DISK_BYTES / 60:.1f} min at {DISK_BYTES / 1e9:g} GB/s)",
            f"tokens     {self.tokens / 1e6:.1f} M per iteration, loss on {self.reply_tokens / 1e6:.2f} M",
            f"steps      {self.optimizer_steps} of the optimizer per iteration",
            f"compute    {self.flops / 1e15:.0f} PFLOP per iteration",
            f"time       {self.seconds / 60:.1f} min per iteration",
        ]


@cache
def shapes_of(model: str | Path) -> Shapes:
    """A model's shapes, by folder or hub id, without its weights. ``Qwen3-VL-8B-...`` needs no network.

    Raises:
        ConfigError: there is no such model, or it is not a Qwen3-VL model.
    """
    from transformers import AutoConfig, Qwen3VLConfig

    if "qwen3-vl-8b" in str(model).lower() and not Path(model).exists():
        config: Any = Qwen3VLConfig(**QWEN3_VL_8B)
    else:
        with loading(model) as where:
            config = AutoConfig.from_pretrained(where)
    if not hasattr(config, "vision_config") or not hasattr(config.vision_config, "depth"):
        raise ConfigError(f"{model} is not a Qwen3-VL model: its memory cannot be estimated")
    return shapes_from(config)


def shapes_from(config: Any) -> Shapes:
    """The shapes of a Qwen3-VL model, by its transformers configuration."""
    from transformers import AutoModelForImageTextToText

    with torch.device("meta"):
        empty: Any = AutoModelForImageTextToText.from_config(config)
    text, vision = config.text_config, config.vision_config
    tables = {id(module.weight): module.weight for module in (empty.get_input_embeddings(), empty.lm_head)}
    embeddings = sum(weight.numel() for weight in tables.values())
    vision_parameters = sum(weight.numel() for weight in empty.model.visual.parameters())
    all_parameters = sum(weight.numel() for weight in empty.parameters())
    query_width, key_width = (
        text.num_attention_heads * text.head_dim,
        text.num_key_value_heads * text.head_dim,
    )
    blocks = empty.model.language_model.layers, empty.model.visual.blocks
    text_layer, vision_layer = (sum(each.numel() for each in block[0].parameters()) for block in blocks)
    return Shapes(
        text=Part(
            text.num_hidden_layers,
            text.hidden_size,
            query_width,
            key_width,
            text.intermediate_size,
            True,
            all_parameters - vision_parameters - embeddings,
            text_layer,
        ),
        vision=Part(
            vision.depth,
            vision.hidden_size,
            vision.hidden_size,
            vision.hidden_size,
            vision.intermediate_size,
            False,
            vision_parameters,
            vision_layer,
        ),
        embeddings=embeddings,
        vocabulary=text.vocab_size,
        merge=vision.spatial_merge_size**2,
        mergers=1 + len(vision.deepstack_visual_indexes),
        patch=vision.in_channels * vision.temporal_patch_size * vision.patch_size**2,
        is_tied=len(tables) == 1,
    )


def model_flops(size: Shapes, update: UpdateConfig, tokens: int, reply_tokens: int, patches: int) -> float:
    """Operations of the forward and backward passes of an update, without what is computed again, scored
    beforehand, or spent on attention: as the share of a GPU's peak is commonly counted.

    Args:
        size: of the model.
        update: what is trained.
        tokens: of all samples and passes, replies included.
        reply_tokens: of those.
        patches: of pictures.
    """
    text = 3 if update.lora is None else 2  # frozen weights need no gradients, but pass them on
    vision = 1 if update.freeze_vision or update.lora is not None else 3
    language = tokens * size.text.parameters + reply_tokens * size.embeddings / 2
    return 2.0 * (text * language + vision * patches * size.vision.parameters)


def estimate(
    config: LearnConfig,
    gpus: Gpus,
    workload: Workload | None = None,
    shapes: Shapes | None = None,
    *,
    local: LocalConfig | None = None,
    keep: int = 2,
) -> Estimate:
    """Estimate an update with these settings on these GPUs; see the module for the formulas.

    Args:
        config: of learning.
        gpus: to compute with.
        workload: size of steps; by default the paper's at 1280 x 768.
        shapes: of the model; by default read from its folder or the hub.
        local: the model that replies in this process, if there is one.
        keep: iterations whose weights stay on disk.

    Raises:
        ConfigError: the model is not supported, or there is no such objective.
    """
    work, size = workload or Workload(), shapes or shapes_of(config.model)
    update, replay = config.update, config.replay
    patches = all_patches = work.pictures * work.picture_patches
    tokens = work.text_tokens + patches // size.merge + work.reply_tokens
    longest = max(tokens, min(update.cutoff_tokens, 2 * tokens))
    frozen_vision = update.freeze_vision or update.lora is not None
    trained = size.parameters - (size.vision.parameters if update.freeze_vision else 0)
    if update.lora is not None:
        text = size.text
        widths = 4 * text.width + 2 * (text.queries + text.keys) + 3 * (text.width + text.inner)
        trained = update.lora.rank * text.layers * widths
    patches = patches * longest // tokens  # of the longest samples
    memory = _memory(update, size, gpus, trained, (longest, patches), vision=not frozen_vision)
    is_adapted, width = update.lora is not None, 4 if update.weights == "float32" else 2
    training = trained * 12.0 if is_adapted else (size.parameters + 2 * trained) * float(width)
    served = trained * 4.0 if is_adapted else size.parameters * (2.0 if update.precision == "bf16" else width)
    copies, pixels = 1 if gpus.sharded else gpus.count, 4.0 * size.patch * all_patches
    drawn = replay.steps or _STEPS
    if replay.trajectories is not None:
        drawn = replay.trajectories * _TRAJECTORY_STEPS
    samples = drawn * replay.passes
    forward = size.text.forward_flops(tokens, tokens, causal=True)
    forward += 2.0 * work.reply_tokens * size.embeddings / 2
    vision_forward = size.vision.forward_flops(all_patches, work.picture_patches, causal=False)
    backward = 1.0 + (1.0 if update.lora is None else trained / size.parameters)
    recomputed = 1.0 if update.gradient_checkpointing else 0.0
    scoring = 1.0 / replay.passes if make_objective(config.objective).off_policy else 0.0
    flops = samples * (
        forward * (1 + backward + recomputed + scoring)
        + vision_forward * (1 + scoring + (0.0 if frozen_vision else 2 + recomputed))
    )
    speed, reply_seconds = gpus.peak_tflops * 1e12 * UTILISATION, 0.0
    if local is not None and local.device != "cpu":
        memory["local model"] = size.parameters * (4.0 if local.dtype == "float32" else 2.0)
        decoding = work.reply_tokens * size.text.layers * LAYER_SECONDS / local.most_at_once
        reply_seconds = (forward + vision_forward) / speed + decoding
    return Estimate(
        parameters=size.parameters,
        trained=trained,
        memory=memory,
        host=copies * size.parameters * width + gpus.count * (AHEAD + 1) * update.micro_batch * pixels,
        written=training + served,
        disk=2 * training + (keep + 2) * served,
        fits=sum(memory.values()) < 0.9 * gpus.memory_gib * GIB,
        tokens=samples * tokens,
        reply_tokens=samples * work.reply_tokens,
        optimizer_steps=replay.passes * (update.minibatches or max(1, round(drawn / update.batch))),
        flops=flops,
        seconds=flops / (gpus.count * speed),
        reply_seconds=reply_seconds,
    )


def _memory(
    update: UpdateConfig,
    size: Shapes,
    gpus: Gpus,
    trained: int,
    longest: tuple[int, int],
    *,
    vision: bool,
) -> dict[str, float]:
    """Bytes on a GPU, by purpose; ``longest`` are the tokens and patches of the longest sample."""
    text, tower, micro, (sequence, patches) = size.text, size.vision, update.micro_batch, longest
    width, number = (4 if update.weights == "float32" else 2), (2 if update.precision == "bf16" else 4)
    is_sharded = gpus.sharded and gpus.count > 1
    parts, copies = (gpus.count, 1) if is_sharded else (1, 1 + (gpus.count > 1))
    of_trained = 4.0 if update.lora else float(width)
    tokens, patches, replies = micro * sequence, micro * patches, update.logit_tokens
    table = size.embeddings if size.is_tied else size.embeddings // 2
    untied = 0 if size.is_tied else table
    in_layers = sum(each.layers * each.layer_parameters for each in (text, tower))
    outside = size.parameters - in_layers - (0 if size.is_tied else size.embeddings)
    layer = max(text.layer_parameters, tower.layer_parameters)
    casts = number < width
    gathered = number * (outside + 2 * layer) if is_sharded else trained * 2.0 * casts
    recomputes = update.gradient_checkpointing
    stream = number if is_sharded else max(number, width)
    kept = text.activation_bytes(tokens, sequence, stream if recomputes else number, checkpointing=recomputes)
    kept += tokens * text.width * (4 + 2 * number) + patches * size.patch * (4 + number * casts)
    recomputed = text.layer_bytes(tokens, sequence, number)
    if vision:
        kept += tower.activation_bytes(patches, 0, stream if recomputes else number, checkpointing=recomputes)
        kept += patches * tower.width * 4 * number * size.mergers
        recomputed = max(recomputed, tower.layer_bytes(patches, 0, number))
    summed = 4 if is_sharded else 0  # gradients in float32, before they are split
    working = (
        replies * size.vocabulary * (12.0 + number) + 2 * number * untied,
        recomputed * recomputes
        + 2 * tokens * number * text.inner
        + number * table * size.is_tied
        + summed * max(layer, untied),
        (summed + number) * (untied or outside * is_sharded) - kept,
    )
    return {
        "weights": size.parameters * float(width) / parts,
        "gradients": copies * trained * of_trained / parts,
        "optimizer": 2 * trained * of_trained / parts,
        "gathered": gathered,
        "activations": kept,
        "working": max(working),
    }
