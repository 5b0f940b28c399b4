"""Limits the rate of connections to one host, by all sessions of this process together."""

from __future__ import annotations

from collections import OrderedDict


class Politeness:
    """A token bucket per host, stored as the time at which the bucket is full again.

    Args:
        rate: tokens per second.
        burst: capacity of a bucket, tokens.
        wait_seconds: longest delay.
    """

    _MOST_HOSTS = 4096

    def __init__(self, rate: float, burst: int, wait_seconds: float) -> None:
        self._interval = 1 / rate
        self._depth = (burst - 1) / rate
        self._wait_seconds = wait_seconds
        self._full_at: OrderedDict[str, float] = OrderedDict()

    def delay(self, host: str, now: float) -> float | None:
        """Take a token: seconds until it may be used; ``None`` if that is too long, and none was taken."""
        full_at = max(self._full_at.get(host, now), now)
        delay = max(0.0, full_at - self._depth - now)
        if delay > self._wait_seconds:
            return None
        self._full_at[host] = full_at + self._interval
        self._full_at.move_to_end(host)
        if len(self._full_at) > self._MOST_HOSTS:
            self._full_at.popitem(last=False)  # the least recently used
        return delay
