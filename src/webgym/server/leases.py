"""Leases: the right to use a slot for a limited time. Every call is checked against its lease.

A lease has an id, a secret and a generation. A call without all three gets ``lease_lost`` and has no effect.
A lease that is not renewed within its time to live expires.
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
from webgym.core.background import BackgroundTasks
from webgym.core.errors import LeaseLost
from webgym.server.admission import Permit

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(eq=False)
class Lease:
    """The right to use a slot.

    Attributes:
        id: session id.
        secret: proves that a caller holds the lease.
        generation: number of the lease among all leases of the server.
        slot: the slot.
        ttl_seconds: time to live without renewal.
        expires: when it expires unless it is renewed, event loop time.
        ends: when it ends even if it is renewed, event loop time.
        permit: run permit of its current or last call.
        is_over: whether it has ended, so that no further call may start.
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
    """Set when no call of the lease uses the slot any more."""
    _turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    _running: asyncio.Task[Any] | None = None

    def renew(self) -> float:
        """Restart the time to live. Returns the remaining seconds."""
        now = asyncio.get_running_loop().time()
        self.expires = min(now + self.ttl_seconds, self.ends)
        return self.expires - now

    @property
    def is_busy(self) -> bool:
        """Whether a call runs or waits for its turn."""
        return self._turn.locked()

    async def run(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Do one call's work, after earlier calls of the session have ended.

        The work runs in a task of its own. If the caller is cancelled, however often, the work is cancelled;
        the next call starts only when the work has really ended.

        Raises:
            LeaseLost: the lease ended before or during the call.
        """
        caller = asyncio.current_task()
        assert caller is not None
        try:
            return await asyncio.get_running_loop().create_task(self._run_exclusively(work))
        except asyncio.CancelledError:
            if self.is_over and not caller.cancelling():
                raise _lease_lost() from None
            raise

    async def _run_exclusively(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        async with self._turn:
            if self.is_over:
                raise _lease_lost()
            self._running = asyncio.current_task()
            try:
                return await work()
            finally:
                self._running = None
                self.renew()

    async def end(self) -> None:
        """Cancel a running call and wait until no call of the lease uses the slot."""
        self.is_over = True
        if self._running is not None:
            self._running.cancel()
        async with self._turn:  # waiting calls find that the lease is over
            pass


def _lease_lost() -> LeaseLost:
    return LeaseLost("the session ended", hint="open a new one")


class Leases:
    """All leases of one server.

    Args:
        take_back: called with the slot of a lease that has ended.
        name: name of this server among others; its session ids begin with it.
        check_seconds: longest interval between two checks, by which a pause of the whole process is noticed.
    """

    def __init__(
        self, take_back: Callable[[Slot], Awaitable[None]], name: str = "", *, check_seconds: float = 1.0
    ) -> None:
        self._take_back = take_back
        self._check_seconds = check_seconds
        self._prefix = f"{name}-" if name else ""
        self._leases: dict[str, Lease] = {}
        self.granted = 0
        """Number of leases granted so far, which is the generation of the newest."""
        self.on_end: Callable[[str], None] = lambda _: None
        """Called with the id of every lease that ends."""
        self._changed = asyncio.Event()
        self._reaper: asyncio.Task[None] | None = None
        self._endings = BackgroundTasks()
        self.expired = 0

    def start(self) -> None:
        """Start ending leases that are not renewed."""
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
        """Ids of the open leases."""
        return tuple(self._leases)

    def grant(self, slot: Slot, ttl_seconds: float, session_seconds: float) -> Lease:
        """Create a lease of a slot, whose earlier leases have all ended."""
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
        """The lease that a caller holds, renewed.

        Raises:
            LeaseLost: there is no such lease, or secret or generation are wrong.
        """
        lease = self._leases.get(session_id)
        proven = lease is not None and hmac.compare_digest(lease.secret.encode(), secret.encode())
        if lease is None or not proven or generation != str(lease.generation):
            raise LeaseLost("the session expired, was closed, or is not yours", hint="open a new one")
        lease.renew()
        return lease

    async def end(self, lease: Lease) -> None:
        """End a lease. When this returns, no call of it uses the slot any more, which is taken back in the
        background. Safe to call twice; not undone by cancellation."""
        if self._leases.pop(lease.id, None) is not None:
            self.on_end(lease.id)
            self._endings.start(self._end(lease))
        await lease.over.wait()

    async def _end(self, lease: Lease) -> None:
        await lease.end()
        lease.over.set()
        try:
            await self._take_back(lease.slot)
        except Exception:  # this is a background task, so the error is only logged
            log.exception("the slot of session %s could not be taken back", lease.id)

    async def _reap(self) -> None:
        """End leases that are not renewed. Checks when the next lease may expire, and at least at the
        interval."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            now = loop.time()
            if now - due > self._check_seconds:
                self._extend_all(now - due)
            for lease in tuple(self._leases.values()):
                if lease.expires <= now and (not lease.is_busy or lease.ends <= now):
                    self.expired += 1
                    log.warning("session %s was not renewed and has expired", lease.id)
                    del self._leases[lease.id]
                    self.on_end(lease.id)
                    self._endings.start(self._end(lease))
            self._changed.clear()
            ends = (lease.ends if lease.is_busy else lease.expires for lease in self._leases.values())
            due = min([*ends, now + self._check_seconds])
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(due):
                    await self._changed.wait()

    def _extend_all(self, seconds: float) -> None:
        """Extend all leases after a pause of this process (stopped, or starved), which missed heartbeats."""
        log.warning("the server was paused for %.1f s; its leases are extended by that time", seconds)
        now = asyncio.get_running_loop().time()
        for lease in self._leases.values():
            grace = min(now + min(seconds, lease.ttl_seconds), lease.ends)
            lease.expires = max(lease.expires, grace)
