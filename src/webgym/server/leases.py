"""Who may use which slot, and until when. Every call is checked against its lease.

A lease has an id, a secret and a generation (of the slot). Whoever does not name all three gets
``lease_lost`` and touches nothing. A lease that is not renewed within its time to live is taken back.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
import secrets
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, TypeVar

from webgym.browser.slot import Slot
from webgym.core.errors import LeaseLost
from webgym.server.admission import Permit

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(eq=False)
class Lease:
    """The right to use a slot.

    Attributes:
        ttl_seconds: time to live without renewal.
        expires: when it runs out, on the loop's clock.
        ends: when it runs out for good, renewed or not.
        permit: of its call, or of its last one.
    """

    id: str
    secret: str
    generation: int
    slot: Slot
    ttl_seconds: float
    expires: float
    ends: float
    permit: Permit | None = None
    is_over: bool = False
    over: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when nothing of the lease touches the slot any more."""
    _turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    _running: asyncio.Task[Any] | None = None

    def renew(self) -> float:
        """Start the time to live anew. Returns the remaining seconds."""
        now = asyncio.get_running_loop().time()
        self.expires = min(now + self.ttl_seconds, self.ends)
        return self.expires - now

    @property
    def is_busy(self) -> bool:
        """Whether a call runs or waits for its turn."""
        return self._turn.locked()

    async def run(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Do one call's work when its turn has come: one session's calls never overlap.

        The turn is the work's own, not the caller's. A caller that is cancelled, however often, cancels the
        work; the turn is over when the work has really ended.

        Raises:
            LeaseLost: the lease ended before or meanwhile.
        """
        caller = asyncio.current_task()
        assert caller is not None
        try:
            return await asyncio.get_running_loop().create_task(self._in_turn(work))
        except asyncio.CancelledError:
            if self.is_over and not caller.cancelling():
                raise _lost() from None
            raise

    async def _in_turn(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        async with self._turn:
            if self.is_over:
                raise _lost()
            self._running = asyncio.current_task()
            try:
                return await work()
            finally:
                self._running = None
                self.renew()

    async def end(self) -> None:
        """Cut a running call off and wait until nothing of the lease touches the slot."""
        self.is_over = True
        if self._running is not None:
            self._running.cancel()
        async with self._turn:  # those in line find the lease over
            pass


def _lost() -> LeaseLost:
    return LeaseLost("the session ended", hint="open a new one")


class Leases:
    """All leases of one server.

    Args:
        take_back: what becomes of a slot whose lease ended.
        name: of this server among others; its session ids begin with it.
        look_seconds: between two looks; a pause of the whole process is noticed by it.
    """

    def __init__(
        self, take_back: Callable[[Slot], Awaitable[None]], name: str = "", *, look_seconds: float = 1.0
    ) -> None:
        self._take_back = take_back
        self._look_seconds = look_seconds
        self._prefix = f"{name}-" if name else ""
        self._leases: dict[str, Lease] = {}
        self.granted = 0
        """How many so far. Every lease takes the next number for its generation."""
        self.on_end: Callable[[str], None] = lambda _: None
        """Called with the id of every lease that ends, when it does."""
        self._changed = asyncio.Event()
        self._reaper: asyncio.Task[None] | None = None
        self._endings: set[asyncio.Task[None]] = set()
        self.expired = 0

    def start(self) -> None:
        """Start taking back what is not renewed."""
        self._reaper = asyncio.get_running_loop().create_task(self._reap())

    async def stop(self) -> None:
        """End every lease."""
        if self._reaper is not None:
            self._reaper.cancel()
            await asyncio.wait({self._reaper})
        await asyncio.gather(*(self.end(lease) for lease in tuple(self._leases.values())))
        await asyncio.gather(*self._endings)

    def __len__(self) -> int:
        return len(self._leases)

    def __contains__(self, session_id: str) -> bool:
        return session_id in self._leases

    @property
    def ids(self) -> tuple[str, ...]:
        """Of the living leases."""
        return tuple(self._leases)

    def grant(self, slot: Slot, ttl_seconds: float, session_seconds: float) -> Lease:
        """A new lease of a slot, whose earlier ones have all ended."""
        self.granted += 1
        now = asyncio.get_running_loop().time()
        lease = Lease(
            id=self._prefix + secrets.token_hex(8),
            secret=secrets.token_urlsafe(24),
            generation=self.granted,
            slot=slot,
            ttl_seconds=ttl_seconds,
            expires=now + min(ttl_seconds, session_seconds),
            ends=now + session_seconds,
        )
        self._leases[lease.id] = lease
        self._changed.set()
        return lease

    def check(self, session_id: str, secret: str, generation: str) -> Lease:
        """The lease that a caller holds.

        Raises:
            LeaseLost: there is none, or the caller does not hold it.
        """
        lease = self._leases.get(session_id)
        proven = lease is not None and hmac.compare_digest(lease.secret.encode(), secret.encode())
        if lease is None or not proven or generation != str(lease.generation):
            raise LeaseLost("the session expired, was closed, or is not yours", hint="open a new one")
        lease.renew()
        return lease

    async def end(self, lease: Lease) -> None:
        """End a lease: when this returns, nothing of it touches the slot any more, which is taken back in
        the background. Safe to call twice; not undone by cancellation."""
        if self._leases.pop(lease.id, None) is not None:
            self.on_end(lease.id)
            self._in_background(lease)
        await lease.over.wait()

    def _in_background(self, lease: Lease) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(self._end(lease))
        self._endings.add(task)
        task.add_done_callback(self._endings.discard)
        return task

    async def _end(self, lease: Lease) -> None:
        await lease.end()
        lease.over.set()
        try:
            await self._take_back(lease.slot)
        except Exception:  # nobody waits for it, so here is where it is said
            log.exception("the slot of session %s was not taken back as it should", lease.id)

    async def _reap(self) -> None:
        """Take back what is not renewed. Looks when the next lease can run out, and every so often anyway."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            now = loop.time()
            if now - due > self._look_seconds:
                self._pass_over(now - due)
            for lease in tuple(self._leases.values()):
                if lease.expires <= now and (not lease.is_busy or lease.ends <= now):
                    self.expired += 1
                    log.warning("session %s was not renewed and is taken back", lease.id)
                    del self._leases[lease.id]
                    self.on_end(lease.id)
                    self._in_background(lease)
            self._changed.clear()
            ends = (lease.ends if lease.is_busy else lease.expires for lease in self._leases.values())
            due = min([*ends, now + self._look_seconds])
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(due):
                    await self._changed.wait()

    def _pass_over(self, seconds: float) -> None:
        """This process stood still (stopped, or starved): heartbeats were sent, and nobody heard them."""
        log.warning("the server stood still for %.1f s; so long holders have to renew their leases", seconds)
        now = asyncio.get_running_loop().time()
        for lease in self._leases.values():
            grace = min(now + min(seconds, lease.ttl_seconds), lease.ends)
            lease.expires = max(lease.expires, grace)
