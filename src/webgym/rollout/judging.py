"""Judges one episode; if the judge fails, the attempt gets the outcome ``judge_error``.

Attempts without a verdict are judged again, at the end of a run and when it is resumed. The browser's part is
on disk and is not repeated. A judge that fails on a small share of questions fails more often for tasks with
many facts, and more often for successes than for failures (which a single clear failure decides): attempts
left without a verdict would bias the success rate.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import msgspec

from webgym.core.background import is_cancelled, task_group
from webgym.core.errors import JudgeError
from webgym.core.outcome import Outcome, outcome_of
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Failure, Trajectory, refuse_untyped
from webgym.core.verdict import Verdict
from webgym.judge.base import Judge, Pictures
from webgym.llm.health import collect_cut_off
from webgym.rollout.attempt import AttemptContext
from webgym.rollout.blocklist import Blocklist
from webgym.rollout.config import CollectorConfig
from webgym.rollout.plan import Plan
from webgym.store.runs import RunReader, RunWriter


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


async def judge_again(
    context: AttemptContext[RunWriter],
    tasks: Iterable[Task],
    judge: Judge,
    pictures: Pictures,
    config: CollectorConfig,
    blocklist: Blocklist | None = None,
    plan: Plan | None = None,
    finishing: asyncio.Event | None = None,
) -> None:
    """Judge all attempts without a verdict again, and record the verdicts.

    An attempt is judged at most ``config.judge_again`` times. After ``config.give_up_after`` in a row without
    a verdict this stops: the endpoint has failed, or the model cannot judge.

    Args:
        context: of the run; its store holds the attempts.
        tasks: of the run.
        judge: the same as in the collection.
        pictures: reads screenshots for the judge.
        config: limits.
        blocklist: gets the websites that blocked the agent.
        plan: of the run. Samples that another collector has taken over are recorded as cancelled here.
        finishing: once it is set, no more attempts are judged; the rest are when the run is resumed.

    Raises:
        StoreError: a verdict cannot be stored, a record is damaged, or a disk shared with other collectors
            cannot be read.
    """
    by_id = {task.id: task for task in tasks}
    again = _Rejudging(context, by_id, judge, pictures, config, blocklist, plan, finishing)
    for _ in range(config.judge_again):
        if not await again.round():
            return


@dataclass
class _Rejudging:
    context: AttemptContext[RunWriter]
    tasks: Mapping[str, Task]
    judge: Judge
    pictures: Pictures
    config: CollectorConfig
    blocklist: Blocklist | None
    plan: Plan | None
    finishing: asyncio.Event | None
    failed_in_a_row: int = 0

    async def round(self) -> bool:
        """Judge all attempts without a verdict once; returns whether another round may help."""
        entries = self.context.store.attempts.values()
        waiting = deque(entry.attempt_id for entry in entries if entry.outcome is Outcome.JUDGE_ERROR)
        if not waiting or not self._may_continue:
            return False
        reader = RunReader(self.context.store.path, skip_corrupt=True)
        await asyncio.to_thread(reader.refresh)
        async with task_group() as group:
            for _ in range(min(self.config.judges, len(waiting))):
                group.create_task(self._work(waiting, reader))
        return self._may_continue

    @property
    def _may_continue(self) -> bool:
        is_finishing = self.finishing is not None and self.finishing.is_set()
        return not is_finishing and self.failed_in_a_row < self.config.give_up_after

    async def _work(self, waiting: deque[str], reader: RunReader) -> None:
        while waiting and self._may_continue:
            trajectory = await asyncio.to_thread(reader.trajectory, waiting.popleft())
            task = self.tasks.get(trajectory.episode.task_id)
            if task is None:
                continue
            result = await self._judge_task(task, trajectory.episode)
            if result.outcome is Outcome.JUDGE_ERROR:
                self.failed_in_a_row += 1
                continue
            self.failed_in_a_row = 0
            judged = await self._record(trajectory, result)
            if self.blocklist is not None:
                await asyncio.to_thread(self.blocklist.note, task.website, judged)

    async def _judge_task(self, task: Task, episode: Episode) -> JudgedEpisode:
        if not await self._holds(episode):
            return TAKEN_OVER
        self.context.progress.move(None, "judging")
        try:
            seconds = self.config.judge_seconds
            result = await judge_episode(self.judge, task, episode, self.pictures, seconds)
        finally:
            self.context.progress.move("judging", None)
        return result if await self._holds(episode) else TAKEN_OVER

    async def _holds(self, episode: Episode) -> bool:
        return self.plan is None or await self.plan.holds(episode.task_id, episode.sample)

    async def _record(self, trajectory: Trajectory, result: JudgedEpisode) -> Trajectory:
        judged = msgspec.structs.replace(
            trajectory,
            outcome=result.outcome,
            verdict=result.verdict,
            judge_failure=result.failure,
            judge_seconds=trajectory.judge_seconds + result.seconds,
        )
        await self.context.store.append(judged)
        self.context.progress.judged_again(trajectory, judged)
        return judged
