"""Instances: the names by which clients of the compatibility layer refer to browsers.

An instance has at most one session, and ends with its lifetime. ``reset`` releases its session at once; the
name stays valid, and the next call with it gets a fresh session. An instance whose browser failed reports
that until it is reset.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from webgym.core.background import BackgroundTasks
from webgym.core.errors import BrowserError, LeaseLost, WebGymError
from webgym.server.client import BrowserClient, Session
from webgym.server.messages import SessionOptions

log = logging.getLogger(__name__)

_OPTIONS = SessionOptions(mode="marks", capture_scale=1.0)
"""Screenshots without marks are available in this mode too."""

VIEWPORT = _OPTIONS.viewport

RESET_IDLE_SECONDS = 600.0
"""Idle time after which an instance ends that was used again after its reset: the authors' clients release an
instance with ``/reset``, and a late call must not keep a browser for the rest of its lifetime. Longer than a
model thinks."""

INSTANCES = 10_000
"""Largest number of instances, including those without a browser, of which the oldest are dropped first."""


class NoInstance(LeaseLost):
    """There is no instance with this id, or it has ended."""

    code = "compat_no_instance"


@dataclass(eq=False)
class Instance:
    """A client's name for a browser.

    Attributes:
        ends: end of its lifetime, event loop time.
        id: the name.
        session: ``None`` between a reset and the next call, and after a failure.
        shown: the elements in the last screenshot with marks.
        resets: number of resets; a call that waited during one is refused.
        failure: why its browser is gone; empty if it is not.
        used: when its last call ended, event loop time.
        is_over: whether it has ended.
        turn: held by the running call.
    """

    ends: float
    id: str = field(default_factory=lambda: str(uuid.uuid4()))
    session: Session | None = None
    shown: dict[str, Any] | None = None
    resets: int = 0
    failure: str = ""
    used: float = 0.0
    is_over: bool = False
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class Instances:
    """All instances of one layer. An async context manager, which releases all sessions at its end.

    Args:
        client: the client of the server behind the layer.
    """

    def __init__(self, client: BrowserClient) -> None:
        self.client = client
        self._instances: dict[str, Instance] = {}
        self._changed = asyncio.Event()
        self._reaper: asyncio.Task[None] | None = None
        self._endings = BackgroundTasks()

    async def __aenter__(self) -> Instances:
        self._reaper = asyncio.create_task(self._reap())
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._reaper is not None
        self._reaper.cancel()
        await asyncio.wait({self._reaper})
        for instance in tuple(self._instances.values()):
            self.end(instance)
        await asyncio.gather(*self._endings)

    @property
    def held(self) -> list[str]:
        """Ids of the instances that have a browser at this moment."""
        return [instance.id for instance in self._instances.values() if instance.session is not None]

    # --- life ---------------------------------------------------------------------------------------

    async def create(self, lifetime_minutes: float) -> Instance:
        """Create an instance with a fresh, blank page.

        Raises:
            NoCapacity: no browser became free in time.
        """
        session = await self.client.open(_OPTIONS)
        now = asyncio.get_running_loop().time()
        instance = Instance(now + lifetime_minutes * 60, session=session, used=now)
        self._instances[instance.id] = instance
        idle = (each for each in tuple(self._instances.values()) if each.session is None)
        while len(self._instances) > INSTANCES and (oldest := next(idle, None)):
            self.end(oldest)
        self._changed.set()
        return instance

    def find(self, instance_id: str) -> Instance:
        """The instance with this id.

        Raises:
            NoInstance: there is none.
        """
        instance = self._instances.get(instance_id)
        if instance is None:
            raise NoInstance(
                f"instance not found: {instance_id[:80]} does not exist, or its lifetime is over",
                hint="create another with /get",
            )
        return instance

    async def reset(self, instance_id: str) -> None:
        """Release the instance's browser with all its state. Calls that wait for it are refused."""
        instance = self.find(instance_id)
        session, instance.session = instance.session, None
        instance.resets += 1
        instance.failure, instance.shown = "", None
        if session is not None:
            await asyncio.shield(self._endings.start(session.close()))

    def end(self, instance: Instance) -> None:
        """End an instance; its browser is released in the background."""
        if self._instances.pop(instance.id, None) is None:
            return
        instance.is_over = True
        session, instance.session = instance.session, None
        if session is not None:
            self._endings.start(session.close())

    # --- use ----------------------------------------------------------------------------------------

    @asynccontextmanager
    async def using(self, instance_id: str) -> AsyncIterator[tuple[Instance, Session]]:
        """Use an instance for one call: calls of one instance never overlap.

        Raises:
            NoInstance: there is none, or it ended or was reset while this call waited.
            BrowserError: its browser failed earlier.
        """
        instance = self.find(instance_id)
        resets = instance.resets
        async with instance.turn:
            self._check(instance, resets)
            session = instance.session or await self._reopen(instance, resets)
            try:
                yield instance, session
            except (BrowserError, LeaseLost) as error:
                if instance.session is not session:  # it was released during this call
                    self._check(instance, resets)
                    raise
                instance.failure, instance.session = error.message, None
                self._endings.start(session.close())
                raise
            finally:
                instance.used = asyncio.get_running_loop().time()

    def _check(self, instance: Instance, resets: int) -> None:
        if instance.is_over or instance.resets != resets:
            raise NoInstance(f"instance not found: {instance.id} ended or was reset during the call")
        if instance.failure:
            raise BrowserError(
                f"the instance's browser is gone: {instance.failure}", hint="/reset gives it a fresh one"
            )

    async def _reopen(self, instance: Instance, resets: int) -> Session:
        session = await self.client.open(_OPTIONS)
        try:
            self._check(instance, resets)
        except WebGymError:
            await asyncio.shield(self._endings.start(session.close()))
            raise
        instance.session = session
        self._changed.set()
        return session

    # --- the reaper ---------------------------------------------------------------------------------

    def _deadline(self, instance: Instance) -> float:
        """When an instance ends unless it is used again, event loop time."""
        is_reused = instance.resets > 0 and instance.session is not None
        if not is_reused:
            return instance.ends
        now = asyncio.get_running_loop().time()
        used = now if instance.turn.locked() else instance.used
        return min(instance.ends, used + RESET_IDLE_SECONDS)

    async def _reap(self) -> None:
        """End instances at their deadlines. Sleeps until the next deadline."""
        loop = asyncio.get_running_loop()
        while True:
            self._changed.clear()
            for instance in tuple(self._instances.values()):
                if self._deadline(instance) <= loop.time():
                    log.warning("instance %s was not released and has expired", instance.id)
                    self.end(instance)
            soonest = min(map(self._deadline, self._instances.values()), default=None)
            try:
                async with asyncio.timeout_at(soonest):
                    await self._changed.wait()
            except TimeoutError:
                continue
