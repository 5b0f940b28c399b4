"""Settings of the agent: interaction mode, prompt format, context window, memory."""

from __future__ import annotations

import datetime
from typing import Final, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from webgym.core.action import Mode, Space
from webgym.settings import Settings

PromptFormat: TypeAlias = Literal["memory", "official", "compact", "compact_official"]
"""``memory``: Memory, Progress, Intention, Action, tool call. ``official``: the last two (paper §5). The
compact ones say the same in a line of words, for very small models (:mod:`webgym.agent.compact`)."""

WITH_MEMORY: Final = frozenset[PromptFormat]({"memory", "compact"})
"""The formats in which a reply states memory, progress and intention."""


class AgentConfig(Settings):
    """How observations become requests and replies become actions (paper §5, appendix C)."""

    profile: str | None = None
    """Family of the policy's model: image sizes, coordinate grid, think tags, sampling
    (:mod:`webgym.agent.profiles`). By default chosen by the model's name, else ``generic``."""

    mode: Mode | None = None
    """Interaction mode: points (``coordinates``) or numbers of marked elements (``marks``, Set-of-Marks). By
    default the profile's: points except for GPT-class models."""

    prompt_format: PromptFormat = "memory"
    """What a reply consists of. The memory prompt is worth three points of success (paper §5)."""

    actions: Space = "paper"
    """``paper``: the paper's seven actions. ``extended``: also hover, key chords, double, right and modified
    clicks, drags, scrolling a box that is named, to all four sides, typing without Enter, and choosing files
    of the task; in marks mode, points for places that carry no number."""

    rounds: int = Field(default=4, ge=0, le=50)
    """Past rounds that are shown whole, as screenshot and reply, before the current screenshot. The paper
    has 3, its authors' code 4. What is older is known from the memory and a list of actions alone."""

    today: datetime.date | None = None
    """The date that the agent is told; none is named by default, so that a run can be repeated."""

    image_max_side: int | None = Field(default=None, ge=64)
    """Longest side, in pixels, of the pictures that are sent; larger ones are scaled down. By default a
    picture goes to the profile's rule as it was taken."""

    request_tokens: int | None = Field(default=None, ge=1)
    """Longest request, in tokens by estimate; what is longer is trimmed, oldest screenshots first. By
    default what the profile says. Set it to the context length of the endpoint less the longest reply."""

    max_images: int | None = Field(default=None, ge=1)
    """Pictures in a request at most, where an endpoint limits them. By default what the profile says."""

    memory_max_chars: int = Field(default=8000, ge=0)
    """How much memory, as JSON text, is carried forward. What would go beyond is not taken in, and the
    agent is told."""

    summary_line_max_chars: int = Field(default=200, ge=20)
    """Longest description of one older action in the list of actions."""

    @model_validator(mode="after")
    def _has_words_for_its_actions(self) -> Self:
        if self.actions == "extended" and self.prompt_format.startswith("compact"):
            raise ValueError(f"the prompt format {self.prompt_format} has the paper's actions only")
        return self
