"""Settings of the rubric judge: its models, and how much they are shown."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from webgym.llm.config import ChatConfig, Sampling
from webgym.settings import Section, Settings

Stage: TypeAlias = Literal["keypoint", "fact", "response", "blocking", "reference"]
STAGES: Final[tuple[Stage, ...]] = ("keypoint", "fact", "response", "blocking", "reference")

Way: TypeAlias = Literal["exact", "normalised", "set", "model"]

WAYS_BY_SOURCE: Final[dict[str, tuple[Way, ...]]] = {
    # The offline web's references list what a right answer names, joined by semicolons.
    "offline": ("set", "normalised", "model"),
    # Short facts with one right form each (names, counts, dates).
    "browsecomp": ("normalised", "model"),
    "gaia-web": ("normalised", "set", "model"),
    # "golden" answers are sentences as often as values; "possible" ones are examples and never come here.
    "pae-webvoyager": ("normalised", "set", "model"),
    # The answer that somebody's run ended in: free text.
    "agentsynth-web": ("normalised", "model"),
}
"""How an answer is held against the reference answer, by the task's source. The ways are tried in turn
until one is sure. Sources that are not named here have :attr:`JudgeConfig.reference_ways`."""


PROMPT_CHARS: Final = 6_000
"""At most what a prompt's own words and a rubric's facts take, for seeing early that nothing would fit."""


class StageConfig(Section):
    """The model that is asked one kind of question."""

    chat: ChatConfig | None = None
    """Endpoint and model; without one, the judge's own. Its sampling holds where the stage's is silent."""

    sampling: Sampling = Sampling(temperature=0.0, max_tokens=1024)
    """Temperature 0 unless a panel draws several samples. A thinking model needs more tokens."""

    images_per_call: Annotated[int, Field(ge=1)] = 24
    """Screenshots in one request: what model and endpoint take. Beyond it they are shown in parts, and what
    the parts show is put together."""

    request_tokens: Annotated[int, Field(ge=2048)] = 65_536
    """What a request may take, by the estimate below; more screenshots than fit are shown in parts, and the
    oldest actions are left out."""


class ImageConfig(Section):
    """How screenshots are sent."""

    max_side: int = Field(default=1280, ge=64)
    """Longer side at most, pixels; a larger screenshot is made smaller."""

    max_bytes: int = Field(default=1_500_000, ge=10_000)
    """A screenshot whose PNG is larger is sent as JPEG."""

    jpeg_quality: int = Field(default=85, ge=1, le=95)
    """Of those."""

    pixels_per_token: int = Field(default=784, ge=1)
    """For the estimate: Qwen-VL models take one token for 28 by 28 pixels, others fewer."""


class TextConfig(Section):
    """How much text is sent, in characters."""

    chars_per_token: float = Field(default=3.0, gt=0)
    """For the estimate; low, so that the estimate is high."""

    instruction_chars: int = Field(default=8_000, ge=200)
    """Of the task; the middle of a longer one is left out."""

    answer_chars: int = Field(default=12_000, ge=200)
    """Of the answer; likewise."""

    history_chars: int = Field(default=12_000, ge=200)
    """Of the action history; its oldest lines are left out."""

    action_chars: int = Field(default=300, ge=40)
    """Of one action in the history."""

    reason_chars: int = Field(default=1_200, ge=100)
    """Of a reason that is kept in the verdict."""


class JudgeConfig(Section):
    """The rubric judge, resolved. Holds no key."""

    chat: ChatConfig
    """Endpoint and model of every stage that names none of its own."""

    keypoint: StageConfig = StageConfig(images_per_call=4)
    """Does a screenshot show anything that matters? 4 in one request: with more, small models lose count."""

    fact: StageConfig = StageConfig()
    """Criterion A, once per fact."""

    response: StageConfig = StageConfig()
    """Criterion B, once."""

    blocking: StageConfig = StageConfig(images_per_call=2)
    """Did the website keep the agent out? The last screenshots tell."""

    reference: StageConfig = StageConfig()
    """Does the answer say what the reference answer says? Asked where rules are not sure."""

    images: ImageConfig = ImageConfig()
    texts: TextConfig = TextConfig()

    select_keypoints: bool = True
    """Choose screenshots before the facts are judged (paper §3.4); else all are shown."""

    early_exit: bool = False
    """Stop at the first criterion that fails. Cheaper, but the verdict then lacks facts and has no score."""

    judge_unanswered: bool = True
    """Judge the facts of an episode that gave no answer too: its reward is 0 either way, its score is not."""

    reference_rule: Literal["decides", "required"] = "decides"
    """What a reference answer overrides. ``decides``: it alone sets the reward (paper §3.4). ``required``: an
    answer that does not match it fails whatever else holds, and one that matches must still rest on what was
    seen; for a policy that may know or guess answers."""

    reference_ways: tuple[Way, ...] = ("normalised", "set", "model")
    """For sources that :data:`WAYS_BY_SOURCE` does not name."""

    ways_by_source: dict[str, tuple[Way, ...]] = WAYS_BY_SOURCE
    """How answers are held against reference answers, by source."""

    blocking_model: bool = True
    """Ask a model whether an unsuccessful attempt was blocked where the rules see nothing."""

    tries: int = Field(default=3, ge=1)
    """How often a question is put until the reply has a clear verdict."""

    concurrency: int = Field(default=8, ge=1)
    """Questions about one episode at the same time. The endpoint's own limit is the chat config's."""

    signed_verdicts: bool = True
    """Demand the request's code in every verdict line. ``False`` demands it only where something quoted could
    pass for a verdict, for models that cannot repeat a code."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        texts = self.texts
        chars = PROMPT_CHARS + texts.instruction_chars + max(texts.answer_chars * 2, texts.history_chars)
        needed = chars / texts.chars_per_token + self.images.max_side**2 / self.images.pixels_per_token
        for name in STAGES:
            stage = self.stage(name)
            if needed + (stage.sampling.max_tokens or 0) > stage.request_tokens:
                raise ValueError(
                    f"a {name} request may take {stage.request_tokens} tokens, but the longest texts and one "
                    f"screenshot alone take about {needed:.0f}; allow more, or lower texts or images.max_side"
                )
        return self

    def stage(self, name: Stage) -> StageConfig:
        """The settings of a stage."""
        stages: dict[Stage, StageConfig] = {
            "keypoint": self.keypoint,
            "fact": self.fact,
            "response": self.response,
            "blocking": self.blocking,
            "reference": self.reference,
        }
        return stages[name]

    def chat_of(self, name: Stage) -> ChatConfig:
        """Endpoint and model of a stage."""
        return self.stage(name).chat or self.chat


class PanelConfig(Section):
    """Several samples of one judge."""

    samples: int = Field(default=1, ge=1)
    """Number of samples in a panel, whose majority decides; 1 is no panel."""

    temperature: float = Field(default=0.7, ge=0)
    """Of the samples; every one has a seed of its own."""


class JudgeChoice(Settings):
    """Which judge."""

    name: str = "offline"
    """``offline`` (for the offline web's tasks), ``rubric`` (a model; the default if an endpoint is given) or
    ``module:function`` (your own)."""

    rubric: JudgeConfig | None = None
    """Of the rubric judge: models and rules."""

    cache: Path | None = None
    """Of the rubric judge: a file that keeps replies, so that no question is paid for twice."""

    panel: PanelConfig = Field(default_factory=PanelConfig)
    """Of the rubric judge: several samples by majority."""

    without_rubric: bool = False
    """Judge the task as a whole, for comparison; not possible with the offline judge."""
