"""Judging one episode: whatever the judge does, the attempt gets an outcome."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Final

from webgym.core.errors import JudgeError
from webgym.core.outcome import Ending, Outcome, outcome_of
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Failure, Trajectory
from webgym.core.verdict import Verdict
from webgym.judge.base import Judge, Pictures

JUDGED = frozenset({Ending.ANSWERED, Ending.BUDGET_SPENT})
"""How an episode ends that came to an end of its own."""


def is_judged(trajectory: Trajectory) -> bool:
    """Whether an attempt has, or may yet get, a verdict: it ended of its own, and is its sample's last."""
    return trajectory.episode.ending in JUDGED and not trajectory.outcome.is_retried


@dataclass(frozen=True)
class JudgedEpisode:
    """An episode with its outcome and verdict.

    Attributes:
        verdict: ``None`` if there is none.
        failure: why not, if it was asked for.
        outcome: of the attempt.
    """

    verdict: Verdict | None
    failure: Failure | None
    outcome: Outcome


TAKEN_OVER: Final = JudgedEpisode(
    None,
    Failure("taken_over", "another collector thought this one dead, and has the task"),
    Outcome.CANCELLED,
)
"""What becomes of an episode whose sample is another collector's by now."""


async def judge_episode(
    judge: Judge, task: Task, episode: Episode, pictures: Pictures, seconds: float
) -> JudgedEpisode:
    """Judge an episode within so many seconds; one that did not end of its own is not judged."""
    if episode.ending not in JUDGED:
        return JudgedEpisode(None, None, outcome_of(episode.ending, None))
    try:
        async with asyncio.timeout(seconds):
            verdict = await judge.judge(task, episode, pictures)
    except Exception as error:
        # Whatever kept the judge from a verdict, the attempt is unjudged and says why.
        failure = _as_judge_error(error, seconds)
        return JudgedEpisode(
            None, Failure(failure.code, failure.message), outcome_of(episode.ending, failure)
        )
    return JudgedEpisode(verdict, None, outcome_of(episode.ending, verdict))


def _as_judge_error(error: Exception, seconds: float) -> JudgeError:
    if isinstance(error, JudgeError):
        return error
    if isinstance(error, TimeoutError):
        return JudgeError(f"no verdict within {seconds:g} s")
    return JudgeError(f"the judge failed: {type(error).__name__}: {error}")
