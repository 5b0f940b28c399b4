"""The step barrier, one of the paper's baselines (§4): attempts that ask and act together.

A round is a vectorised environment's step: all have their observations, all are asked in one batch, and only
when the last reply is there do they act. Whoever ends leaves; whoever takes its place joins the first round
for which it is ready, so that nobody waits for a browser that is being opened.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager


class Lockstep:
    """Where attempts of one group wait for each other."""

    def __init__(self) -> None:
        self._members: set[object] = set()
        self._ready: dict[object, asyncio.Future[None]] = {}
        """Members that have their observation."""
        self._asked: set[object] = set()
        """Members of this round whose reply is not there yet."""
        self._replied: dict[object, asyncio.Future[None]] = {}
        """Members of this round that wait for the others' replies."""
        self.rounds = 0
        """Batches so far."""

    @asynccontextmanager
    async def turn(self, member: object) -> AsyncIterator[None]:
        """Ask in the block: it begins with the next batch, and is left when the batch has all its replies."""
        self._members.add(member)
        await self._wait(self._ready, member)
        try:
            yield
        except BaseException:
            self.leave(member)
            raise
        self._asked.discard(member)
        await self._wait(self._replied, member)

    def leave(self, member: object) -> None:
        """Whoever does not ask again is waited for no more. Safe to call twice."""
        self._members.discard(member)
        self._asked.discard(member)
        self._ready.pop(member, None)
        self._replied.pop(member, None)
        self._go_on()

    async def _wait(self, line: dict[object, asyncio.Future[None]], member: object) -> None:
        place = line[member] = asyncio.get_running_loop().create_future()
        self._go_on()
        try:
            await place
        except asyncio.CancelledError:
            self.leave(member)
            raise

    def _go_on(self) -> None:
        """Let a batch act that has all its replies; begin one for which all are ready."""
        if self._asked:
            return
        replied, self._replied = self._replied, {}
        _release(replied)
        if self._ready and self._ready.keys() == self._members and not replied:
            ready, self._ready = self._ready, {}
            self._asked = set(ready)
            self.rounds += 1
            _release(ready)


def _release(line: dict[object, asyncio.Future[None]]) -> None:
    for place in line.values():
        if not place.done():
            place.set_result(None)
