"""Many attempts at once, one coroutine each.

``async``, the paper's way (§4), has no barrier anywhere: a browser that is free takes the next task, an
attempt that ended is judged and recorded while its browser is already at work on another. The paper's
baselines differ from it in their schedule alone, with the same agent, server and judge.
"""

from __future__ import annotations

import asyncio
import math
import time
from array import array
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from typing import Final

import numpy as np

from webgym.core.calls import LoopLag
from webgym.core.errors import (
    BrowserCrashed,
    BrowserTimeout,
    EgressRefused,
    JudgeError,
    PolicyError,
    ServerError,
    StoreError,
    error_from_code,
)
from webgym.core.outcome import Ending, Outcome, outcome_of
from webgym.core.trajectory import Episode, Failure, Trajectory
from webgym.judge.base import Judge, Pictures
from webgym.rollout.attempt import Attempt, AttemptContext
from webgym.rollout.config import CollectorConfig
from webgym.rollout.driver import BrowserSession
from webgym.rollout.judging import TAKEN_OVER, JudgedEpisode, judge_episode
from webgym.rollout.plan import Plan, Planned
from webgym.rollout.progress import queues_of
from webgym.rollout.sessions import Places, is_of_server, longest_pause, patiently
from webgym.rollout.site_health import SiteHealth
from webgym.store.runs import RunWriter

_RESUMED: Final = "what was collected is kept; fix the cause, then resume with --resume"


