"""Estimates the memory, tokens and time of an update before training starts.

All figures are for one update (an iteration's training) and the busiest GPU. With N weights in total, T of
them trained, G GPUs, b bytes a weight, and t tokens in a micro-batch of the longest samples:

    weights      N b / S                S = G if sharded (FSDP), else 1
    gradients    T b / S
    optimizer    2 T b / S              AdamW's two moments
    activations  t L (2 bytes) (4 h + 2 q + 2 kv + 4 i), and the vision tower's likewise;
                 with gradient checkpointing t L 2 h and one layer whole
    logits       3 c V (4 bytes)        c reply tokens at once, vocabulary V: logits, their softmax, gradient
    local model  N b                    if one replies in this process, with its own b

    (L layers of width h; q and kv the widths of queries and of keys and values; i of the MLP)

    compute      (2 + 2 + 2 T / N) N per token for forward, backward to activations, backward to weights; one
                 more forward with gradient checkpointing, and one for an off-policy objective;
                 attention 4 q s / 2 per token, layer and pass, for sequences of s tokens
    time         compute / (G x peak x utilisation)

Embeddings are looked up, not multiplied, so they count for memory but not for compute; the head counts for
reply tokens only. Activations are a rule of thumb for fused attention in bf16 and may be off by a third.
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
from webgym.train.config import LearnConfig
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


UTILISATION: Final = 0.4
"""Assumed share of a GPU's peak that training reaches."""


