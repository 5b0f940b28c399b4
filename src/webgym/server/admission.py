"""Run permits, and a queue of its own for each type of operation in front of them (paper §4).

A slot's processes run only while it holds a permit; between calls they are stopped. How many may run at
once is found by measuring: more while the processors have time to spare (a slot that waits for the
network uses none), fewer when they are saturated.

The queues take turns by service time: next is the one whose calls have held permits for the least time. No
type has priority over another, so that a burst of navigations waits for navigations, and the screenshots
behind it go on. A queue that was empty comes back level with the others: idleness earns no credit. One queue
for all is there for comparison.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from webgym.server.config import Admission
from webgym.server.messages import PermitLoad, QueueLoad
from webgym.server.operations import QUEUES, QueueName
from webgym.server.saturation import Processors

_RECENT = 0.1
"""Weight of the latest call in what a queue's calls are expected to take."""


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
    """Seconds that its calls have waited for their turns, all in all."""
    served: float = 0.0
    """Seconds that its calls have held permits, all in all."""
    account: float = 0.0
    """Service time that decides whose turn it is: had, and expected of the calls that run."""
    usual: float = 0.0
    """Seconds for which a call holds its permit, lately."""

    @property
    def load(self) -> QueueLoad:
        waiting = sum(not turn.done() for _, turn in self.waiting)
        totals = round(self.waited * 1000), round(self.served * 1000)
        return QueueLoad(self.running, waiting, self.done, *totals)

    @property
    def first(self) -> int | None:
        """When the first that still waits came; those that gave up are dropped."""
        while self.waiting and self.waiting[0][1].done():
            self.waiting.popleft()
        return self.waiting[0][0] if self.waiting else None

    def begin(self, now: float) -> None:
        """Grant a permit to the first that waits. Its expected service time counts at once."""
        _, turn = self.waiting.popleft()
        self.running += 1
        self.account += self.usual
        turn.set_result(_Grant(now, self.usual))

    def end(self, grant: _Grant, now: float) -> None:
        """Record that a call has run: its service time counts in place of the expected one."""
        took = now - grant.at
        self.usual += (took - self.usual) * (_RECENT if self.done else 1.0)
        self.running -= 1
        self.done += 1
        self.served += took
        self.account += took - grant.expected


class Permit:
    """The right to run, which a call of :meth:`AdmissionController.permit` holds."""

    def __init__(self, gate: AdmissionController) -> None:
        self._waited = 0.0
        self._waits_since: float | None = None
        self._gate = gate
        self._held: tuple[_Queue, _Grant] | None = None

    @property
    def waited(self) -> float:
        """Seconds that it has waited for its turns, until now."""
        since = self._waits_since
        return self._waited + (0.0 if since is None else asyncio.get_running_loop().time() - since)

    async def exchange(self, queue: QueueName, stopped: Callable[[], AbstractContextManager[None]]) -> None:
        """Give it back, and wait for one of another queue.

        Args:
            queue: the other.
            stopped: entered for as long as somebody else has the place; not at all if nobody wants it.
        """
        own, turn = self._gate.line_up(queue)  # before the place is free: one's own turn may be next
        self.give_back()
        with contextlib.nullcontext() if turn.done() else stopped():
            await self.take(own, turn)

    async def take(self, own: _Queue, turn: _Turn) -> None:
        """Wait for a turn, and hold the permit that comes with it."""
        began = self._waits_since = asyncio.get_running_loop().time()
        try:
            self._held = own, await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():  # it came in the same moment
                self._held = own, turn.result()
                self.give_back()
            raise
        finally:
            waited = asyncio.get_running_loop().time() - began
            self._waited += waited
            self._waits_since = None
            own.waited += waited

    def give_back(self) -> None:
        """Let the next one run. Safe to call twice."""
        held, self._held = self._held, None
        if held is not None:
            self._gate.release(*held)


class AdmissionController:
    """Grants run permits.

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
        self._level = 0.0
        """Account of the queue that was served last: where one that was empty comes back."""
        self._arrivals = 0
        self._running = 0
        self._adapting: asyncio.Task[None] | None = None

    @asynccontextmanager
    async def permit(
        self, queue: QueueName, on_queue: Callable[[Permit], None] = lambda _: None
    ) -> AsyncIterator[Permit]:
        """Wait in this queue for a turn, and hold a run permit for the block.

        Args:
            on_queue: is given the permit before it is waited for.
        """
        permit = Permit(self)
        on_queue(permit)
        await permit.take(*self.line_up(queue))
        try:
            yield permit
        finally:
            permit.give_back()

    def line_up(self, queue: QueueName) -> tuple[_Queue, _Turn]:
        """Stand in a queue; for :class:`Permit`."""
        own = self._queues[queue]
        turn: _Turn = asyncio.get_running_loop().create_future()
        if own.first is None:
            own.account = max(own.account, self._level)
        self._arrivals += 1
        own.waiting.append((self._arrivals, turn))
        self._grant()
        if not turn.done() and (self._adapting is None or self._adapting.done()):
            self._adapting = asyncio.get_running_loop().create_task(self._adapt())
        return own, turn

    def release(self, own: _Queue, grant: _Grant) -> None:
        """A call has run; for :class:`Permit`."""
        own.end(grant, asyncio.get_running_loop().time())
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

    # --- how many ---------------------------------------------------------------------------------------

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
