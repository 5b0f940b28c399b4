"""Run permits, and a separate queue for each type of operation in front of them (paper §4).

A slot's processes run only while it has a permit; between calls they are stopped. The number of permits is
adapted to measurements: more while the processors are not fully used (a slot that waits for the network uses
none), fewer when they are saturated.

The queues are served fairly by service time: the next permit goes to the queue whose calls have used the
least service time. No type has priority over another, so that a burst of navigations delays navigations but
not screenshots. A queue that was empty continues at the level of the others: idle time gives no credit. A
single global queue is available for comparison.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from webgym.server.config import Admission
from webgym.server.messages import PermitLoad, QueueLoad
from webgym.server.operations import QUEUES, QueueName

log = logging.getLogger(__name__)

_RECENT = 0.1
"""Weight of the latest call in the expected service time of a queue's calls."""

MEASURE_SECONDS = 0.2
"""Interval between two measurements, while calls wait. The kernel counts in hundredths of a second."""

SPARE_BELOW = 0.9
"""Busy share of the processors below which more slots may run."""

SATURATED_ABOVE = 0.96
"""Busy share above which fewer may."""


class _Grant(NamedTuple):
    """A granted permit: when it was granted, and how long its call is expected to take, seconds."""

    at: float
    expected: float


_Turn = asyncio.Future[_Grant]


@dataclass
class _Queue:
    waiting: deque[tuple[int, _Turn]] = field(default_factory=deque)
    running: int = 0
    done: int = 0
    waited: float = 0.0
    """Total waiting time of its calls, seconds."""
    served: float = 0.0
    """Total service time of its calls, seconds."""
    account: float = 0.0
    """Service time that decides which queue is next: of finished calls, plus the expected one of running
    calls."""
    expected: float = 0.0
    """Expected service time of a call: a moving average, seconds."""

    @property
    def load(self) -> QueueLoad:
        waiting = sum(not turn.done() for _, turn in self.waiting)
        totals = round(self.waited * 1000), round(self.served * 1000)
        return QueueLoad(self.running, waiting, self.done, *totals)

    @property
    def first(self) -> int | None:
        """Arrival number of the first call that still waits, or ``None``; drops cancelled ones."""
        while self.waiting and self.waiting[0][1].done():
            self.waiting.popleft()
        return self.waiting[0][0] if self.waiting else None

    def begin(self, now: float) -> None:
        """Grant a permit to the first waiting call. Its expected service time counts at once."""
        _, turn = self.waiting.popleft()
        self.running += 1
        self.account += self.expected
        turn.set_result(_Grant(now, self.expected))

    def end(self, grant: _Grant, now: float) -> None:
        """Record the end of a call: its service time replaces the expected one."""
        took = now - grant.at
        self.expected += (took - self.expected) * (_RECENT if self.done else 1.0)
        self.running -= 1
        self.done += 1
        self.served += took
        self.account += took - grant.expected


class Permit:
    """A run permit, created by :meth:`AdmissionController.permit`."""

    def __init__(self, gate: AdmissionController) -> None:
        self._waited = 0.0
        self._waiting_since: float | None = None
        self._gate = gate
        self._grant_held: tuple[_Queue, _Grant] | None = None

    @property
    def waited(self) -> float:
        """Total waiting time in the queues so far, seconds."""
        since = self._waiting_since
        return self._waited + (0.0 if since is None else asyncio.get_running_loop().time() - since)

    async def exchange(self, queue: QueueName, stopped: Callable[[], AbstractContextManager[None]]) -> None:
        """Return the permit, and wait for one of another queue.

        Args:
            queue: the other queue.
            stopped: context in which to wait; not entered if the new permit is granted at once.
        """
        target, turn = self._gate.enqueue(queue)  # before the release, so that it may be granted at once
        self.give_back()
        with contextlib.nullcontext() if turn.done() else stopped():
            await self.take(target, turn)

    async def take(self, queue: _Queue, turn: _Turn) -> None:
        """Wait until the permit is granted."""
        started = self._waiting_since = asyncio.get_running_loop().time()
        try:
            self._grant_held = queue, await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():  # it was granted at the same moment
                self._grant_held = queue, turn.result()
                self.give_back()
            raise
        finally:
            waited = asyncio.get_running_loop().time() - started
            self._waited += waited
            self._waiting_since = None
            queue.waited += waited

    def give_back(self) -> None:
        """Return the permit. Safe to call twice."""
        granted, self._grant_held = self._grant_held, None
        if granted is not None:
            self._gate.release(*granted)


