"""Settings of the judges that ask a model: which ones, and how many screenshots and characters they get."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from webgym.core.settings import Section, Settings
from webgym.judge.untrusted import code_of
from webgym.llm.config import ChatConfig, Sampling

Stage: TypeAlias = Literal["keypoint", "fact", "response", "blocking", "reference"]
STAGES: Final[tuple[Stage, ...]] = ("keypoint", "fact", "response", "blocking", "reference")

MODEL_JUDGES: Final = ("rubric", "webjudge", "webvoyager", "deepshop")
"""Names of the judges that ask a model."""

PROMPT_CHARS: Final = 6_000
"""Upper estimate of the characters of a prompt's fixed text and a rubric's facts, for checking the
settings."""

PIXELS_PER_TOKEN = 784
"""For estimating a request's tokens: Qwen-VL models use one token for 28 by 28 pixels, others fewer."""

CHARS_PER_TOKEN = 3.0
"""For estimating a request's tokens; low, so that the estimate errs on the high side."""


class StageConfig(Section):
    """The model of one stage of the judge, and the limits of a request to it."""

    chat: ChatConfig | None = None
    """Endpoint and model; ``None`` uses the judge's own. Its sampling parameters apply where the stage sets
    none."""

    sampling: Sampling = Sampling(temperature=0.0, max_tokens=1024)
    """Temperature 0 unless a panel draws several samples. A thinking model needs more tokens."""

    images_per_call: Annotated[int, Field(ge=1)] = 24
    """Most screenshots in one request, as model and endpoint allow. More are split over several requests,
    whose replies are combined."""

    request_tokens: Annotated[int, Field(ge=2048)] = 65_536
    """Most tokens of a request and its reply, as estimated with ``PIXELS_PER_TOKEN`` and
    ``CHARS_PER_TOKEN``. Screenshots that do not fit are split over several requests."""


class ImageConfig(Section):
    """How screenshots are sent."""

    max_side: int = Field(default=1280, ge=64)
    """Longest side in pixels; a larger screenshot is scaled down."""


class TextConfig(Section):
    """How much text is sent to a model and kept from it, in characters."""

    instruction_chars: int = Field(default=8_000, ge=200)
    """Longest task instruction; the middle of a longer one is left out."""

    answer_chars: int = Field(default=12_000, ge=200)
    """Longest answer in a request. A longer one is judged in parts, all of which must be supported, and is
    another one than the reference answer unless it ends in exactly that."""

    history_chars: int = Field(default=12_000, ge=200)
    """Longest action history; the oldest lines of a longer one are left out."""


class JudgeConfig(Section):
    """Models and limits of the judges that ask a model, with defaults filled in. Contains no API key.

    The stages are the rubric judge's. WebJudge asks for key points and scores as ``keypoint`` and for its
    verdict as ``response``, WebVoyager's and DeepShop's judges ask as ``response``; how many screenshots they
    show is theirs.
    """

    chat: ChatConfig
    """Endpoint and model of every stage that has none of its own."""

    keypoint: StageConfig = StageConfig(images_per_call=4)
    """Selects the screenshots that matter. 4 in one request: with more, small models lose count."""

    fact: StageConfig = StageConfig()
    """Criterion A: whether the screenshots confirm a fact. Asked once per fact."""

    response: StageConfig = StageConfig()
    """Criterion B: whether the screenshots support every claim of the answer. Asked once per episode."""

    blocking: StageConfig = StageConfig(images_per_call=2)
    """Whether the website blocked the agent, judged by the last screenshots."""

    reference: StageConfig = StageConfig()
    """Whether the answer agrees with the reference answer. Asked where the rule is unsure."""

    images: ImageConfig = ImageConfig()
    texts: TextConfig = TextConfig()

    early_exit: bool = False
    """Stop at the first criterion that fails. Cheaper, but the verdict then lacks facts and has no score."""

    reference_rule: Literal["decides", "required"] = "decides"
    """What a reference answer overrides. ``decides``: it alone sets the reward (paper §3.4). ``required``: an
    answer that does not match it fails, and one that matches must still be supported by the screenshots; for
    a policy that may know or guess answers."""

    blocking_model: bool = True
    """Ask a model whether an unsuccessful attempt was blocked, where the rules do not find that it was."""

    tries: int = Field(default=3, ge=1)
    """How often a question is asked until the reply has a clear verdict."""

    concurrency: int = Field(default=8, ge=1)
    """Concurrent questions about one episode. The endpoint's own limit is set in ``chat``."""

    signed_verdicts: bool = True
    """Require the request's code in every verdict line. ``False`` requires it only where quoted text could be
    mistaken for a verdict, for models that cannot repeat a code."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        texts = self.texts
        chars = PROMPT_CHARS + texts.instruction_chars + max(texts.answer_chars * 2, texts.history_chars)
        needed = chars / CHARS_PER_TOKEN + self.images.max_side**2 / PIXELS_PER_TOKEN
        for name in STAGES:
            stage = self.stage(name)
            if needed + (stage.sampling.max_tokens or 0) > stage.request_tokens:
                raise ValueError(
                    f"a {name} request may take {stage.request_tokens} tokens, but the longest texts and one "
                    f"screenshot alone take about {needed:.0f}; allow more, or lower texts or images.max_side"
                )
        return self

    def stage(self, name: Stage) -> StageConfig:
        """The settings of one stage."""
        stages: dict[Stage, StageConfig] = {
            "keypoint": self.keypoint,
            "fact": self.fact,
            "response": self.response,
            "blocking": self.blocking,
            "reference": self.reference,
        }
        return stages[name]

    def chat_of(self, name: Stage) -> ChatConfig:
        """Endpoint and model of one stage: its own, else the judge's."""
        return self.stage(name).chat or self.chat

    def digest(self) -> str:
        """Digest of every setting that can change a verdict, which endpoints, concurrency and retries
        cannot."""
        stages = {}
        for name in STAGES:
            stage, chat = self.stage(name), self.chat_of(name)
            sampling = stage.sampling.over(chat.sampling)  # as it is sent
            sent = {"sampling": dict(sampling), "model": chat.model}
            stages[name] = stage.model_dump(mode="json", exclude={"chat", "sampling"}) | sent
        rules = self.model_dump(mode="json", exclude={"chat", "concurrency", "tries", *STAGES})
        return code_of(json.dumps([stages, rules], sort_keys=True))[:6]


class PanelConfig(Section):
    """Several samples of one judge."""

    samples: int = Field(default=1, ge=1)
    """Number of samples, whose majority decides; 1 judges once, without a panel."""

    temperature: float = Field(default=0.7, ge=0)
    """Sampling temperature of the samples; each has its own seed."""


class JudgeChoice(Settings):
    """Which judge is used, and its settings."""

    name: str = "offline"
    """``offline`` (for the offline web's tasks), ``rubric`` (a model; the default if an endpoint is given),
    ``webjudge``, ``webvoyager`` or ``deepshop`` (a model, as those benchmarks judge) or ``module:function``
    (your own)."""

    rubric: JudgeConfig | None = None
    """Models and rules of the judge that asks a model."""

    cache: Path | None = None
    """File that caches the replies of the judge's models, so that no question is paid for twice."""

    panel: PanelConfig = Field(default_factory=PanelConfig)
    """Several samples of the judge that asks a model, decided by majority."""

    without_rubric: bool = False
    """Judge the task as a whole instead of by its rubric, for comparison; not possible with the offline
    judge."""
