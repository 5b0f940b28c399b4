"""The contract of a prompt format: what requests and replies look like.

The standard formats are the agent's own (:mod:`webgym.agent.standard`). The compact ones hold the same in one
line, for very small models, and lie with these (:mod:`webgym.study.compact`): a format is imported when it is
first used.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, ClassVar, Final, NamedTuple

from webgym.agent.computer_use import Refused
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.context import AttemptPosition, Cut, Request, Round, fit_request
from webgym.agent.image_sizing import Size
from webgym.agent.parser import ParsedReply, ParseError
from webgym.agent.profile import Profile, Thinking
from webgym.agent.prompts import in_one_line
from webgym.core.action import GRID, Action, Mode, Space
from webgym.core.task import Task
from webgym.core.trajectory import Message

_PLACES: Final[dict[PromptFormat, tuple[str, str]]] = {
    "memory": ("webgym.agent.standard", "MEMORY"),
    "official": ("webgym.agent.standard", "OFFICIAL"),
    "compact": ("webgym.study.compact", "COMPACT"),
    "compact_official": ("webgym.study.compact", "COMPACT_OFFICIAL"),
}


class Turn(NamedTuple):
    """What a request is made from, as :func:`build_request` takes it."""

    task: Task
    past: Sequence[Round]
    now: AttemptPosition
    config: AgentConfig
    profile: Profile


class Format(ABC):
    """A prompt format.

    Attributes:
        has_memory: whether a reply states memory, progress and intention.
        adds_memory: whether a reply states new entries of the memory only, so that a missing one is kept.
        has_end: whether an action has an end of its own, without which the reply was cut off.
        spaces: the action spaces that it can express.
    """

    has_memory: bool
    adds_memory: ClassVar[bool]
    has_end: ClassVar[bool]
    spaces: ClassVar[Sequence[Space]]

    @abstractmethod
    def messages(self, turn: Turn, cut: Cut) -> tuple[Message, ...]:
        """The request for the next reply, without what ``cut`` leaves out."""

    @abstractmethod
    def read(self, text: str, mode: Mode, screen: Size, thinking: Thinking, space: Space) -> ParsedReply:
        """The content of a reply.

        Raises:
            Refused: it contains no valid action.
        """

    @abstractmethod
    def write(
        self,
        action: Action,
        *,
        description: str,
        memory: Mapping[str, Any],
        progress: Mapping[str, Any],
        intention: str,
        screen: Size,
    ) -> str:
        """A reply with these parts, the inverse of :meth:`read`; other parts are left out."""


@cache
def format_of(name: PromptFormat) -> Format:
    """The format of this name."""
    module, attribute = _PLACES[name]
    found: Format = getattr(importlib.import_module(module), attribute)
    return found


def build_request(
    task: Task, past: Sequence[Round], now: AttemptPosition, config: AgentConfig, profile: Profile
) -> Request:
    """The request for the next reply, shortened until the profile's limits allow it.

    Args:
        task: the task; the request states its instruction, website and files only.
        past: all earlier rounds, oldest first.
        now: the current observation and memory.
        config: window, format, limits.
        profile: mode, picture sizes, grid.

    Raises:
        PolicyError: the parts that are never left out are too long.
    """
    rounds, chosen = min(config.rounds, len(past)), format_of(config.prompt_format)
    messages, cut = fit_request(
        lambda cut: chosen.messages(Turn(task, past, now, config, profile), cut),
        profile,
        rounds=rounds,
        lines=len(past) - rounds,
        entries=len(now.memory) if chosen.has_memory else 0,
        most_tokens=config.request_tokens or profile.request_tokens,
        most_images=config.max_images or profile.max_images,
    )
    return Request(messages, cut)


def parse_reply(
    text: str,
    mode: Mode,
    prompt_format: PromptFormat,
    *,
    screen: Size = (GRID, GRID),
    thinking: Thinking = "tagged",
    space: Space = "paper",
) -> ParsedReply | ParseError:
    """Parse a reply. Never raises.

    Args:
        text: the reply.
        mode: how a target is named.
        prompt_format: the format that the prompt asked for.
        screen: largest x and y of the reply's points.
        thinking: whether the chat template opens the thinking.
        space: the action space, one that the format can express.
    """
    try:
        return format_of(prompt_format).read(text, mode, screen, thinking, space)
    except Refused as refused:
        return ParseError(refused.kind, refused.message)


def render_reply(
    action: Action,
    prompt_format: PromptFormat,
    *,
    description: str,
    memory: Mapping[str, Any] | None = None,
    progress: Mapping[str, Any] | None = None,
    intention: str = "",
    screen: Size = (GRID, GRID),
) -> str:
    """A reply in a prompt format, the inverse of the parser.

    ``intention`` and ``description`` become one line each. What the format has no place for is left out.

    Args:
        action: the action.
        prompt_format: format of the prompt that is replied to.
        description, intention: one line each.
        memory, progress: JSON objects; empty if not given.
        screen: width and height that coordinates are scaled to; 1000 each if not given.
    """
    return format_of(prompt_format).write(
        action,
        description=in_one_line(description),
        memory=memory or {},
        progress=progress or {},
        intention=in_one_line(intention),
        screen=screen,
    )
