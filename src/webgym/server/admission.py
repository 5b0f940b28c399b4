"""A queue of its own for each type of operation, in front of the slots (paper, section 4).

No type has priority over another: a burst of navigations waits for navigations, and the screenshots
behind it go on.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from webgym.server.config import Admission
from webgym.server.messages import GateLoad
from webgym.server.operations import QUEUES, QueueName


class Gate:
    """First come, first served, ``limit`` at once."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.running = 0
        self.waiting = 0
        self.done = 0
        self._permits = asyncio.Semaphore(limit)

    @asynccontextmanager
    async def permit(self) -> AsyncIterator[None]:
        """Wait for a turn and hold it for the block."""
        self.waiting += 1
        try:
            await self._permits.acquire()
        finally:
            self.waiting -= 1
        self.running += 1
        try:
            yield
        finally:
            self.running -= 1
            self.done += 1
            self._permits.release()

    @property
    def load(self) -> GateLoad:
        """At this moment."""
        return GateLoad(self.limit, self.running, self.waiting, self.done)


class Gates:
    """One gate per type of operation."""

    def __init__(self, config: Admission) -> None:
        self._gates = {name: Gate(getattr(config, name)) for name in QUEUES}

    def __getitem__(self, name: QueueName) -> Gate:
        return self._gates[name]

    @property
    def load(self) -> dict[str, GateLoad]:
        """Of every gate, by its name."""
        return {name: gate.load for name, gate in self._gates.items()}
