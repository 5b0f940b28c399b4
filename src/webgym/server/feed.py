"""Tells those who watch a server what changed, as a line of JSON each time."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable

import msgspec

from webgym.server.messages import Watched


class Feed:
    """Any number of watchers of one server.

    A line is what holds when it is written, so a slow watcher misses what lies between, never the end.

    Args:
        read: what holds now.
        beat_seconds: longest time without a line. A watcher that hears nothing for longer knows why.
    """

    def __init__(self, read: Callable[[], Watched], beat_seconds: float) -> None:
        self._read = read
        self._beat_seconds = beat_seconds
        self._watchers: set[asyncio.Event] = set()
        self._is_closed = False

    def changed(self) -> None:
        """Something may have."""
        for watcher in self._watchers:
            watcher.set()

    def close(self) -> None:
        """End every watcher's stream."""
        self._is_closed = True
        self.changed()

    async def lines(self) -> AsyncIterator[bytes]:
        """One watcher's stream, the present first."""
        change = asyncio.Event()
        self._watchers.add(change)
        try:
            while not self._is_closed:
                change.clear()
                yield msgspec.json.encode(self._read()) + b"\n"
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(self._beat_seconds):
                        await change.wait()
        finally:
            self._watchers.discard(change)
