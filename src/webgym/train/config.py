"""Settings of learning. Defaults are the paper's best values, if it names one (paper §5, appendix F)."""

from __future__ import annotations

import re
from typing import Any, Literal, TypeAlias

from pydantic import Field, field_validator, model_validator

from webgym.core.settings import ModelName, Settings

Precision: TypeAlias = Literal["bf16", "fp32"]
CollapseAction: TypeAlias = Literal["warn", "stop", "ignore"]


class ReplayConfig(Settings):
    """Settings of the replay buffer: which steps an iteration trains on."""

    iterations: int = Field(default=4, ge=1)
    """Number of newest iterations whose steps are kept."""

    recency: float = Field(default=2.0, ge=0)
    """How strongly newer steps are preferred: a step of age a among k iterations has the weight
    ((k - a) / k) ** recency. 0 draws uniformly."""

    steps: int | None = Field(default=1800, ge=1)
    """Steps drawn for an iteration; all available ones if there are fewer, or for ``None``."""

    trajectories: int | None = Field(default=None, ge=1)
    """Draw whole trajectories instead, at most this many; an update waits until there are so many, of groups
    that are mixed if the objective compares attempts. ``None``: draw steps."""

    passes: int = Field(default=2, ge=1)
    """How often an iteration trains on each of its steps."""

    max_uses: int | None = Field(default=4, ge=1)
    """Most times that a step is trained on, over all iterations; ``None`` for no limit."""

    repetition_penalty: bool = True
    """Leave out steps after which the screenshot was the same (paper §5)."""

    rescue: bool = False
    """Give a group that failed altogether the newest success at its task from earlier iterations, of whatever
    age: importance weights leave out what the policy would no longer do."""

    @model_validator(mode="after")
    def _check_uses(self) -> ReplayConfig:
        if self.max_uses is not None and self.max_uses < self.passes:
            raise ValueError("max_uses must be at least passes, or no step could be used")
        return self


class ObjectiveConfig(Settings):
    """Settings of the training objective."""

    name: str = "filtered_bc"
    """``filtered_bc`` (the paper's), ``group_is`` (AsyncWebRL's), or ``module:attribute`` of your own."""

    options: dict[str, Any] = Field(default_factory=dict)
    """Settings of the objective, by the names of its fields."""


class LoraConfig(Settings):
    """Settings of low-rank adapters, trained instead of all weights."""

    rank: int = Field(default=32, ge=1)
    """Rank of each adapter."""

    alpha: float = Field(default=64, gt=0, allow_inf_nan=False)
    """The adapters' output is scaled by alpha / rank."""

    dropout: float = Field(default=0.0, ge=0, lt=1)
    """Dropout on the adapters' input. Values above 0 make the importance weights of ``group_is`` noisy."""

    targets: str = r".*language_model.*\.(q_proj|k_proj|v_proj|o_proj|gate_proj|up_proj|down_proj)"
    """Regular expression for the names of the modules that get an adapter."""

    @field_validator("targets")
    @classmethod
    def _is_regular(cls, value: str) -> str:
        try:
            re.compile(value)
        except re.error as error:
            raise ValueError(f"{value!r} is no regular expression: {error}") from error
        return value


