"""Settings of the agent: interaction mode, prompt format, context window, memory."""

from __future__ import annotations

import datetime
from typing import Literal, Self, TypeAlias

from pydantic import Field, model_validator

from webgym.core.action import Mode, Space
from webgym.core.settings import Settings
from webgym.llm.config import Sampling

PromptFormat: TypeAlias = Literal["memory", "official", "compact", "compact_official"]
"""``memory``: Memory, Progress, Intention, Action, tool call. ``official``: the last two (paper §5). The
compact formats hold the same in one line, for very small models (:mod:`webgym.study.compact`)."""


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
    clicks, holding the button down, drags, scrolling a given element, scrolling left and right, typing
    without Enter, uploading files of the task, and answering dialogs; in marks mode, coordinates for places
    that carry no number."""

    sampling: Sampling | None = None
    """Sampling parameters of this run's replies, over those that the policy has (``evaluation.sampling`` of a
    training sets it)."""

    rounds: int = Field(default=4, ge=0, le=50)
    """Past rounds that are shown in full, as screenshot and reply, before the current screenshot. The paper
    has 3, its authors' code 4. Older rounds appear only in the memory and a list of actions."""

    today: datetime.date | None = None
    """The date stated in the prompt; by default none, so that a run is reproducible."""

    image_max_side: int | None = Field(default=None, ge=64)
    """Longest side, in pixels, of the pictures that are sent; larger ones are scaled down before the
    profile's rule is applied. By default there is no limit."""

    request_tokens: int | None = Field(default=None, ge=1)
    """Longest request, in estimated tokens; longer ones are trimmed, oldest screenshots first. By default
    the profile's. Set it to the context length of the endpoint less the longest reply."""

    max_images: int | None = Field(default=None, ge=1)
    """Most pictures in a request, if the endpoint limits them. By default the profile's."""

    memory_max_chars: int = Field(default=8000, ge=0)
    """Largest size of the memory, in characters of JSON. Entries that would exceed it are refused, and the
    next prompt says so."""

    @model_validator(mode="after")
    def _format_supports_actions(self) -> Self:
        if self.actions == "extended" and self.prompt_format.startswith("compact"):
            raise ValueError(f"the prompt format {self.prompt_format} supports the paper's actions only")
        return self
