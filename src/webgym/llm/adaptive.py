"""Adaptive concurrency: an endpoint gets as many requests at once as it can handle.

The limit changes like a TCP sender's window. It doubles per round trip until the first sign of overload, then
grows by one per round trip; a refusal (429, 503, 529) or a timeout reduces it to a fraction, once per round
trip, since requests sent before a reduction say nothing about the limit after it. It also shrinks, by a tenth
per round trip, while the endpoint is much slower than at its best: a server that queues instead of refusing
gains nothing from a longer queue. If half the limit does not make it faster, its slowness has another cause,
and its current speed counts as its best from then on.

It grows only while requests wait because of it. ``Retry-After`` of one request pauses all of them.
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
"""Factor of the limit per round trip while the endpoint is slow."""
_NO_FASTER: Final = 0.8
"""If half as many requests take more than this share of the time, concurrency is not the cause of
slowness."""


class ConcurrencyLimiter:
    """Limits the requests in flight to one endpoint.

    Args:
        most: upper bound of the limit.
        adapt: how the limit changes below that.
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
        """Number of requests that may currently be in flight."""
        return int(self._limit)

    @property
    def in_flight(self) -> int:
        """Number of requests in flight."""
        return self._in_flight

    @asynccontextmanager
    async def turn(self, *, again: bool = False) -> AsyncIterator[RequestPermit]:
        """Wait for a permit, which is returned at the end of the ``async with`` block.

        Args:
            again: whether to wait at the head of the queue, for a request that has waited before.
        """
        await self._enter(again=again)
        try:
            yield RequestPermit(self, self._cuts)
        finally:
            self._in_flight -= 1
            self._admit()

    def pause(self, seconds: float) -> None:
        """Start no request for this long."""
        loop = asyncio.get_running_loop()
        if self._pause is not None:
            if self._pause.when() >= loop.time() + seconds:
                return
            self._pause.cancel()
        self._pause = loop.call_later(seconds, self._resume)

    def _resume(self) -> None:
        self._pause = None
        self._admit()

    async def _enter(self, *, again: bool) -> None:
        if self._is_open() and not self._queue:
            self._in_flight += 1
            return
        waiter = asyncio.get_running_loop().create_future()
        if again:
            self._queue.appendleft(waiter)
        else:
            self._queue.append(waiter)
        try:
            await waiter
        except asyncio.CancelledError:
            if waiter.cancelled():
                with suppress(ValueError):  # skipped by _admit
                    self._queue.remove(waiter)
            else:  # admitted at the same moment
                self._in_flight -= 1
                self._admit()
            raise

    def _is_open(self) -> bool:
        return self._pause is None and self._in_flight < self.limit

    def _admit(self) -> None:
        while self._queue and self._is_open():
            waiter = self._queue.popleft()
            if not waiter.cancelled():
                self._in_flight += 1
                waiter.set_result(None)

    # --- changing the limit -------------------------------------------------------------------------

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
        """Reduce the limit because the endpoint is slow, and check whether that helps."""
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
        self._admit()

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
    """The permit of one request in flight, by which the result is reported, at most once."""

    def __init__(self, gate: ConcurrencyLimiter, cuts: int) -> None:
        self._gate = gate
        self._cuts = cuts

    def answered(self, pace: float) -> None:
        """Report success, with the pace: seconds per unit of work."""
        self._gate._answered(pace)

    def refused(self, pause_seconds: float = 0.0) -> None:
        """Report that the endpoint is overloaded, and asks for a pause."""
        self._gate._refused(self._cuts)
        if pause_seconds > 0:
            self._gate.pause(pause_seconds)
