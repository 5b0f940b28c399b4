"""A judge that does not see the rubric, for the study of what rubrics are worth (paper §3.4)."""

from __future__ import annotations

from typing import Final

import msgspec

from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Verdict
from webgym.judge.base import Judge, Pictures

PREFIX: Final = "without rubric: "
"""Prefix of the names of such judges; the name of the same judge with rubric follows."""


class WithoutRubric:
    """Replaces every task's rubric by a single fact: that the task was done.

    Everything else is the wrapped judge's (screenshots, criterion B, reference answers, models), so a
    difference from its own verdicts is due to the rubric.

    Args:
        judge: any judge that does not need the task's hidden truth.
    """

    def __init__(self, judge: Judge) -> None:
        self._judge = judge

    @property
    def name(self) -> str:
        """The wrapped judge's name, with :data:`PREFIX`."""
        return f"{PREFIX}{self._judge.name}"

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`."""
        verdict = await self._judge.judge(
            msgspec.structs.replace(task, rubric=WHOLE_TASK, truth=None), episode, pictures
        )
        return msgspec.structs.replace(verdict, judge=self.name)