class AdmissionController:
    """Grants run permits.

    Args:
        config: limits of the number of permits, and how queues are served.
        processors: measures the processors' load.
    """

    def __init__(self, config: Admission, processors: Processors | None = None) -> None:
        self.limit = config.fewest
        self.busy = 0.0
        """Busy share of the processors at the last measurement, 0 to 1."""
        self._config = config
        self._processors = processors or Processors()
        self._queues: dict[QueueName, _Queue] = {name: _Queue() for name in QUEUES}
        self._level = 0.0
        """Largest account of a served queue: the least account of a queue that was empty."""
        self._arrivals = 0
        self._running = 0
        self._is_blind = False
        self._adapting: asyncio.Task[None] | None = None

    @asynccontextmanager
    async def permit(
        self, queue: QueueName, on_queue: Callable[[Permit], None] = lambda _: None
    ) -> AsyncIterator[Permit]:
        """Wait in a queue for a run permit, and hold it during the block.

        Args:
            queue: the queue of the call's operation.
            on_queue: called with the permit before the wait.
        """
        permit = Permit(self)
        on_queue(permit)
        await permit.take(*self.enqueue(queue))
        try:
            yield permit
        finally:
            permit.give_back()

    def enqueue(self, queue: QueueName) -> tuple[_Queue, _Turn]:
        """Add a call to a queue; for :class:`Permit`."""
        target = self._queues[queue]
        turn: _Turn = asyncio.get_running_loop().create_future()
        if target.first is None:
            target.account = max(target.account, self._level)
        self._arrivals += 1
        target.waiting.append((self._arrivals, turn))
        self._grant()
        if not turn.done() and (self._adapting is None or self._adapting.done()):
            self._adapting = asyncio.get_running_loop().create_task(self._adapt())
        return target, turn

    def release(self, queue: _Queue, grant: _Grant) -> None:
        """Return the permit of a finished call; for :class:`Permit`."""
        queue.end(grant, asyncio.get_running_loop().time())
        self._running -= 1
        self._grant()

    def _grant(self) -> None:
        now = asyncio.get_running_loop().time()
        while self._running < self.limit and (queue := self._next()) is not None:
            self._level = max(self._level, queue.account)
            self._running += 1
            queue.begin(now)

    def _next(self) -> _Queue | None:
        waiting = [queue for queue in self._queues.values() if queue.first is not None]
        if self._config.queues == "global":
            return min(waiting, key=lambda queue: queue.first or 0, default=None)
        return min(waiting, key=lambda queue: (queue.account, queue.first), default=None)

    # --- the number of permits --------------------------------------------------------------------------

    async def _adapt(self) -> None:
        """Measure the load and adjust the number of permits while calls wait."""
        config = self._config
        self._measure()  # the next measurement begins here
        while any(queue.first is not None for queue in self._queues.values()):
            await asyncio.sleep(MEASURE_SECONDS)
            if (busy := self._measure()) is None:
                continue
            self.busy = busy
            if self.busy < SPARE_BELOW:
                self.limit = min(config.most, self.limit + config.step)
                self._grant()
            elif self.busy > SATURATED_ABOVE:
                self.limit = max(config.fewest, self.limit - config.step)

    def _measure(self) -> float | None:
        """The load since the last measurement; ``None`` if it cannot be read, because no file is left."""
        try:
            busy = self._processors.busy()
        except OSError as error:
            if not self._is_blind:
                log.error("the number of permits stays until the load can be measured again: %s", error)
            self._is_blind = True
            return None
        self._is_blind = False
        return busy

    async def stop(self) -> None:
        """Stop measuring."""
        if self._adapting is not None:
            self._adapting.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._adapting

    # --- statistics -------------------------------------------------------------------------------------

    @property
    def load(self) -> dict[str, QueueLoad]:
        """The load of every queue at this moment, by name."""
        return {name: queue.load for name, queue in self._queues.items()}

    @property
    def permits(self) -> PermitLoad:
        """The number of permits at this moment."""
        return PermitLoad(self.limit, self._running, self.busy)


_STAT = Path("/proc/stat")
_CGROUP = Path("/sys/fs/cgroup")


class Processors:
    """The busy share of the processors between two calls of :meth:`busy`.

    The larger of two shares counts: that of the processors in this process's affinity mask (which other
    processes may use as well), and that of its control group's CPU quota, if it has one.
    """

    def __init__(self) -> None:
        self.affinity = os.sched_getaffinity(0)
        self._group = _own_group()
        self._measured_at, self._ticks, self._used = (
            time.monotonic(),
            _ticks(self.affinity),
            _group_seconds(self._group),
        )

    def busy(self) -> float:
        """Share in use since the last call, 0 to 1. Meaningful over 0.1 s and more."""
        now, ticks, used = time.monotonic(), _ticks(self.affinity), _group_seconds(self._group)
        all_ticks = ticks[1] - self._ticks[1]
        shares = [(ticks[0] - self._ticks[0]) / all_ticks if all_ticks else 0.0]
        quota = allowed_cores(self._group)
        if quota is not None and now > self._measured_at:
            shares.append((used - self._used) / (quota * (now - self._measured_at)))
        self._measured_at, self._ticks, self._used = now, ticks, used
        return min(1.0, max(shares))


def _ticks(processors: set[int]) -> tuple[int, int]:
    """Busy ticks and all ticks of these processors since boot."""
    busy = total = 0
    for line in _STAT.read_text().splitlines():
        name, *rest = line.split()
        if name.startswith("cpu") and name != "cpu" and int(name[3:]) in processors:
            counts = [int(field) for field in rest[:8]]  # guest time is in user time already
            total += sum(counts)
            busy += sum(counts) - counts[3] - counts[4]  # idle, waiting for disks
    return busy, total


def _own_group() -> Path | None:
    """The cgroup v2 of this process, if its CPU controller is available."""
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return None
    name = next((line[3:] for line in lines if line.startswith("0::")), None)
    group = None if name is None else _CGROUP / name.lstrip("/")
    return group if group and (group / "cpu.max").exists() else None


def allowed_cores(group: Path | None) -> float | None:
    """Number of processors that a control group may use; ``None`` if it is not limited."""
    try:
        allowed, period = (group / "cpu.max").read_text().split() if group else ("max", "")
    except (OSError, ValueError):
        return None
    return None if allowed == "max" else int(allowed) / int(period)


def _group_seconds(group: Path | None) -> float:
    if group is None:
        return 0.0
    for line in (group / "cpu.stat").read_text().splitlines():
        name, value = line.split()
        if name == "usage_usec":
            return int(value) / 1e6
    return 0.0
