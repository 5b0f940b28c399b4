"""Streams a server's state to its subscribers: a line of JSON after every change."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable

import msgspec

from webgym.server.messages import Watched


class Feed:
    """The subscribers of one server.

    A line contains the state at the time of writing, so a slow subscriber misses intermediate states but
    never the last.

    Args:
        read: returns the current state.
        beat_seconds: longest time without a line. A subscriber without one for longer knows that the server
            is gone.
    """

    def __init__(self, read: Callable[[], Watched], beat_seconds: float) -> None:
        self._read = read
        self._beat_seconds = beat_seconds
        self._watchers: set[asyncio.Event] = set()
        self._is_closed = False

    def changed(self) -> None:
        """Announce that the state may have changed."""
        for watcher in self._watchers:
            watcher.set()

    def close(self) -> None:
        """End every subscriber's stream."""
        self._is_closed = True
        self.changed()

    async def lines(self) -> AsyncIterator[bytes]:
        """One subscriber's stream, beginning with the current state."""
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