class UpdateConfig(Settings):
    """Settings of the weight update."""

    learning_rate: float = Field(default=1e-6, gt=0, allow_inf_nan=False)
    """Peak learning rate of the schedule."""

    schedule: Literal["constant", "cosine"] = "constant"
    """Schedule after the warm-up."""

    warmup_steps: int = Field(default=30, ge=0)
    """Optimizer steps over which the learning rate rises linearly, counted over all iterations."""

    total_steps: int | None = Field(default=None, ge=1)
    """Optimizer steps at which ``cosine`` reaches ``final_rate``."""

    final_rate: float = Field(default=0.0, ge=0, le=1)
    """Share of the peak learning rate at the end of ``cosine``."""

    batch: int = Field(default=192, ge=1)
    """Steps of trajectories per optimizer step, over all processes (the paper's 3 x 4 x 8 x 2)."""

    minibatches: int | None = Field(default=None, ge=1)
    """Optimizer steps of a pass, each on whole trajectories; ``None`` for as many as ``batch`` gives."""

    micro_batch: int = Field(default=3, ge=1)
    """Steps of trajectories per process and forward pass."""

    betas: tuple[float, float] = (0.9, 0.999)
    """Coefficients of AdamW's moments."""

    weight_decay: float = Field(default=0.01, ge=0, allow_inf_nan=False)
    """AdamW's weight decay of matrices; biases and norms have none."""

    max_grad_norm: float = Field(default=1.0, gt=0, allow_inf_nan=False)
    """Gradients are clipped to this norm."""

    precision: Precision = "bf16"
    """Precision of the computation. Log-probabilities and the loss are always float32."""

    weights: Literal["float32", "bfloat16"] = "float32"
    """Data type of weights in memory. ``bfloat16`` halves their size, but full fine-tuning at small learning
    rates then loses updates to rounding; use it with LoRA."""

    lora: LoraConfig | None = None
    """Train adapters; ``None`` trains all weights."""

    freeze_vision: bool = False
    """Do not train the vision tower."""

    gradient_checkpointing: bool = False
    """Recompute activations in the backward pass to save memory. The paper does not."""

    cutoff_tokens: int = Field(default=16384, ge=1)
    """Most tokens of request and reply, images included. Longer steps are dropped and counted, not
    truncated."""

    logit_tokens: int = Field(default=1024, ge=1)
    """Reply tokens whose logits are in memory at once, per process."""

    start_steps: int = Field(default=32, ge=0)
    """Steps of an update on which the divergence from the weights that learning started from is measured; 0
    for none. Without adapters that loads a second model, and sharded weights are not measured."""

    seed: int = Field(default=0, ge=0, lt=2**32)
    """Seed of the order of steps and of dropout."""

    @model_validator(mode="after")
    def _check_schedule(self) -> UpdateConfig:
        if self.schedule == "cosine" and self.total_steps is None:
            raise ValueError("a cosine schedule needs total_steps")
        if self.schedule == "cosine" and (self.total_steps or 0) <= self.warmup_steps:
            raise ValueError("total_steps must be above warmup_steps")
        if not all(0 <= beta < 1 for beta in self.betas):
            raise ValueError("betas must be at least 0 and below 1")
        return self


class FrontierConfig(Settings):
    """Settings of the preference for tasks that succeed sometimes."""

    by: Literal["task", "website", "level", "website_level"] = "website_level"
    """Which tasks share a success rate. Tasks are rarely drawn twice, so larger groups are estimated
    faster."""

    prior: tuple[float, float] = (1.0, 1.0)
    """Beta prior of a rate: pseudo-successes and pseudo-failures."""

    floor: float = Field(default=0.1, gt=0, le=1)
    """Weight of a bucket that always or never succeeds, against 1 at a rate of one half."""

    decay: float = Field(default=0.5, ge=0, le=1)
    """Factor on the weight of earlier results after each iteration, since the policy changes."""

    @model_validator(mode="after")
    def _check_prior(self) -> FrontierConfig:
        if min(self.prior) <= 0:
            raise ValueError("both numbers of the prior must be above 0")
        return self


class LearnConfig(Settings):
    """Everything between judged trajectories and new weights."""

    model: ModelName
    """Folder or hub id of the weights that learning starts from; ``tiny`` for those of the tiny policy."""

    replay: ReplayConfig = ReplayConfig()
    """Selection of the steps to train on."""

    objective: ObjectiveConfig = ObjectiveConfig()
    """The training objective."""

    update: UpdateConfig = UpdateConfig()
    """The weight update."""

    frontier: FrontierConfig | None = None
    """Prefer tasks that succeed sometimes; ``None`` for no preference."""

    on_collapse: CollapseAction = "warn"
    """What to do if replies become surer, longer and unreadable, at least two of the three."""
