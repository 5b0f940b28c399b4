"""Judges one episode; if the judge fails, the attempt gets the outcome ``judge_error``."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from typing import Final

from webgym.core.background import is_cancelled
from webgym.core.errors import JudgeError
from webgym.core.outcome import Outcome, outcome_of
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Failure, Trajectory
from webgym.core.typed import refuse_untyped
from webgym.core.verdict import Verdict
from webgym.judge.base import Judge, Pictures
from webgym.llm.health import collect_cut_off


@dataclass(frozen=True)
class JudgedEpisode:
    """An episode with its outcome and verdict.

    Attributes:
        verdict: the verdict; ``None`` if there is none.
        failure: why the judge gave none; ``None`` if the episode was not judged.
        outcome: outcome of the attempt.
        seconds: how long the judge took.
    """

    verdict: Verdict | None
    failure: Failure | None
    outcome: Outcome
    seconds: float = 0.0

    def of(self, episode: Episode) -> Trajectory:
        """The record of the episode, which must be the one that was judged."""
        return Trajectory(episode, self.outcome, self.verdict, self.failure, self.seconds)


TAKEN_OVER: Final = JudgedEpisode(
    None,
    Failure("taken_over", "another collector thought this one dead, and has the task"),
    Outcome.CANCELLED,
)
"""The result for an episode whose sample was taken over by another collector."""


async def judge_episode(
    judge: Judge, task: Task, episode: Episode, pictures: Pictures, seconds: float
) -> JudgedEpisode:
    """Judge an episode, with a deadline in seconds; one that did not end regularly is not judged."""
    if not episode.ending.is_regular:
        return JudgedEpisode(None, None, outcome_of(episode.ending, None))
    started = time.monotonic()
    verdict = failure = None
    delays: list[str] = []
    try:
        with collect_cut_off() as delays:
            async with asyncio.timeout(seconds):
                given = await judge.judge(task, episode, pictures)
        refuse_untyped(given, Verdict)  # one that cannot be stored would end the run
        if given.reward is None and not given.blocked.passed:  # from a user's own judge
            raise JudgeError(f"{judge.name} gave no reward, and says that the attempt was not blocked")
        verdict, outcome = given, outcome_of(episode.ending, given)
    except (Exception, asyncio.CancelledError) as error:
        if is_cancelled(error):
            raise
        # The attempt remains without a verdict, and its record says why.
        judge_error = _as_judge_error(error, seconds, delays)
        failure = Failure(judge_error.code, judge_error.message)
        outcome = outcome_of(episode.ending, judge_error)
    return JudgedEpisode(verdict, failure, outcome, time.monotonic() - started)


def _as_judge_error(error: BaseException, seconds: float, delays: list[str]) -> JudgeError:
    if isinstance(error, JudgeError):
        return error
    if isinstance(error, TimeoutError):
        why = f": {'; '.join(dict.fromkeys(delays))}" if delays else ""
        return JudgeError(f"no verdict within {seconds:g} s{why}")
    return JudgeError(f"the judge failed: {type(error).__name__}: {error}")
