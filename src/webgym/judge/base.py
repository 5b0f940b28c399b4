"""The interface of judges."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Protocol, TypeAlias

from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Verdict

Pictures: TypeAlias = Callable[[str], Awaitable[bytes]]
"""Gives the bytes of a screenshot by its name."""


class Judge(Protocol):
    """Turns an episode into a verdict."""

    @property
    def name(self) -> str:
        """Name and version; stands in every verdict."""
        ...

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode.

        Args:
            task: with its rubric, and its truth if the judge needs one.
            episode: what happened; it ended in an answer or ran out of steps.
            pictures: the episode's screenshots, on demand.

        Raises:
            JudgeError: there is no clear verdict. The episode is then unjudged, never silently 0 or 1.
        """
        ...
