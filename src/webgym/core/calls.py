"""Limits on concurrent calls of each kind, and how long calls wait and take.

Every kind has a queue of its own, so that a burst of one holds up no other (paper §4).
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
    """One kind of calls.

    Attributes:
        limit: how many may be under way at once.
        running, waiting: now.
        done: so far.
        waited_seconds, served_seconds: of those that are done, all in all.
        wait, service: of those that were done last, median, seconds; ``None`` before the first.
    """

    limit: int
    running: int
    waiting: int
    done: int
    waited_seconds: float
    served_seconds: float
    wait: float | None
    service: float | None


_LATELY: Final = 200
"""Calls of which the medians are."""


class CallQueue:
    """Calls of one kind: a limited number at once; the others wait in order of arrival."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._places = asyncio.Semaphore(limit)
        self._running = self._waiting = self._done = 0
        self._waited = self._served = 0.0
        self._lately: deque[tuple[float, float]] = deque(maxlen=_LATELY)
        """What the last calls have waited and been served."""

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait until a call may start; the call is made in the block."""
        came = time.monotonic()
        self._waiting += 1
        try:
            await self._places.acquire()
        finally:
            self._waiting -= 1
        began = time.monotonic()
        self._running += 1
        try:
            yield
        finally:
            self._places.release()
            self._running -= 1
            self._done += 1
            waited, served = began - came, time.monotonic() - began
            self._waited += waited
            self._served += served
            self._lately.append((waited, served))

    def waited_elsewhere(self, seconds: float) -> None:
        """Part of the time of a call that is done was a wait in a queue of whoever was called."""
        self._correct(seconds, -seconds)

    def held(self, other: CallQueue, waited: float, served: float) -> None:
        """The end of a call that is done was one of another kind: what that has waited and been served,
        seconds."""
        self._correct(0.0, -waited - served)
        other._done += 1
        other._waited += waited
        other._served += served
        other._lately.append((waited, served))

    def _correct(self, waited: float, served: float) -> None:
        self._waited += waited
        self._served += served
        if self._lately:
            before = self._lately.pop()  # this call's, or that of one that ended in the same moment
            self._lately.append((before[0] + waited, max(before[1] + served, 0.0)))

    @property
    def load(self) -> CallLoad:
        """At this moment."""
        numbers = self._limit, self._running, self._waiting, self._done
        waits, services = zip(*self._lately, strict=True) if self._lately else ((), ())
        return CallLoad(
            *numbers,
            round(self._waited, 6),
            round(max(self._served, 0.0), 6),
            statistics.median(waits) if waits else None,
            statistics.median(services) if services else None,
        )


def call_queues(limits: Mapping[str, int]) -> dict[str, CallQueue]:
    """A queue for each kind."""
    return {kind: CallQueue(limit) for kind, limit in limits.items()}


class LoopLag:
    """Lag of the event loop: how long coroutines that were ready have recently waited to run."""

    _EVERY_SECONDS = 0.05
    _KEPT = 2400

    def __init__(self) -> None:
        self._late: deque[float] = deque(maxlen=self._KEPT)

    async def watch(self) -> None:
        """Measure until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + self._EVERY_SECONDS
            await asyncio.sleep(self._EVERY_SECONDS)
            self._late.append(loop.time() - due)

    def milliseconds(self, share: float) -> float:
        """A quantile of the last two minutes; 0 before anything was measured."""
        ranked = sorted(self._late)
        return ranked[min(int(share * len(ranked)), len(ranked) - 1)] * 1000 if ranked else 0.0
