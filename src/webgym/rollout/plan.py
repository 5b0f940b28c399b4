"""The attempts still to be made: every sample of every task, each until it has an outcome that counts."""

from __future__ import annotations

import asyncio
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.rollout.records import Entry
from webgym.rollout.sharing import Claim, Claims


@dataclass(frozen=True)
class Planned:
    """An attempt that is to be made.

    Attributes:
        task: the task.
        sample: which of the planned attempts at the task, from 0; a task that was drawn twice has twice
            as many.
        retry: above that of every attempt at this sample that was ever recorded: no two have one name.
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
        return replace(self, retry=self.retry + 1, failures=self.failures + _has_failed(outcome))


def _has_failed(outcome: Outcome) -> bool:
    return outcome.is_retried and outcome is not Outcome.CANCELLED


def _number(attempt_id: str) -> tuple[str, int, int]:
    """Task, sample and retry of an attempt, by its name; a sample that none has, if it is no name of ours."""
    task_id, _, number = attempt_id.rpartition("#")
    sample, _, retry = number.partition(".")
    is_ours = sample.isdecimal() and retry.isdecimal()
    return (task_id, int(sample), int(retry)) if is_ours else (attempt_id, -1, 0)


class Plan:
    """The attempts of a run, handed out one by one.

    A sample is done when an attempt at it ended in an outcome that is not retried, or when as many
    attempts as allowed ended in an error.

    Args:
        tasks: in the order in which they are attempted. One that comes twice is attempted twice as often.
        samples: attempts wanted for every time that a task comes.
        retries: how often a sample is attempted again after an error.
        recorded: what a run that is resumed has on disk.
        retired: names of attempts that were recorded and cannot be trusted any more. They are not given
            again: verdicts and labels go by them.
        retry_errors: begin anew with the retries of samples whose last attempt ended in an error.
        hardest_first: hand out the tasks with the most facts first.
        claims: where the tasks are shared with other collectors; what they do counts as done.
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
    ) -> None:
        self._retries = retries
        self._is_closed = False
        self._claims = claims
        self._look_seconds = claims.config.look_seconds if claims else None
        self._taken: list[Planned] = []
        """What other collectors have claimed; they may die."""
        self.elsewhere: set[tuple[str, int]] = set()
        """Samples, by task and number, that other collectors have done or taken over."""
        self._in_flight = 0
        self._done = 0
        self._changed = asyncio.Condition()
        ended: defaultdict[tuple[str, int], list[Outcome]] = defaultdict(list)
        names = [*map(_number, retired)]
        for entry in recorded:
            names.append((entry.task_id, entry.sample, entry.retry))
            ended[entry.task_id, entry.sample].append(entry.outcome)
        following: defaultdict[tuple[str, int], int] = defaultdict(int)
        for task_id, sample, retry in names:
            following[task_id, sample] = max(following[task_id, sample], retry + 1)
        self._waiting: deque[Planned] = deque()
        taken: Counter[str] = Counter()
        for _ in range(samples):
            for task in tasks:
                sample = taken[task.id]
                taken[task.id] += 1
                outcomes = ended.get((task.id, sample), [])
                failures = 0 if retry_errors else sum(map(_has_failed, outcomes))
                if failures > retries or not all(outcome.is_retried for outcome in outcomes):
                    self._done += 1
                else:
                    self._waiting.append(Planned(task, sample, following.get((task.id, sample), 0), failures))
        if hardest_first:
            self._waiting = deque(sorted(self._waiting, key=lambda planned: -planned.task.difficulty))
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

    async def take(self, *, wait: bool = True) -> Planned | None:
        """The next attempt. ``None`` at the end.

        Args:
            wait: while there is none, but one in flight may have to be repeated; else ``None`` then, too.
        """
        while (planned := await self._next_waiting(wait=wait)) is not None:
            claim = Claim.OURS
            if self._claims is not None:
                claim = await asyncio.to_thread(self._claims.claim, planned.task.id, planned.sample)
            if claim is Claim.OURS:
                return planned
            async with self._changed:
                self._in_flight -= 1
                if claim is Claim.TAKEN:
                    self._taken.append(planned)
                else:
                    self._done += 1
                    self.elsewhere.add((planned.task.id, planned.sample))
                self._changed.notify_all()
        return None

    async def _next_waiting(self, *, wait: bool) -> Planned | None:
        async with self._changed:
            while wait and not (self._is_closed or self._waiting):
                if not self._in_flight and not self._taken:
                    return None
                try:
                    async with asyncio.timeout(self._look_seconds if self._taken else None):
                        await self._changed.wait()
                except TimeoutError:
                    self._waiting.extend(self._taken)
                    self._taken.clear()
            if self._is_closed or not self._waiting:
                return None
            self._in_flight += 1
            return self._waiting.popleft()

    async def holds(self, task_id: str, sample: int) -> bool:
        """Whether a sample that was ours still is, and not another collector's by now.

        Raises:
            StoreError: the disk that is shared cannot be read.
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
                self._done += 1
            else:
                self._waiting.append(following)
            self._changed.notify_all()

    async def close(self) -> None:
        """Hand nothing out any more."""
        async with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def is_ending(self, share: float) -> bool:
        """Whether this share of all samples is done, and none waits to be begun."""
        return self._done >= share * self.total and not self._waiting
