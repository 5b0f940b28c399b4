"""How many requests an endpoint gets at once: as many as it bears.

The limit moves as a TCP sender's window does. It doubles per round trip until the first sign of trouble,
then grows by one per round trip; a refusal (429, 503, 529) or a timeout cuts it to a share of itself, once
per round trip, since what was sent before a cut says nothing about the limit after it. It also shrinks, by
a tenth per round trip, while the endpoint is much slower than it was at its best: a server that queues
instead of refusing is no faster for a longer queue. If half the limit makes it no faster, its slowness is not
our doing, and counts as its best from then on.

It grows only while it is what holds requests back. ``Retry-After`` of one request pauses them all.
"""

from __future__ import annotations

import asyncio
import math
import statistics
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Final

from webgym.llm.config import AdaptiveConcurrency

_EASE: Final = 0.9
"""What is left of the limit per round trip while the endpoint is slow."""
_NO_FASTER: Final = 0.8
"""If half as many requests take more than this share of the time, it is not they who make it slow."""


class ConcurrencyLimiter:
    """What all requests to one endpoint pass through.

    Args:
        most: requests in flight at most.
        adapt: how the limit moves below that.
    """

    def __init__(self, most: int, adapt: AdaptiveConcurrency) -> None:
        self._most = most
        self._adapt = adapt
        self._limit = float(min(most, adapt.first))
        self._is_doubling = True
        self._cuts = 0
        self._in_flight = 0
        self._queue: deque[asyncio.Future[None]] = deque()
        self._pause: asyncio.TimerHandle | None = None
        self._round = self._round_length()
        self._paces: list[float] = []
        self._best = math.inf
        self._slow_since: tuple[float, float] | None = None

    @property
    def limit(self) -> int:
        """Requests that may be in flight now."""
        return int(self._limit)

    @property
    def in_flight(self) -> int:
        """Requests that are in flight now."""
        return self._in_flight

    @asynccontextmanager
    async def turn(self, *, again: bool = False) -> AsyncIterator[RequestPermit]:
        """Wait for a place; it is given back at the end of the ``async with`` block.

        Args:
            again: stand at the head of the queue, for a request that has waited once already.
        """
        await self._enter(again=again)
        try:
            yield RequestPermit(self, self._cuts)
        finally:
            self._in_flight -= 1
            self._let_in()

    def pause(self, seconds: float) -> None:
        """Let nobody in for this long."""
        loop = asyncio.get_running_loop()
        if self._pause is not None:
            if self._pause.when() >= loop.time() + seconds:
                return
            self._pause.cancel()
        self._pause = loop.call_later(seconds, self._resume)

    def _resume(self) -> None:
        self._pause = None
        self._let_in()

    async def _enter(self, *, again: bool) -> None:
        if self._is_open() and not self._queue:
            self._in_flight += 1
            return
        place = asyncio.get_running_loop().create_future()
        if again:
            self._queue.appendleft(place)
        else:
            self._queue.append(place)
        try:
            await place
        except asyncio.CancelledError:
            if place.cancelled():
                with suppress(ValueError):  # passed over by _let_in
                    self._queue.remove(place)
            else:  # let in at the same moment
                self._in_flight -= 1
                self._let_in()
            raise

    def _is_open(self) -> bool:
        return self._pause is None and self._in_flight < self.limit

    def _let_in(self) -> None:
        while self._queue and self._is_open():
            place = self._queue.popleft()
            if not place.cancelled():
                self._in_flight += 1
                place.set_result(None)

    # --- how the limit moves ------------------------------------------------------------------------

    def _round_length(self) -> int:
        return max(self.limit, self._adapt.round_replies)

    def _answered(self, pace: float) -> None:
        is_full = bool(self._queue) or self._in_flight >= self.limit
        self._paces.append(pace)
        if self._is_doubling and is_full:
            self._grow()
        if len(self._paces) < self._round:
            return
        median = statistics.median(self._paces)
        self._best = min(median, self._best)
        if median > self._best * self._adapt.slower:
            self._ease(median)
        else:
            self._slow_since = None
            if is_full and not self._is_doubling:
                self._grow()
        self._begin_round()

    def _ease(self, pace: float) -> None:
        """Be content with less, as the endpoint is slow; look whether it helps."""
        self._is_doubling = False
        limit, slowest = self._slow_since = self._slow_since or (self._limit, pace)
        if self._limit <= max(1.0, limit / 2):
            self._slow_since = None
            if pace > slowest * _NO_FASTER:
                self._best = pace
                return
        self._limit = max(1.0, self._limit * _EASE)

    def _grow(self) -> None:
        self._limit = min(float(self._most), self._limit + 1)
        self._let_in()

    def _refused(self, cuts: int) -> None:
        if cuts != self._cuts:
            return
        self._cuts += 1
        self._is_doubling = False
        self._limit = max(1.0, self._limit * self._adapt.shrink)
        self._begin_round()

    def _begin_round(self) -> None:
        self._paces.clear()
        self._round = self._round_length()


class RequestPermit:
    """A request's place among those in flight. It tells how it went, at most once."""

    def __init__(self, gate: ConcurrencyLimiter, cuts: int) -> None:
        self._gate = gate
        self._cuts = cuts

    def answered(self, pace: float) -> None:
        """It went well, at this pace: seconds per unit of work, whatever the unit is."""
        self._gate._answered(pace)

    def refused(self, pause_seconds: float = 0.0) -> None:
        """The endpoint has too much to do, and wants to be left alone for this long."""
        self._gate._refused(self._cuts)
        if pause_seconds > 0:
            self._gate.pause(pause_seconds)
