"""Which attempts are still to be made: every sample of every task, each until it has counted."""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.rollout.records import Entry


@dataclass(frozen=True)
class Planned:
    """An attempt that is to be made.

    Attributes:
        task: the task.
        sample: which of the planned attempts at the task, from 0; a task that was drawn twice has twice
            as many.
        retry: how many attempts at this sample have been recorded before.
        failures: how many of those ended in an error of the environment or the policy. One that was
            cancelled is made again as often as it takes.
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
        """The attempt that follows if this one ended so."""
        failed = outcome is not Outcome.CANCELLED
        return replace(self, retry=self.retry + 1, failures=self.failures + failed)


class Plan:
    """The attempts of a run, handed out one by one.

    A sample is done when an attempt at it ended in an outcome that is not retried, or when as many
    attempts as allowed ended in an error.

    Args:
        tasks: in the order in which they are attempted. One that comes twice is attempted twice as often.
        samples: attempts wanted for every time that a task comes.
        retries: how often a sample is attempted again after an error.
        recorded: what a run that is resumed has on disk.
        retry_errors: begin anew with the retries of samples whose last attempt ended in an error.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        *,
        samples: int,
        retries: int,
        recorded: Iterable[Entry] = (),
        retry_errors: bool = False,
    ) -> None:
        self._retries = retries
        self._in_flight = 0
        self._done = 0
        self._changed = asyncio.Condition()
        done: dict[tuple[str, int], list[Outcome]] = {}
        for entry in sorted(recorded, key=lambda entry: entry.retry):
            done.setdefault((entry.task_id, entry.sample), []).append(entry.outcome)
        self._waiting: deque[Planned] = deque()
        taken: Counter[str] = Counter()
        for _ in range(samples):
            for task in tasks:
                sample = taken[task.id]
                taken[task.id] += 1
                planned: Planned | None = Planned(task, sample)
                outcomes = done.get((task.id, sample), [])
                for outcome in outcomes:
                    planned = self._next(planned, outcome) if planned else None
                if retry_errors and outcomes and outcomes[-1].is_retried:
                    planned = Planned(task, sample, retry=len(outcomes))
                if planned is None:
                    self._done += 1
                else:
                    self._waiting.append(planned)
        self.total = samples * len(tasks)

    def _next(self, planned: Planned, outcome: Outcome) -> Planned | None:
        """The attempt that must follow one that ended so; ``None`` if the sample is done."""
        if not outcome.is_retried:
            return None
        following = planned.after(outcome)
        return following if following.failures <= self._retries else None

    @property
    def done(self) -> int:
        """Samples that are done."""
        return self._done

    @property
    def waiting(self) -> int:
        """Attempts that nobody has taken yet."""
        return len(self._waiting)

    async def take(self) -> Planned | None:
        """The next attempt; waits while one in flight may have to be repeated. ``None`` at the end."""
        async with self._changed:
            await self._changed.wait_for(lambda: self._waiting or not self._in_flight)
            if not self._waiting:
                return None
            self._in_flight += 1
            return self._waiting.popleft()

    async def settle(self, planned: Planned, outcome: Outcome) -> None:
        """Say how an attempt that was taken ended, after it was recorded."""
        async with self._changed:
            self._in_flight -= 1
            following = self._next(planned, outcome)
            if following is None:
                self._done += 1
            else:
                self._waiting.append(following)
            self._changed.notify_all()

    async def reach(self, share: float) -> None:
        """Wait until this share of all samples is done."""
        async with self._changed:
            await self._changed.wait_for(lambda: self._done >= share * self.total)
