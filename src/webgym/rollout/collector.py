"""Many attempts at once. No barrier anywhere: a browser that is free takes the next task, an attempt
that ended is judged and recorded while its browser is already at work on another (paper §4).
"""

from __future__ import annotations

import asyncio
import time

from pydantic import BaseModel, ConfigDict, Field

from webgym.core.errors import (
    NoCapacity,
    PolicyError,
    ServerError,
    ServerUnreachable,
    WebGymError,
)
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Episode, Trajectory
from webgym.judge.base import Judge, Pictures
from webgym.rollout.attempt import Attempt, BrowserSession, Stage
from webgym.rollout.blocklist import Blocklist
from webgym.rollout.judging import Found, find
from webgym.rollout.plan import Plan, Planned
from webgym.rollout.store import RunWriter


class CollectorConfig(BaseModel):
    """How many at once, and when to give up."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    sessions: int = Field(default=16, ge=1)
    """Browser sessions, and so attempts, at the same time."""

    judges: int = Field(default=8, ge=1)
    """Episodes being judged at the same time. When all are taken, browsers wait: memory stays bounded."""

    judge_seconds: float = Field(default=300.0, gt=0)
    """How long one verdict may take before the attempt counts as unjudged."""

    judge_again: int = Field(default=2, ge=0)
    """How often attempts without a verdict are judged again, at the end of the run and when it is resumed."""

    straggler_share: float = Field(default=0.95, gt=0, le=1)
    """Once this share of the samples is done, the rest get a grace period (paper §4)."""

    straggler_seconds: float = Field(default=120.0, ge=0)
    """The grace period; then the rest are ended as truncated."""

    server_patience_seconds: float = Field(default=60.0, ge=0)
    """How long a server that does not answer, or has no free slot, is waited for before the run stops."""

    server_retry_seconds: float = Field(default=0.5, gt=0)
    """First pause before a server is asked again; each further pause is twice as long, up to eight times."""

    give_up_after: int = Field(default=20, ge=1)
    """The run stops when so many attempts in a row failed because the policy's endpoint or the server
    did: nothing is won by sending the rest after them."""

    metric_seconds: float = Field(default=5.0, gt=0)
    """How often a line is added to ``metrics.jsonl``."""


class Collector:
    """Carries out a plan.

    Args:
        stage: what attempts are made with.
        judge: turns episodes into verdicts.
        pictures: gives the judge the screenshots.
        config: limits.
        blocklist: is told of websites that kept the agent out.
    """

    def __init__(
        self,
        stage: Stage[RunWriter],
        judge: Judge,
        pictures: Pictures,
        config: CollectorConfig,
        blocklist: Blocklist | None = None,
    ) -> None:
        self._blocklist = blocklist
        self._stage = stage
        self._judge = judge
        self._pictures = pictures
        self._config = config
        self._running: set[Attempt] = set()
        self._free_judges = asyncio.Semaphore(config.judges)
        self._failed_in_a_row = 0
        self._is_late = False

    async def run(self, plan: Plan) -> None:
        """Carry out the whole plan; every attempt is on disk when this returns.

        A cancelled run records its attempts in flight as cancelled before it ends.

        Raises:
            ExceptionGroup: of the first error that the run cannot go on with: StoreError, ServerError,
                PolicyError.
        """
        progress = self._stage.progress
        progress.done = progress.earlier = plan.done
        async with asyncio.TaskGroup() as background:
            helpers = [
                background.create_task(self._end_stragglers(plan)),
                background.create_task(self._keep_metrics()),
            ]
            async with asyncio.TaskGroup() as group:
                for _ in range(min(self._config.sessions, plan.waiting)):
                    group.create_task(self._work(plan, group))
            for helper in helpers:
                helper.cancel()
        await self._stage.store.metric(progress.metric())

    async def _work(self, plan: Plan, group: asyncio.TaskGroup) -> None:
        """One browser's worth of attempts, one after the other."""
        while (planned := await plan.take()) is not None:
            attempt = Attempt(self._stage, planned)
            session = await self._open(attempt)
            try:
                await self._make(attempt, session)
            except asyncio.CancelledError:
                await asyncio.shield(self._record(attempt.episode(), Found(None, None, Outcome.CANCELLED)))
                raise
            await self._free_judges.acquire()
            group.create_task(self._conclude(plan, planned, attempt.episode()))

    async def _make(self, attempt: Attempt, session: BrowserSession) -> None:
        self._running.add(attempt)
        try:
            if self._is_late:
                attempt.truncate(self._config.straggler_seconds)
            await attempt.run(session)
        finally:
            self._running.discard(attempt)
            await session.close()

    async def _open(self, attempt: Attempt) -> BrowserSession:
        """A browser session; a server that is away for a moment is waited for."""
        config, progress = self._config, self._stage.progress
        deadline = time.monotonic() + config.server_patience_seconds
        pause = config.server_retry_seconds
        progress.move(None, "opening", attempt.planned.attempt_id)
        try:
            while True:
                try:
                    return await self._stage.client.open(attempt.options())
                except (ServerUnreachable, NoCapacity):
                    if time.monotonic() + pause > deadline:
                        raise
                    await asyncio.sleep(pause)
                    pause = min(pause * 2, 8 * config.server_retry_seconds)
        finally:
            progress.move("opening", None, attempt.planned.attempt_id)

    async def _conclude(self, plan: Plan, planned: Planned, episode: Episode) -> None:
        """Judge and record an episode, then let the plan know."""
        progress = self._stage.progress
        progress.move(None, "judging", planned.attempt_id)
        started = time.monotonic()
        try:
            judged = await find(
                self._judge, planned.task, episode, self._pictures, self._config.judge_seconds
            )
            await self._record(episode, judged, time.monotonic() - started)
        finally:
            progress.move("judging", None, planned.attempt_id)
            self._free_judges.release()
        if self._blocklist and judged.outcome is Outcome.BLOCKED and judged.verdict is not None:
            reason = judged.verdict.blocked.reason
            await asyncio.to_thread(self._blocklist.add, planned.task.website, reason)
        await plan.settle(planned, judged.outcome)
        progress.done = plan.done
        self._watch(episode)

    async def _record(self, episode: Episode, judged: Found, judge_seconds: float = 0.0) -> None:
        trajectory = Trajectory(episode, judged.outcome, judged.verdict, judged.failure, judge_seconds)
        await self._stage.store.append(trajectory)
        self._stage.progress.ended(trajectory)

    def _watch(self, episode: Episode) -> None:
        """Stop the run when only the machinery fails, one attempt after the other."""
        code = episode.failure.code if episode.failure else ""
        if code not in _MACHINERY:
            self._failed_in_a_row = 0
            return
        self._failed_in_a_row += 1
        if self._failed_in_a_row >= self._config.give_up_after and episode.failure is not None:
            raise _MACHINERY[code](
                f"{self._failed_in_a_row} attempts in a row failed: {episode.failure.message}",
                hint="what was collected is kept; mend the cause, then go on with --resume",
            )

    async def _end_stragglers(self, plan: Plan) -> None:
        await plan.reach(self._config.straggler_share)
        self._is_late = True
        for attempt in self._running:
            attempt.truncate(self._config.straggler_seconds)

    async def _keep_metrics(self) -> None:
        while True:
            await asyncio.sleep(self._config.metric_seconds)
            await self._stage.store.metric(self._stage.progress.metric())


def _all_of(cls: type[WebGymError]) -> dict[str, type[WebGymError]]:
    found = {cls.code: cls}
    for child in cls.__subclasses__():
        found |= _all_of(child)
    return found


# A policy that raises a plain PolicyError failed at one task; these failed at being reached at all.
_MACHINERY = {
    code: cls for code, cls in (_all_of(PolicyError) | _all_of(ServerError)).items() if cls is not PolicyError
}
