"""Settings of learning. Defaults are the paper's best where it names one (paper §5, appendix F)."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from pydantic import Field, model_validator

from webgym.settings import Settings

Precision: TypeAlias = Literal["bf16", "fp32"]


class ReplayConfig(Settings):
    """Which steps an iteration trains on."""

    iterations: int = Field(default=4, ge=1)
    """The newest iterations whose steps are kept."""

    recency: float = Field(default=2.0, ge=0)
    """How strongly newer steps are preferred: a step of age a among k iterations has the weight
    ((k - a) / k) ** recency. 0 draws from all alike."""

    steps: int = Field(default=1800, ge=1)
    """Steps drawn for an iteration; all that there are if there are fewer."""

    passes: int = Field(default=2, ge=1)
    """How often an iteration trains on each of its steps."""

    max_uses: int | None = Field(default=4, ge=1)
    """A step that was trained on this often, over all iterations, leaves; ``None`` for never."""

    repetition_penalty: bool = True
    """Leave out steps after which the screenshot was the same (paper §5)."""

    @model_validator(mode="after")
    def _can_be_used(self) -> ReplayConfig:
        if self.max_uses is not None and self.max_uses < self.passes:
            raise ValueError("max_uses must be at least passes, or no step could be used")
        return self


class ObjectiveConfig(Settings):
    """What is maximised."""

    name: str = "filtered_bc"
    """``filtered_bc`` (the paper's), ``group_is`` (AsyncWebRL's), or ``module:attribute`` of one's own."""

    options: dict[str, Any] = Field(default_factory=dict)
    """Settings of the objective, by the names of its fields."""


class LoraConfig(Settings):
    """Low-rank adapters in place of all weights."""

    rank: int = Field(default=32, ge=1)
    """Of each adapter."""

    alpha: float = Field(default=64, gt=0)
    """The adapters' output is scaled by alpha / rank."""

    dropout: float = Field(default=0.0, ge=0, lt=1)
    """On the adapters' input. Anything but 0 makes the importance weights of ``group_is`` noisy."""

    targets: str = r".*language_model.*\.(q_proj|k_proj|v_proj|o_proj|gate_proj|up_proj|down_proj)"
    """Regular expression of the modules that get one."""


class UpdateConfig(Settings):
    """How weights follow from steps."""

    learning_rate: float = Field(default=1e-6, gt=0)
    """Peak of the schedule."""

    schedule: Literal["constant", "cosine"] = "constant"
    """After the warm-up."""

    warmup_steps: int = Field(default=30, ge=0)
    """Optimizer steps over which the learning rate rises linearly, counted over all iterations."""

    total_steps: int | None = Field(default=None, ge=1)
    """Optimizer steps at which ``cosine`` reaches 0."""

    batch: int = Field(default=192, ge=1)
    """Steps of trajectories per optimizer step, over all processes (the paper's 3 x 4 x 8 x 2)."""

    micro_batch: int = Field(default=3, ge=1)
    """Steps of trajectories per process that go through the model at once."""

    betas: tuple[float, float] = (0.9, 0.999)
    """Of AdamW."""

    weight_decay: float = Field(default=0.01, ge=0)
    """Of AdamW, for matrices; biases and norms are left alone."""

    max_grad_norm: float = Field(default=1.0, gt=0)
    """Gradients are scaled down to this norm."""

    precision: Precision = "bf16"
    """Of the computation. Log-probabilities and the loss are always float32."""

    weights: Literal["float32", "bfloat16"] = "float32"
    """How weights lie in memory. ``bfloat16`` halves them; a full fine-tuning at small learning rates then
    loses updates to rounding, so it is for LoRA."""

    lora: LoraConfig | None = None
    """Train adapters; ``None`` trains all weights."""

    freeze_vision: bool = False
    """Leave the vision tower as it is."""

    gradient_checkpointing: bool = False
    """Compute activations twice to save memory. The paper does without."""

    cutoff_tokens: int = Field(default=16384, ge=1)
    """A step with a longer request and reply, images included, is left out and counted; never cut."""

    logit_tokens: int = Field(default=1024, ge=1)
    """Reply tokens whose logits are in memory at once, per process."""

    seed: int = 0
    """Of the order of steps and of dropout."""

    @model_validator(mode="after")
    def _is_whole(self) -> UpdateConfig:
        if self.schedule == "cosine" and self.total_steps is None:
            raise ValueError("a cosine schedule needs total_steps")
        return self


class FrontierConfig(Settings):
    """Preference for tasks that succeed sometimes."""

    by: Literal["task", "website", "level", "website_level"] = "website_level"
    """What shares a success rate. Tasks are seldom drawn twice, so buckets learn faster than tasks."""

    prior: tuple[float, float] = (1.0, 1.0)
    """Beta prior of a rate: pseudo-successes and pseudo-failures."""

    floor: float = Field(default=0.1, gt=0, le=1)
    """Weight of a bucket that always or never succeeds, against 1 at a rate of one half."""

    decay: float = Field(default=0.5, ge=0, le=1)
    """What earlier results count after each iteration: the policy changes."""

    @model_validator(mode="after")
    def _is_a_prior(self) -> FrontierConfig:
        if min(self.prior) <= 0:
            raise ValueError("both numbers of the prior must be above 0")
        return self


class LearnConfig(Settings):
    """Everything between judged trajectories and new weights."""

    model: str
    """Folder or hub id of the weights that learning starts from."""

    replay: ReplayConfig = ReplayConfig()
    """Which steps."""

    objective: ObjectiveConfig = ObjectiveConfig()
    """What for."""

    update: UpdateConfig = UpdateConfig()
    """How."""

    frontier: FrontierConfig | None = None
    """Draw tasks at the frontier of the success rate; ``None`` leaves drawing to the sampler alone."""
