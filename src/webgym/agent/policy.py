"""The interface of a policy: it is shown an input and replies.

A policy serves many attempts at once; each attempt has a player of its own, which may remember what it
did. A model behind an endpoint needs no memory of its own, because the request holds everything; a
script does.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import Any, Final, Protocol, Self

import msgspec

from webgym.agent.config import PromptFormat
from webgym.agent.image_sizing import Size
from webgym.core.action import GRID, Mode, Space
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.trajectory import Message, Reply, Step

ORACLES: Final = frozenset({"scripted", "demonstrators"})
"""Names of policies that play solutions which no model is shown: their success says nothing of a model."""


class PolicyInput(msgspec.Struct, frozen=True):
    """Everything that is known when a reply is asked for.

    Attributes:
        task: the task. Its ``truth`` is there for scripts; no model is ever shown it.
        observation: what is to be acted on.
        messages: the request, for policies that speak the language of chat.
        images: the pictures in ``messages``, encoded, by name.
        steps: the earlier steps, oldest first, with ``changed`` filled in.
        index: number of this turn, from 0.
        budget: how many turns the attempt may take in all.
        mode: how a target is named.
        prompt_format: what the reply must consist of.
        screen: where points in the reply end, to the right and below.
        space: which actions there are.
    """

    task: Task
    observation: Observation
    messages: tuple[Message, ...]
    images: Mapping[str, bytes]
    steps: tuple[Step, ...]
    index: int
    budget: int
    mode: Mode
    prompt_format: PromptFormat
    screen: Size = (GRID, GRID)
    space: Space = "paper"


class PolicySession(Protocol):
    """A policy's part in one attempt."""

    async def reply(self, turn: PolicyInput) -> Reply:
        """The policy's reply, whole.

        Raises:
            PolicyError: there is none.
        """
        ...


class Policy(Protocol):
    """Something that can play many attempts at once. Entered before the first and left after the last.

    Attributes:
        name: what records and reports call it.
        wants_elements: whether it reads ``elements`` and ``text`` of an observation, which a server then
            has to collect.
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def wants_elements(self) -> bool: ...  # noqa: D102

    def begin(self, task: Task, seed: int) -> PolicySession:
        """A player for one attempt; everything random in it follows from ``seed``."""
        ...

    async def __aenter__(self) -> Self: ...

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class BasePolicy:
    """Base of policies that hold no resource.

    One of your own is a name and two methods::

        class Guesser(webgym.BasePolicy):
            name = "guesser"

            def begin(self, task, seed):  # may be left out where attempts remember nothing
                return self

            async def reply(self, turn):
                return webgym.Reply(text, policy=self.name)
    """

    @property
    def wants_elements(self) -> bool:
        """It does not, unless it says so: see :class:`Policy`."""
        return False

    def begin(self, task: Task, seed: int) -> Any:  # noqa: ARG002
        """The policy itself plays: for those that remember nothing of an attempt."""
        return self

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc: object) -> None:
        return None
