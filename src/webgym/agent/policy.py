"""The interface of a policy: it receives an input and replies.

A policy serves many attempts at once; each attempt has a session of its own, which may have state. A model
behind an endpoint needs none, because the request contains everything; a script does.
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
from webgym.llm.config import Sampling

ORACLES: Final = frozenset({"scripted", "demonstrators"})
"""Names of policies that know the solutions of tasks, so that their success rate says nothing about
models."""


class PolicyInput(msgspec.Struct, frozen=True):
    """The input of a policy for one turn.

    Attributes:
        task: the task. Its ``truth`` is for scripts; no model ever sees it.
        observation: the current observation.
        messages: the request, for policies that are chat models.
        images: the pictures in ``messages``, encoded, by name.
        steps: the earlier steps, oldest first, with ``changed`` set.
        index: number of this turn, from 0.
        budget: total number of turns that the attempt may take.
        mode: how a target is named.
        prompt_format: the format that the reply must have.
        screen: largest x and y of points in the reply.
        space: the action space.
        sampling: parameters over the policy's own, for policies that sample.
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
    sampling: Sampling | None = None


class PolicySession(Protocol):
    """A policy's session for one attempt."""

    async def reply(self, turn: PolicyInput) -> Reply:
        """The policy's complete reply.

        Args:
            turn: the observation, and the request that WebGym's agent would send.

        Raises:
            PolicyError: the policy failed to reply.
        """
        ...


class Policy(Protocol):
    """A policy that can serve many attempts at once. Entered before the first and exited after the last.

    Attributes:
        name: its name in records and reports.
        wants_elements: whether it needs ``elements`` and ``text`` of an observation, which the server then
            collects.
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def wants_elements(self) -> bool: ...  # noqa: D102

    def begin(self, task: Task, seed: int) -> PolicySession:
        """A session for one attempt.

        Args:
            task: the task to attempt.
            seed: seed of everything random in the session.
        """
        ...

    async def __aenter__(self) -> Self: ...

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class BasePolicy:
    """Base of policies, which by default have no resource to be opened and closed.

    A policy of your own is a name and two methods::

        class Guesser(webgym.BasePolicy):
            name = "guesser"

            def begin(self, task, seed):  # may be left out if sessions have no state
                return self

            async def reply(self, turn):
                return webgym.Reply(text, policy=self.name)
    """

    @property
    def wants_elements(self) -> bool:
        """``False`` unless overridden: see :class:`Policy`."""
        return False

    def begin(self, task: Task, seed: int) -> Any:  # noqa: ARG002
        """The policy itself, which suits policies whose sessions have no state.

        Args:
            task: the task to attempt.
            seed: seed of everything random in the session.
        """
        return self

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc: object) -> None:
        return None
