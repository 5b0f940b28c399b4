"""A judge that does not see the rubric, for the study of what rubrics are worth (paper §3.4)."""

from __future__ import annotations

from typing import Final

import msgspec

from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Verdict
from webgym.judge.base import Judge, Pictures

PREFIX: Final = "without rubric: "
"""How the names of such judges begin; what follows is the name of the same judge with rubric."""


class WithoutRubric:
    """Gives a judge every task with one fact in place of its rubric: that the task was done.

    All else is the judge's own (screenshots, criterion B, reference answers, models), so that a difference
    from the judge itself is the rubric's doing.

    Args:
        judge: any judge that needs no more than the rubric's text.
    """

    def __init__(self, judge: Judge) -> None:
        self._judge = judge

    @property
    def name(self) -> str:
        """That of the judge, marked."""
        return f"{PREFIX}{self._judge.name}"

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`."""
        verdict = await self._judge.judge(
            msgspec.structs.replace(task, rubric=WHOLE_TASK, truth=None), episode, pictures
        )
        return msgspec.structs.replace(verdict, judge=self.name)
