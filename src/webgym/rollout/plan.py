"""The attempts that remain: every sample of every task is repeated until it has an outcome that counts."""

from __future__ import annotations

import asyncio
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from webgym.core.outcome import Outcome
from webgym.core.task import Level, Task
from webgym.core.websites import site_or_text
from webgym.rollout.sharing import Claim, Claims
from webgym.store.records import Entry


@dataclass(frozen=True)
class Planned:
    """A planned attempt.

    Attributes:
        task: the task.
        sample: number of the sample of the task, from 0; a task that was drawn twice has twice as many.
        retry: number of the attempt at the sample, above every recorded one, so that attempt ids are unique.
        failures: earlier attempts at the sample that ended in an error of the environment or the policy.
            Cancelled attempts do not count and are repeated without limit.
    """

    task: Task
    sample: int
    retry: int = 0
    failures: int = 0

    @property
    def attempt_id(self) -> str:
        """Unique in a run."""
        return f"{self.task.id}#{self.sample}.{self.retry}"

    def after(self, outcome: Outcome) -> Planned:
        """The next attempt at the sample if this one ended in ``outcome``."""
        return replace(self, retry=self.retry + 1, failures=self.failures + _has_failed(outcome))


def _has_failed(outcome: Outcome) -> bool:
    return outcome.is_retried and outcome is not Outcome.CANCELLED


def _website(planned: Planned) -> str:
    return site_or_text(planned.task.website)


def _parse_id(attempt_id: str) -> tuple[str, int, int]:
    """Task, sample and retry from an attempt id; sample -1 if the id has another format."""
    task_id, _, number = attempt_id.rpartition("#")
    sample, _, retry = number.partition(".")
    is_valid = sample.isdecimal() and retry.isdecimal()
    return (task_id, int(sample), int(retry)) if is_valid else (attempt_id, -1, 0)