class Collector:
    """Carries out a plan.

    Args:
        context: what attempts are made with.
        judge: turns episodes into verdicts.
        pictures: gives the judge the screenshots.
        config: limits.
        health: is told of what attempts found at their websites.
        places: shared with other runs; ``None`` for ``config.sessions`` of its own.
    """

    def __init__(
        self,
        context: AttemptContext[RunWriter],
        judge: Judge,
        pictures: Pictures,
        config: CollectorConfig,
        health: SiteHealth | None = None,
        places: Places | None = None,
    ) -> None:
        self._health = health
        self._context = context
        self._judge = judge
        self._pictures = pictures
        self._config = config
        self._running: set[Attempt] = set()
        self._last_held = 0.0
        """When a browser was last given back."""
        self._server_failed = -math.inf
        """When the server last ended an attempt."""
        self._are_shared = places is not None
        self._places = places or Places(asyncio.Semaphore(config.sessions))
        self._unrecorded = asyncio.Semaphore(config.judges + config.backlog)
        self._failed_in_a_row = self._unjudged_in_a_row = 0
        self._failing_since = self._unjudged_since = 0.0
        self._lengths = array("d")
        """Wall time of the attempts that came to an end of their own, seconds."""
        self._late: tuple[float, float] | None = None
        """When the end of the run began, and how long an attempt may fairly take."""

    async def run(self, plan: Plan, finishing: asyncio.Event | None = None) -> None:
        """Carry out the whole plan; every attempt is on disk when this returns.

        A cancelled run records its attempts in flight before it ends: as cancelled, or those that waited for
        a verdict as without one.

        Args:
            plan: what to do.
            finishing: once it is set, no attempt is begun; those that run come to their end.

        Raises:
            ExceptionGroup: of the first error that the run cannot continue with: StoreError, ServerError,
                PolicyError, JudgeError.
        """
        progress, lag = self._context.progress, LoopLag()
        progress.done = progress.earlier = plan.done
        progress.done_by_level = plan.done_by_level
        progress.calls, progress.lag = self._context.calls, lag
        progress.queues = partial(queues_of, self._context.calls)
        async with asyncio.TaskGroup() as background:
            helpers = [background.create_task(lag.watch()), background.create_task(self._keep_metrics())]
            if finishing is not None:
                helpers.append(background.create_task(_close(plan, finishing)))
            async with asyncio.TaskGroup() as group:
                if self._config.is_grouped:
                    await self._in_groups(plan, group)
                else:
                    await self._continuously(plan, group)
            for helper in helpers:
                helper.cancel()
        await self._context.store.metric(progress.metric())

    # --- schedules --------------------------------------------------------------------------------------

    async def _continuously(self, plan: Plan, group: asyncio.TaskGroup) -> None:
        """Whoever ends makes room for the next."""
        while await plan.more():  # without a place: another run may have work for it
            await self._places.free.acquire()
            if (planned := await plan.take(wait=False)) is None:
                self._places.free.release()
                continue
            if not plan.waiting:
                self._places.spare.set()
            group.create_task(self._episode(plan, planned))

    async def _in_groups(self, plan: Plan, group: asyncio.TaskGroup) -> None:
        """All begin together, when the last of those before has ended."""
        free = self._places.free
        while await plan.more():
            for _ in range(self._config.sessions):
                await free.acquire()
            begun = list[Planned]()
            while len(begun) < self._config.sessions and (more := await plan.take(wait=False)) is not None:
                begun.append(more)
            for planned in begun:
                group.create_task(self._episode(plan, planned))
            for _ in range(self._config.sessions - len(begun)):
                free.release()

    # --- one episode ------------------------------------------------------------------------------------

    async def _episode(self, plan: Plan, planned: Planned) -> None:
        """An attempt from its browser to its record. Its place is free for another before it is judged."""
        attempt = Attempt(self._context, planned)
        try:
            await self._attempt(plan, attempt)
            episode = attempt.episode()
            async with self._recorded_if_stopped(episode):
                await self._unrecorded.acquire()
        finally:
            self._places.free.release()
            await plan.leave(planned)
        try:
            await self._conclude(plan, attempt, episode)
        finally:
            self._unrecorded.release()

    async def _attempt(self, plan: Plan, attempt: Attempt) -> None:
        """Make the attempt. If no page can be made for it alone, it ends like one that had begun."""
        try:
            session = await self._open(attempt)
        except (BrowserCrashed, BrowserTimeout) as error:
            attempt.fail(error)
            return
        try:
            self._running.add(attempt)
            self._end_stragglers(plan, attempt)
            try:
                await attempt.run(session)
            finally:
                self._running.discard(attempt)
                self._last_held = time.monotonic()
                await session.close()
        except asyncio.CancelledError:
            episode = attempt.episode()
            await self._record(episode, _unjudged(episode))
            raise
        if attempt.failure is not None and is_of_server(error_from_code(attempt.failure.code, "")):
            self._server_failed = time.monotonic()

    async def _open(self, attempt: Attempt) -> BrowserSession:
        """A browser session; a server or an offline web that is away for a moment is waited for.

        Nothing has begun, so that no sample is used up. If none came in time, the run stops. Waiting for a
        slot does not count while this run itself holds some.
        """
        progress = self._context.progress

        def tell(problem: str) -> None:
            progress.browser_problem = problem and f"attempts wait for a browser: {problem}"

        def held() -> float:
            return time.monotonic() if self._running else self._last_held

        async def open_session() -> BrowserSession:
            await attempt.reach_site_state()
            return await self._context.client.open(attempt.options())

        progress.move(None, "opening", attempt.planned.attempt_id)
        try:
            if attempt.planned.retry:  # at once, it could end as before
                rest = self._server_failed + longest_pause(self._config) - time.monotonic()
                await asyncio.sleep(max(0.0, rest))
            return await patiently(open_session, self._config, tell=tell, held=held)
        finally:
            progress.move("opening", None, attempt.planned.attempt_id)

    async def _conclude(self, plan: Plan, attempt: Attempt, episode: Episode) -> None:
        """Judge and record an episode, then let the plan know."""
        planned, progress = attempt.planned, self._context.progress
        progress.move(None, "judging", planned.attempt_id)
        try:
            async with self._recorded_if_stopped(episode):
                judged = await self._find(planned, episode)
                unjudged = self._count_unjudged(judged)
                if is_lost := not await plan.holds(planned.task.id, planned.sample):
                    judged = TAKEN_OVER
            recorded = await self._record(episode, judged)
        finally:
            progress.move("judging", None, planned.attempt_id)
        if self._health is not None:
            await asyncio.to_thread(self._health.note, planned.task.website, recorded)
        if episode.ending.is_regular:
            self._lengths.append(episode.seconds)
        is_final = is_lost or episode.ending is Ending.STRAGGLER or _is_futile(episode)
        await plan.settle(planned, judged.outcome, is_final=is_final)
        progress.done = plan.done
        self._end_stragglers(plan)
        self._watch(attempt, attempt.started + episode.seconds)
        if unjudged == self._config.give_up_after and judged.failure is not None:
            why = f"{unjudged} attempts in a row had no verdict: {judged.failure.message}"
            raise JudgeError(why, hint=_RESUMED)

    async def _find(self, planned: Planned, episode: Episode) -> JudgedEpisode:
        """What becomes of an episode."""
        if not episode.ending.is_regular:
            return _unjudged(episode)
        async with self._context.calls["judge"].turn():
            seconds = self._config.judge_seconds
            return await judge_episode(self._judge, planned.task, episode, self._pictures, seconds)

    async def _record(self, episode: Episode, judged: JudgedEpisode) -> Trajectory:
        trajectory = judged.of(episode)
        try:
            await self._context.store.append(trajectory)
        except asyncio.CancelledError:
            self._context.progress.ended(trajectory)  # it is on disk: writing is carried through
            raise
        self._context.progress.ended(trajectory)
        return trajectory

    @asynccontextmanager
    async def _recorded_if_stopped(self, episode: Episode) -> AsyncIterator[None]:
        """Record an episode if the run is stopped in the block. What its browser did is not done again: a
        resumed run judges it."""
        try:
            yield
        except (asyncio.CancelledError, StoreError):
            await self._record(episode, _unjudged(episode))
            raise

    def _watch(self, attempt: Attempt, ended: float) -> None:
        """Stop the run when only the machinery fails, one attempt after the other.

        Of the attempts that one event ends together, such as a restart of the server, one counts.

        Args:
            attempt: one that is recorded.
            ended: when it ended, on the monotonic clock. A slow disk records it later.
        """
        failed, code, message = self._failed_in_a_row + 1, "", ""
        if attempt.failure is not None:
            code, message = attempt.failure.code, attempt.failure.message
        error = error_from_code(code, f"{failed} attempts in a row failed: {message}", _RESUMED)
        # A policy that raises a plain PolicyError failed at one task; the others could not be reached at all.
        is_machinery = isinstance(error, PolicyError | ServerError) and type(error) is not PolicyError
        if not is_machinery:
            self._failed_in_a_row = 0
            return
        if failed == 1:
            self._failing_since = ended
        elif attempt.started < self._failing_since:
            return
        self._failed_in_a_row = failed
        if failed == self._config.give_up_after:  # others that end now need not say so again
            raise error

    def _count_unjudged(self, judged: JudgedEpisode) -> int:
        """The number of attempts in a row without a verdict, if this is one. Of those that were being judged
        when the first had none, one counts."""
        if judged.failure is None:
            self._unjudged_in_a_row *= judged.verdict is None  # or it was not judged at all
            return 0
        now = time.monotonic()
        if self._unjudged_in_a_row == 0:
            self._unjudged_since = now
        elif now - judged.seconds < self._unjudged_since:
            return 0
        self._unjudged_in_a_row += 1
        return self._unjudged_in_a_row

    # --- the end of a run, and figures ------------------------------------------------------------------

    def _end_stragglers(self, plan: Plan, begun: Attempt | None = None) -> None:
        """See whether the end of the run has begun, and give those that run their time.

        Whoever begins late gets as much time as the others needed; without others, all that it needs. Where
        places are shared, they run on: what else there is to do need not wait for them.
        """
        share, hurried = self._config.straggler_share, {begun} if begun else set()
        if self._are_shared:
            if plan.is_ending(share):
                self._places.enough.set()
            return
        if self._late is None and share < 1 and self._lengths and plan.is_ending(share):
            self._late = time.monotonic(), float(np.quantile(self._lengths, share))
            hurried = self._running
        if self._late is not None:
            since, fair_seconds = self._late
            for attempt in hurried:
                due = max(since, attempt.started + fair_seconds) + self._config.straggler_seconds
                attempt.end_as_straggler(due - time.monotonic())

    async def _keep_metrics(self) -> None:
        while True:
            await asyncio.sleep(self._config.metric_seconds)
            await self._context.store.metric(self._context.progress.metric())


async def _close(plan: Plan, finishing: asyncio.Event) -> None:
    await finishing.wait()
    await plan.close()


def _is_futile(episode: Episode) -> bool:
    """Whether another attempt now would find the same website dead; or would be the agent's second chance for
    having answered before a page that may have lacked parts."""
    is_dead = episode.arrival is not None and episode.arrival.state == "dead"
    return is_dead or (episode.failure is not None and episode.failure.code == EgressRefused.code)


def _unjudged(episode: Episode) -> JudgedEpisode:
    """What becomes of an episode that had ended, or had not, when the run was stopped."""
    if not episode.ending.is_regular:
        return JudgedEpisode(None, None, outcome_of(episode.ending, None))
    failure = Failure("judge_error", "the run was stopped before there was a verdict")
    return JudgedEpisode(None, failure, Outcome.JUDGE_ERROR)
