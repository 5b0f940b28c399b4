"""No sequence of opening, calling, closing, expiring, leaving and forging lets a holder touch a page that is
not its own: checked at every moment of every call, for sequences that hypothesis thinks of."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.errors import LeaseLost
from webgym.server.leases import Lease, Leases

FOREVER = 1e6
SLOTS = 2
CLEANING = 3
"""Turns of the event loop that it takes to clean a slot."""

Act: TypeAlias = tuple[str, int, int, int]
"""What happens, to which of those that ever were, and two numbers that shape it."""


class Page(Slot):
    """A slot that knows whose it is, and who is at it at this moment."""

    def __init__(self) -> None:
        super().__init__(BrowserConfig(), Path("/bin/false"), ProfileRoot(), Egress())
        self.owner = ""
        self._at_it = ""

    @contextlib.contextmanager
    def touched_by(self, who: str) -> Iterator[None]:
        assert not self._at_it, f"{who} and {self._at_it} at the same page"
        self._at_it = who
        try:
            yield
        finally:
            self._at_it = ""


class World:
    """Real leases, and clients who do what they should not."""

    def __init__(self) -> None:
        self.leases = Leases(self._clean)
        self.free: list[Page] = [Page() for _ in range(SLOTS)]
        self.granted: list[Lease] = []
        self.calls: list[asyncio.Task[None]] = []

    async def _clean(self, slot: Slot) -> None:
        assert isinstance(slot, Page)
        with slot.touched_by("the server"):
            slot.owner = ""
            for _ in range(CLEANING):
                await asyncio.sleep(0)
        self.free.append(slot)

    async def do(self, act: Act) -> None:
        what, which, one, two = act
        if what == "open":
            self._open()
        elif what == "wait":
            for _ in range(one):
                await asyncio.sleep(0)
        elif what == "leave" and self.calls:
            self.calls[which % len(self.calls)].cancel()
        elif self.granted:
            lease = self.granted[which % len(self.granted)]
            if what == "call":
                self.calls.append(asyncio.create_task(self._call(lease, one, two)))
            elif what == "close":
                self.calls.append(asyncio.create_task(self._close(lease)))
            elif what == "expire":
                lease.expires = 0
                self.leases._changed.set()
            elif what == "forge":
                self._forge(lease, self.granted[one % len(self.granted)])

    def _open(self) -> None:
        if self.free:
            page = self.free.pop()
            assert page.owner == ""
            lease = self.leases.grant(page, FOREVER, FOREVER)
            page.owner = lease.id
            self.granted.append(lease)

    async def _call(self, known: Lease, length: int, stubborn: int) -> None:
        """One call with what a holder once got; its page may take a few cancellations to let go."""
        lease = self.leases.check(known.id, known.secret, str(known.generation))
        await asyncio.sleep(0)  # its body comes in
        await lease.run(lambda: self._work(lease, length, stubborn))

    async def _work(self, lease: Lease, length: int, stubborn: int) -> None:
        page = lease.slot
        assert isinstance(page, Page)
        with page.touched_by(lease.id):
            for _ in range(length):
                assert page.owner == lease.id
                try:
                    await asyncio.sleep(0)
                except asyncio.CancelledError:
                    stubborn -= 1
                    if stubborn < 0:
                        raise
            assert page.owner == lease.id

    async def _close(self, known: Lease) -> None:
        await self.leases.end(self.leases.check(known.id, known.secret, str(known.generation)))

    def _forge(self, mine: Lease, other: Lease) -> None:
        """Parts of one lease with parts of another open nothing."""
        if mine is other:
            return
        for attempt in (
            (other.id, mine.secret, str(other.generation)),
            (other.id, other.secret, str(mine.generation)),
            (other.id, "", str(other.generation)),
            (other.id, other.secret, ""),
            (other.id, other.secret, f" {other.generation}"),
            (mine.id, other.secret, str(other.generation)),
        ):
            with pytest.raises(LeaseLost):
                self.leases.check(*attempt)


async def live(acts: list[Act]) -> None:
    world = World()
    world.leases.start()
    for act in acts:
        await world.do(act)
    await world.leases.stop()
    for ended in await asyncio.gather(*world.calls, return_exceptions=True):
        if ended is not None and not isinstance(ended, LeaseLost | asyncio.CancelledError):
            raise ended
    assert len(world.free) == SLOTS, "every slot came back, once"
    assert len(set(world.free)) == SLOTS
    assert len(world.leases) == 0
    for lease in world.granted:
        with pytest.raises(LeaseLost):
            world.leases.check(lease.id, lease.secret, str(lease.generation))


NAMES = ("open", "call", "close", "expire", "leave", "forge", "wait")
small = st.integers(0, 6)
acts = st.lists(st.tuples(st.sampled_from(NAMES), small, small, small), max_size=40)


def read(script: str) -> list[Act]:
    """Acts in words, divided by commas."""
    words = (act.split() for act in script.split(", "))
    return [(what, int(which), int(one), int(two)) for what, which, one, two in words]


LEFT_TWICE = read(
    "open 0 0 0, call 0 6 6, wait 0 3 0, leave 0 0 0, wait 0 1 0, leave 0 0 0, close 0 0 0, wait 0 1 0"
)
"""A caller is cancelled while its cancelled work still cleans up: the page must not be given on before."""

EXPIRED_AND_CLOSED = read(
    "open 0 0 0, call 0 6 0, call 0 6 0, wait 0 2 0, expire 0 0 0, "
    "close 0 0 0, wait 0 6 0, open 0 0 0, call 0 3 0"
)


@settings(derandomize=True, max_examples=400, deadline=None)
@example(LEFT_TWICE)
@example(EXPIRED_AND_CLOSED)
@given(acts)
def test_no_holder_touches_a_page_that_is_not_its_own(acts: list[Act]) -> None:
    asyncio.run(live(acts))
