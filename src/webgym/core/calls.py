"""Limits on concurrent calls of each kind, and how long calls wait and run.

Every kind has a queue of its own, so that a burst of one kind does not delay the others (paper §4).
"""

from __future__ import annotations

import asyncio
import statistics
import time
from collections import deque
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Final

import msgspec

BROWSER_CALLS: Final = ("allocate", "navigate", "execute", "screenshot", "metadata", "release")
"""The kinds of calls that a collector makes of browsers."""


class CallLoad(msgspec.Struct, frozen=True):
    """Statistics of one kind of calls.

    Attributes:
        limit: how many may run at once.
        running, waiting: number of calls at this moment.
        done: number of finished calls.
        waited_seconds, served_seconds: total waiting and running time of finished calls.
        wait, service: median waiting and running time of the most recent calls, seconds; ``None`` before the
            first has finished.
    """

    limit: int
    running: int
    waiting: int
    done: int
    waited_seconds: float
    served_seconds: float
    wait: float | None
    service: float | None


_RECENT_CALLS: Final = 200
"""The number of most recent calls that the medians are taken over."""


class CallQueue:
    """Runs a limited number of calls of one kind at once; the others wait in order of arrival."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._slots = asyncio.Semaphore(limit)
        self._running = self._waiting = self._done = 0
        self._waited = self._served = 0.0
        self._recent: deque[tuple[float, float]] = deque(maxlen=_RECENT_CALLS)
        """Waiting and running time of the most recent calls, seconds."""

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait until a call may start; the block makes the call."""
        arrived = time.monotonic()
        self._waiting += 1
        try:
            await self._slots.acquire()
        finally:
            self._waiting -= 1
        started = time.monotonic()
        self._running += 1
        try:
            yield
        finally:
            self._slots.release()
            self._running -= 1
            self._done += 1
            waited, served = started - arrived, time.monotonic() - started
            self._waited += waited
            self._served += served
            self._recent.append((waited, served))

    def waited_elsewhere(self, seconds: float) -> None:
        """Count part of the finished call's running time as waiting: it waited in the callee's own queue."""
        self._correct(seconds, -seconds)

    def included(self, other: CallQueue, waited: float, served: float) -> None:
        """Count the last part of the finished call as a call of another kind.

        Args:
            other: the queue of that kind.
            waited, served: how long that part waited and ran, seconds.
        """
        self._correct(0.0, -waited - served)
        other._done += 1
        other._waited += waited
        other._served += served
        other._recent.append((waited, served))

    def _correct(self, waited: float, served: float) -> None:
        self._waited += waited
        self._served += served
        if self._recent:
            last = self._recent.pop()  # of this call, or of one that ended at the same moment
            self._recent.append((last[0] + waited, max(last[1] + served, 0.0)))

    @property
    def load(self) -> CallLoad:
        """The statistics at this moment."""
        counts = self._limit, self._running, self._waiting, self._done
        waits, services = zip(*self._recent, strict=True) if self._recent else ((), ())
        return CallLoad(
            *counts,
            round(self._waited, 6),
            round(max(self._served, 0.0), 6),
            statistics.median(waits) if waits else None,
            statistics.median(services) if services else None,
        )


def call_queues(limits: Mapping[str, int]) -> dict[str, CallQueue]:
    """A queue for each kind of call, given the limit on concurrent calls of each kind."""
    return {kind: CallQueue(limit) for kind, limit in limits.items()}


class LoopLag:
    """Lag of the event loop: how long coroutines that were ready have recently waited to run."""

    _INTERVAL_SECONDS = 0.05
    _SAMPLES = 2400

    def __init__(self) -> None:
        self._lags: deque[float] = deque(maxlen=self._SAMPLES)

    async def watch(self) -> None:
        """Measure until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + self._INTERVAL_SECONDS
            await asyncio.sleep(self._INTERVAL_SECONDS)
            self._lags.append(loop.time() - due)

    def milliseconds(self, share: float) -> float:
        """The quantile ``share`` (0 to 1) of the last two minutes' lags; 0 before the first measurement."""
        ordered = sorted(self._lags)
        return ordered[min(int(share * len(ordered)), len(ordered) - 1)] * 1000 if ordered else 0.0
