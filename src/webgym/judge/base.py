"""The interface of judges, and the score that all of them give."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Protocol, TypeAlias

from webgym.core.errors import JudgeError
from webgym.core.task import Rubric, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import FactJudgement, Verdict

Pictures: TypeAlias = Callable[[str], Awaitable[bytes]]
"""Returns the bytes of a screenshot, given its name (the hash of its pixels)."""


async def no_picture(name: str) -> bytes:
    """:data:`Pictures` of an episode whose screenshots were not kept: for judges that read none."""
    raise JudgeError(f"the picture {name} is not available")


class Judge(Protocol):
    """Turns an episode into a verdict."""

    @property
    def name(self) -> str:
        """Name and version of the judge; recorded in every verdict."""
        ...

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode.

        Args:
            task: the attempted task, with its rubric, and with its truth if the judge needs one.
            episode: the recorded steps; it ended in an answer or ran out of steps.
            pictures: returns the episode's screenshots on demand.

        Returns:
            The verdict: the reward (0, 1, or ``None`` for a blocked attempt) and the reasons.

        Raises:
            JudgeError: there is no clear verdict. The episode is then unjudged; its reward is never guessed.
        """
        ...


def score_of(rubric: Rubric, facts: Sequence[FactJudgement]) -> float | None:
    """The share of the rubric's facts that hold, 0 to 1; ``None`` unless every fact has a clear verdict.

    It supplements the binary reward and never replaces it: facts do not say whether the answer is right.
    """
    passed = {(fact.group, fact.index): fact.judgement.passed for fact in facts}
    expected = [(group.id, index) for group, index, _ in rubric.facts()]
    if any(passed.get(fact) is None for fact in expected):
        return None
    return sum(passed[fact] is True for fact in expected) / len(expected)