class Plan:
    """The attempts of a run, handed out one at a time.

    A sample is done when an attempt at it ended in an outcome that is not retried, or when as many
    attempts as allowed ended in an error.

    Args:
        tasks: in the order in which they are attempted. One that is listed twice gets twice the samples.
        samples: samples per listed task.
        retries: how often a sample is attempted again after an error.
        recorded: attempts that a resumed run has on disk.
        retired: ids of attempts whose records are damaged. They are not used again, because verdicts and
            labels refer to them.
        retry_errors: reset the retries of samples whose last attempt ended in an error.
        hardest_first: hand out the tasks with the most facts first.
        claims: for tasks shared with other collectors, whose samples count as done.
        per_website: most attempts at once at one website of the web; ``None`` for any number.

    Attributes:
        done_by_level: number of samples that are done by difficulty.
        elsewhere: samples (task id, number) that other collectors have finished or taken over.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        *,
        samples: int,
        retries: int,
        recorded: Iterable[Entry] = (),
        retired: Iterable[str] = (),
        retry_errors: bool = False,
        hardest_first: bool = False,
        claims: Claims | None = None,
        per_website: int | None = None,
    ) -> None:
        self._retries = retries
        self._per_website = per_website
        self._at: Counter[str] = Counter()
        """Attempts that have a browser, or are about to, by website."""
        self._is_closed = False
        self._claims = claims
        self._check_seconds = claims.config.look_seconds if claims else None
        self._claimed_elsewhere: list[Planned] = []
        """Attempts that other collectors have claimed; they return here if that collector dies."""
        self.elsewhere: set[tuple[str, int]] = set()
        self._in_flight = 0
        self.done_by_level: Counter[Level] = Counter()
        self._changed = asyncio.Condition()
        ended: defaultdict[tuple[str, int], list[Outcome]] = defaultdict(list)
        used_ids = [*map(_parse_id, retired)]
        for entry in recorded:
            used_ids.append((entry.task_id, entry.sample, entry.retry))
            ended[entry.task_id, entry.sample].append(entry.outcome)
        next_retry: defaultdict[tuple[str, int], int] = defaultdict(int)
        for task_id, sample, retry in used_ids:
            next_retry[task_id, sample] = max(next_retry[task_id, sample], retry + 1)
        self._waiting: deque[Planned] = deque()
        sample_counts: Counter[str] = Counter()
        for _ in range(samples):
            for task in tasks:
                sample = sample_counts[task.id]
                sample_counts[task.id] += 1
                outcomes = ended.get((task.id, sample), [])
                failures = 0 if retry_errors else sum(map(_has_failed, outcomes))
                if failures > retries or not all(outcome.is_retried for outcome in outcomes):
                    self.done_by_level[task.level] += 1
                else:
                    self._waiting.append(
                        Planned(task, sample, next_retry.get((task.id, sample), 0), failures)
                    )
        if hardest_first:
            self._waiting = deque(sorted(self._waiting, key=lambda planned: -planned.task.difficulty))
        self.total = samples * len(tasks)

    def _next(self, planned: Planned, outcome: Outcome) -> Planned | None:
        """The attempt that must follow one with this outcome; ``None`` if the sample is done."""
        if not outcome.is_retried:
            return None
        following = planned.after(outcome)
        return following if following.failures <= self._retries else None

    @property
    def done(self) -> int:
        """Number of samples that are done."""
        return self.done_by_level.total()

    @property
    def waiting(self) -> int:
        """Number of attempts that have not been handed out."""
        return len(self._waiting)

    async def take(self, *, wait: bool = True) -> Planned | None:
        """The next attempt; ``None`` at the end.

        Args:
            wait: wait while no attempt is available but one in progress may have to be repeated; otherwise
                return ``None`` then, too.
        """
        while (planned := await self._next_waiting(wait=wait)) is not None:
            claim = Claim.OURS
            if self._claims is not None:
                claim = await asyncio.to_thread(self._claims.claim, planned.task.id, planned.sample)
            if claim is Claim.OURS:
                return planned
            await self.leave(planned)
            async with self._changed:
                self._in_flight -= 1
                if claim is Claim.TAKEN:
                    self._claimed_elsewhere.append(planned)
                else:
                    self.done_by_level[planned.task.level] += 1
                    self.elsewhere.add((planned.task.id, planned.sample))
                self._changed.notify_all()
        return None

    async def more(self) -> bool:
        """Wait until an attempt can be taken; whether there is one, or this is the end."""
        async with self._changed:
            await self._until_waiting()
            return self._first_free() is not None and not self._is_closed

    async def _next_waiting(self, *, wait: bool) -> Planned | None:
        async with self._changed:
            if wait:
                await self._until_waiting()
            free = self._first_free()
            if self._is_closed or free is None:
                return None
            planned = self._waiting[free]
            del self._waiting[free]
            self._in_flight += 1
            self._at[_website(planned)] += 1
            return planned

    def _first_free(self) -> int | None:
        """Index of the first waiting attempt whose website takes another."""
        most = self._per_website
        if most is None:
            return 0 if self._waiting else None
        free = (nth for nth, it in enumerate(self._waiting) if it.task.truth or self._at[_website(it)] < most)
        return next(free, None)

    async def leave(self, planned: Planned) -> None:
        """Say that an attempt that was taken has given its browser back, once."""
        async with self._changed:
            self._at[_website(planned)] -= 1
            self._changed.notify_all()

    async def _until_waiting(self) -> None:
        """Wait, with the lock held, until an attempt waits or none can come any more."""
        while (
            not self._is_closed
            and self._first_free() is None
            and (self._in_flight or self._claimed_elsewhere)
        ):
            try:
                async with asyncio.timeout(self._check_seconds if self._claimed_elsewhere else None):
                    await self._changed.wait()
            except TimeoutError:
                self._waiting.extend(self._claimed_elsewhere)
                self._claimed_elsewhere.clear()

    async def holds(self, task_id: str, sample: int) -> bool:
        """Whether a sample that this collector claimed has not been taken over by another.

        Raises:
            StoreError: the shared disk cannot be read.
        """
        if self._claims is None or await asyncio.to_thread(self._claims.holds, task_id, sample):
            return True
        self.elsewhere.add((task_id, sample))
        return False

    async def settle(self, planned: Planned, outcome: Outcome, *, is_final: bool = False) -> None:
        """Say how an attempt that was taken ended, after it was recorded.

        Args:
            planned: the attempt.
            outcome: how it ended.
            is_final: it is not made again in this session.
        """
        following = None if is_final else self._next(planned, outcome)
        if self._claims is not None and not is_final and following is None:
            await asyncio.to_thread(self._claims.finish, planned.task.id, planned.sample)
        async with self._changed:
            self._in_flight -= 1
            if following is None:
                self.done_by_level[planned.task.level] += 1
            else:
                self._waiting.append(following)
            self._changed.notify_all()

    async def close(self) -> None:
        """Hand out no further attempts."""
        async with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def is_ending(self, share: float) -> bool:
        """Whether this share of all samples is done and no attempt is waiting to start."""
        return self.done >= share * self.total and not self._waiting
