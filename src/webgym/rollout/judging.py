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
from collections.abc import Awaitable, Callable, Iterable, Mapping
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
from webgym.rollout.config import CollectorConfig
from webgym.rollout.plan import Plan
from webgym.rollout.site_health import SiteHealth
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


@dataclass
class Rejudging:
    """Judges stored attempts again, several at the same time.

    Attributes:
        reader: of the run.
        tasks: of the run, by id.
        decide: judges one.
        record: stores what came of it.
        judges: attempts being judged at the same time.
        give_up_after: attempts in a row without a verdict after which no more are judged: the endpoint has
            failed, or the model cannot judge.
        is_stopped: whether no more are to be judged for another reason.
        failed_in_a_row: the latest attempts in a row without a verdict.
        failure: why the last of them had none.
    """

    reader: RunReader
    tasks: Mapping[str, Task]
    decide: Callable[[Task, Episode], Awaitable[JudgedEpisode]]
    record: Callable[[Trajectory, JudgedEpisode], Awaitable[object]]
    judges: int
    give_up_after: int
    is_stopped: Callable[[], bool] = lambda: False
    failed_in_a_row: int = 0
    failure: Failure | None = None

    @property
    def may_continue(self) -> bool:
        """Whether another attempt is judged."""
        return not self.is_stopped() and self.failed_in_a_row < self.give_up_after

    async def round(self, attempts: Iterable[str]) -> list[str]:
        """Judge attempts once; those that have no verdict after it."""
        waiting, unjudged = deque(attempts), list[str]()

        async def work() -> None:
            while waiting and self.may_continue:
                trajectory = await asyncio.to_thread(self.reader.trajectory, waiting.popleft())
                episode = trajectory.episode
                if (task := self.tasks.get(episode.task_id)) is None:
                    continue
                judged = await self.decide(task, episode)
                await self.record(trajectory, judged)
                if judged.outcome is not Outcome.JUDGE_ERROR:
                    self.failed_in_a_row = 0
                    continue
                unjudged.append(episode.attempt_id)
                self.failed_in_a_row, self.failure = self.failed_in_a_row + 1, judged.failure

        async with task_group() as group:
            for _ in range(min(self.judges, len(waiting))):
                group.create_task(work())
        return unjudged


async def judge_again(
    context: AttemptContext[RunWriter],
    tasks: Iterable[Task],
    judge: Judge,
    pictures: Pictures,
    config: CollectorConfig,
    health: SiteHealth | None = None,
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
        health: is told of websites that blocked the agent.
        plan: of the run. Samples that another collector has taken over are recorded as cancelled here.
        finishing: once it is set, no more attempts are judged; the rest are when the run is resumed.

    Raises:
        StoreError: a verdict cannot be stored, a record is damaged, or a disk shared with other collectors
            cannot be read.
    """
    store, progress = context.store, context.progress

    async def holds(episode: Episode) -> bool:
        return plan is None or await plan.holds(episode.task_id, episode.sample)

    async def decide(task: Task, episode: Episode) -> JudgedEpisode:
        if not await holds(episode):
            return TAKEN_OVER
        progress.move(None, "judging")
        try:
            judged = await judge_episode(judge, task, episode, pictures, config.judge_seconds)
        finally:
            progress.move("judging", None)
        return judged if await holds(episode) else TAKEN_OVER

    async def record(trajectory: Trajectory, judged: JudgedEpisode) -> None:
        if judged.outcome is Outcome.JUDGE_ERROR:
            return
        seconds = trajectory.judge_seconds + judged.seconds
        recorded = msgspec.structs.replace(judged.of(trajectory.episode), judge_seconds=seconds)
        await store.append(recorded)
        progress.judged_again(trajectory, recorded)
        if health is not None:
            await asyncio.to_thread(health.note_block, by_id[trajectory.episode.task_id].website, recorded)

    by_id = {task.id: task for task in tasks}
    waiting = [entry.attempt_id for entry in store.attempts.values() if entry.outcome is Outcome.JUDGE_ERROR]
    if not waiting:
        return
    reader = RunReader(store.path, skip_corrupt=True)
    await asyncio.to_thread(reader.refresh)
    is_finishing = finishing.is_set if finishing is not None else lambda: False
    again = Rejudging(reader, by_id, decide, record, config.judges, config.give_up_after, is_finishing)
    for _ in range(config.judge_again):
        waiting = await again.round(waiting)
        if not again.may_continue:
            return
