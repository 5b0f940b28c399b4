"""The queue for free slots: one for all workers, first come, first served."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Mapping

from webgym.core.errors import NoCapacity, TooManyWaiting
from webgym.server.fleet import Worker


class SlotQueue:
    """Callers that wait for a worker with a free slot.

    Without polling: :meth:`serve` is called whenever a worker reports; the report and the calls sent since
    say which workers have free slots.

    Args:
        workers: the running workers, by name.
        longest: largest number of waiting callers.
    """

    def __init__(self, workers: Mapping[str, Worker], longest: int) -> None:
        self._workers = workers
        self._longest = longest
        self._waiting: deque[asyncio.Future[Worker]] = deque()

    def __len__(self) -> int:
        return sum(not turn.done() for turn in self._waiting)

    async def turn(self, seconds: float, *, again: bool = False) -> Worker:
        """Wait for a worker with a free slot; its ``sent`` already counts the caller.

        Args:
            seconds: longest wait.
            again: whether the caller's worker was lost, so that it goes to the head of the queue.

        Raises:
            NoCapacity: no worker had a free slot in time.
            TooManyWaiting: no slot is free, and the queue is full.
        """
        turn: asyncio.Future[Worker] = asyncio.get_running_loop().create_future()
        if again:
            self._waiting.appendleft(turn)
        else:
            self._waiting.append(turn)
        self.serve()
        if not (again or turn.done()) and len(self) > self._longest:
            turn.cancel()
            raise TooManyWaiting.of(self._longest)
        try:
            async with asyncio.timeout(seconds):
                return await turn
        except TimeoutError:
            if turn.done() and not turn.cancelled():  # it was granted at the same moment
                return turn.result()
            raise self._no_capacity(seconds) from None
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():
                turn.result().sent -= 1
                self.serve()
            raise

    def serve(self) -> None:
        """Send callers in order to the worker with the most free slots, while there are free slots."""
        while self._waiting:
            if self._waiting[0].done():  # it gave up
                self._waiting.popleft()
                continue
            best = max(self._workers.values(), key=lambda worker: worker.room, default=None)
            if best is None or best.room <= 0:
                return
            best.sent += 1
            self._waiting.popleft().set_result(best)

    def _no_capacity(self, seconds: float) -> NoCapacity:
        slots = sum(worker.info.slots for worker in self._workers.values())
        if not slots:
            return NoCapacity(
                f"no worker started within {round(seconds, 2):g} s", hint="the server's log says why"
            )
        return NoCapacity(
            f"all {slots} slots were in use for {round(seconds, 2):g} s",
            hint="close sessions, or start the server with more slots",
        )
