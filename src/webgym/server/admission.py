"""Run permits, and a queue of its own for each type of operation in front of them (paper §4).

A slot's processes run only while it holds a permit; between calls they are stopped. How many may run at
once is found by measuring: more while the processors have time to spare (a slot that waits for the
network uses none), fewer when they are saturated.

The queues take turns: no type has priority over another, so that a burst of navigations waits for
navigations, and the screenshots behind it go on. One line for all is there for comparison.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from webgym.server.config import Admission
from webgym.server.messages import PermitLoad, QueueLoad
from webgym.server.operations import QUEUES, QueueName
from webgym.server.saturation import Processors

_Turn = asyncio.Future[None]


@dataclass
class _Queue:
    waiting: deque[tuple[int, _Turn]] = field(default_factory=deque)
    running: int = 0
    done: int = 0

    @property
    def load(self) -> QueueLoad:
        return QueueLoad(self.running, sum(not turn.done() for _, turn in self.waiting), self.done)

    @property
    def first(self) -> int | None:
        """When the first that still waits came; those that gave up are dropped."""
        while self.waiting and self.waiting[0][1].done():
            self.waiting.popleft()
        return self.waiting[0][0] if self.waiting else None


class Gatekeeper:
    """Gives out run permits.

    Args:
        processors: what measures saturation.
    """

    def __init__(self, config: Admission, processors: Processors | None = None) -> None:
        self.limit = config.fewest
        self.busy = 0.0
        """Share of the processors in use, when it was last measured."""
        self._config = config
        self._processors = processors or Processors()
        self._queues: dict[QueueName, _Queue] = {name: _Queue() for name in QUEUES}
        self._order = list(QUEUES)
        """Whose turn is next: a queue that was served goes to the end."""
        self._arrivals = 0
        self._running = 0
        self._adapting: asyncio.Task[None] | None = None

    @asynccontextmanager
    async def permit(self, queue: QueueName) -> AsyncIterator[None]:
        """Wait in this queue for a turn, and hold a run permit for the block."""
        own = self._queues[queue]
        await self._admitted(own)
        try:
            yield
        finally:
            own.done += 1
            self._release(own)

    async def _admitted(self, own: _Queue) -> None:
        turn: _Turn = asyncio.get_running_loop().create_future()
        self._arrivals += 1
        own.waiting.append((self._arrivals, turn))
        self._grant()
        if turn.done():
            return
        self._adapt_while_waiting()
        try:
            await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():  # it came in the same moment
                self._release(own)
            raise

    def _release(self, own: _Queue) -> None:
        own.running -= 1
        self._running -= 1
        self._grant()

    def _grant(self) -> None:
        while self._running < self.limit and (queue := self._next()) is not None:
            _, turn = queue.waiting.popleft()
            queue.running += 1
            self._running += 1
            turn.set_result(None)

    def _next(self) -> _Queue | None:
        waiting = [name for name in self._order if self._queues[name].first is not None]
        if not waiting:
            return None
        if self._config.order == "global":
            return min((self._queues[name] for name in waiting), key=lambda queue: queue.first or 0)
        self._order.remove(waiting[0])
        self._order.append(waiting[0])
        return self._queues[waiting[0]]

    # --- how many ---------------------------------------------------------------------------------------

    def _adapt_while_waiting(self) -> None:
        if self._adapting is None or self._adapting.done():
            self._adapting = asyncio.get_running_loop().create_task(self._adapt())

    async def _adapt(self) -> None:
        """Measure and adjust for as long as somebody waits."""
        config = self._config
        self._processors.busy()  # from here on
        while any(queue.first is not None for queue in self._queues.values()):
            await asyncio.sleep(config.measure_seconds)
            self.busy = self._processors.busy()
            if self.busy < config.spare_below:
                self.limit = min(config.most, self.limit + config.step)
                self._grant()
            elif self.busy > config.saturated_above:
                self.limit = max(config.fewest, self.limit - config.step)

    async def stop(self) -> None:
        """Stop measuring."""
        if self._adapting is not None:
            self._adapting.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._adapting

    # --- what is seen -----------------------------------------------------------------------------------

    @property
    def load(self) -> dict[str, QueueLoad]:
        """Of every queue at this moment, by its name."""
        return {name: queue.load for name, queue in self._queues.items()}

    @property
    def permits(self) -> PermitLoad:
        """Of the permits at this moment."""
        return PermitLoad(self.limit, self._running, self.busy)