@dataclass(frozen=True, slots=True)
class Gpus:
    """The GPUs to train on.

    Attributes:
        count: number of GPUs.
        memory_gib: memory of each GPU.
        peak_tflops: peak of each GPU, bf16 without sparsity.
        sharded: whether weights, gradients and optimizer state are sharded over the GPUs.
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
    """The GPUs that this process was launched to train on; ``None`` if there is none."""
    if not torch.cuda.is_available():
        return None
    shards = (os.environ.get(f"ACCELERATE_USE_{name}") == "true" for name in ("FSDP", "DEEPSPEED"))
    return Gpus(
        count=int(os.environ.get("WORLD_SIZE") or 1),
        memory_gib=torch.cuda.get_device_properties(0).total_memory / GIB,
        sharded=any(shards),
    )


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
    """A tower of a model, with layers of equal shape; widths are numbers of features."""

    layers: int
    width: int
    queries: int
    keys: int
    inner: int
    parameters: int

    def activation_bytes(self, tokens: int, *, checkpointing: bool) -> float:
        """Bytes of activations that are kept for the backward pass."""
        layer = 2.0 * tokens * (4 * self.width + 2 * self.queries + 2 * self.keys + 4 * self.inner)
        return layer + 2.0 * tokens * self.width * self.layers if checkpointing else layer * self.layers

    def forward_flops(self, tokens: int, sequence: int, *, causal: bool) -> float:
        """Operations of a forward pass over ``tokens`` tokens, which attend to ``sequence`` tokens."""
        attention = 4.0 * self.layers * self.queries * sequence * (0.5 if causal else 1.0)
        return tokens * (2.0 * self.parameters + attention)


@dataclass(frozen=True, slots=True)
class Shapes:
    """The sizes of a model's parts. ``embeddings`` counts input and output embeddings."""

    text: Part
    vision: Part
    embeddings: int
    vocabulary: int
    merge: int

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
        fits: whether their sum is below 90 % of a GPU's memory.
        tokens: input tokens of an update, over all passes.
        reply_tokens: those among them with a loss.
        optimizer_steps: in an update.
        flops: floating point operations of an update.
        seconds: of an update, at the assumed utilisation.
    """

    parameters: int
    trained: int
    memory: dict[str, float]
    fits: bool
    tokens: int
    reply_tokens: int
    optimizer_steps: int
    flops: float
    seconds: float

    def lines(self) -> list[str]:
        """The estimate as lines of text."""
        total = sum(self.memory.values()) / GIB
        share = ", ".join(f"{name} {value / GIB:.1f}" for name, value in self.memory.items())
        verdict = "fits" if self.fits else "DOES NOT FIT"
        return [
            f"model      {self.parameters / 1e9:.2f} B weights, {self.trained / 1e9:.3f} B trained",
            f"memory     {total:.1f} GiB per GPU, {verdict}: {share}",
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
    layers = text.num_hidden_layers
    return Shapes(
        text=Part(
            layers,
            text.hidden_size,
            query_width,
            key_width,
            text.intermediate_size,
            all_parameters - vision_parameters - embeddings,
        ),
        vision=Part(
            vision.depth,
            vision.hidden_size,
            vision.hidden_size,
            vision.hidden_size,
            vision.intermediate_size // 2,  # no gate: two of the four tensors of a gated MLP
            vision_parameters,
        ),
        embeddings=embeddings,
        vocabulary=text.vocab_size,
        merge=vision.spatial_merge_size**2,
    )


def estimate(
    config: LearnConfig,
    gpus: Gpus,
    workload: Workload | None = None,
    shapes: Shapes | None = None,
    *,
    local: LocalConfig | None = None,
) -> Estimate:
    """Estimate an update with these settings on these GPUs; see the module for the formulas.

    Args:
        config: of learning.
        gpus: to compute with.
        workload: size of steps; by default the paper's at 1280 x 768.
        shapes: of the model; by default read from its folder or the hub.
        local: the model that replies in this process, if there is one.

    Raises:
        ConfigError: the model is not supported, or there is no such objective.
    """
    work, size = workload or Workload(), shapes or shapes_of(config.model)
    update, replay = config.update, config.replay
    patches = work.pictures * work.picture_patches
    tokens = work.text_tokens + patches // size.merge + work.reply_tokens
    longest = max(tokens, min(update.cutoff_tokens, 2 * tokens))
    frozen_vision = update.freeze_vision or update.lora is not None
    trained = size.parameters - (size.vision.parameters if update.freeze_vision else 0)
    if update.lora is not None:
        text = size.text
        widths = 4 * text.width + 2 * (text.queries + text.keys) + 3 * (text.width + text.inner)
        trained = update.lora.rank * text.layers * widths
    width = 4 if update.weights == "float32" else 2
    parts = gpus.count if gpus.sharded else 1
    micro = update.micro_batch
    vision_activations = 0.0
    if not frozen_vision:
        vision_activations = size.vision.activation_bytes(
            micro * patches * longest // tokens, checkpointing=update.gradient_checkpointing
        )
    memory = {
        "weights": size.parameters * width / parts,
        "gradients": trained * (4 if update.lora else width) / parts,
        "optimizer": 2 * trained * (4 if update.lora else width) / parts,
        "activations": vision_activations
        + size.text.activation_bytes(micro * longest, checkpointing=update.gradient_checkpointing),
        "logits": 3 * 4.0 * update.logit_tokens * size.vocabulary,
    }
    if local is not None and local.device != "cpu":
        memory["local model"] = size.parameters * (4.0 if local.dtype == "float32" else 2.0)
    samples = replay.steps * replay.passes
    forward = size.text.forward_flops(tokens, tokens, causal=True)
    forward += 2.0 * work.reply_tokens * size.embeddings / 2
    vision_forward = size.vision.forward_flops(patches, work.picture_patches, causal=False)
    backward = 1.0 + (1.0 if update.lora is None else trained / size.parameters)
    recomputed = 1.0 if update.gradient_checkpointing else 0.0
    scoring = 1.0 / replay.passes if make_objective(config.objective).off_policy else 0.0
    flops = samples * (
        forward * (1 + backward + recomputed + scoring)
        + vision_forward * (1 + scoring + (0.0 if frozen_vision else 2 + recomputed))
    )
    return Estimate(
        parameters=size.parameters,
        trained=trained,
        memory=memory,
        fits=sum(memory.values()) < 0.9 * gpus.memory_gib * GIB,
        tokens=samples * tokens,
        reply_tokens=samples * work.reply_tokens,
        optimizer_steps=replay.passes * max(1, round(replay.steps / update.batch)),
        flops=flops,
        seconds=flops / (gpus.count * gpus.peak_tflops * 1e12 * UTILISATION),
    )
