"""Which instance holds which session, and until when.

An instance is a client's name for a browser. It ends when its lifetime does. ``reset`` gives its session
back at once; the name stays good, and the next call with it gets a fresh session. An instance whose
browser failed says so until it is reset.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from webgym.core.errors import BrowserError, LeaseLost, WebGymError
from webgym.server.client import BrowserClient, Session
from webgym.server.compat.config import CompatConfig
from webgym.server.messages import SessionOptions

log = logging.getLogger(__name__)

_OPTIONS = SessionOptions(mode="marks")
"""A picture without marks can be had in this mode too."""

VIEWPORT = _OPTIONS.viewport


class NoInstance(LeaseLost):
    """No living instance has this id."""

    code = "compat_no_instance"


@dataclass(eq=False)
class Instance:
    """A browser under the name that a client knows.

    Attributes:
        ends: when its lifetime is over, on the loop's clock.
        session: ``None`` between a reset and the next call, and after a failure.
        shown: what the last picture with marks showed.
        resets: so far; a call that was in line before one is refused.
        failure: why its browser is gone.
        used: when its last call ended.
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
    """All instances of one layer. An async context manager; afterwards every session is given back."""

    def __init__(self, client: BrowserClient, config: CompatConfig) -> None:
        self.client = client
        self.config = config
        self._instances: dict[str, Instance] = {}
        self._changed = asyncio.Event()
        self._reaper: asyncio.Task[None] | None = None
        self._endings: set[asyncio.Task[None]] = set()

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
        """Ids of the instances that hold a browser now."""
        return [instance.id for instance in self._instances.values() if instance.session is not None]

    # --- life ---------------------------------------------------------------------------------------

    async def create(self, lifetime_minutes: float) -> Instance:
        """A new instance with a fresh, blank page.

        Raises:
            NoCapacity: all browsers stayed taken.
        """
        session = await self.client.open(_OPTIONS)
        now = asyncio.get_running_loop().time()
        instance = Instance(now + lifetime_minutes * 60, session=session, used=now)
        self._instances[instance.id] = instance
        self._forget_oldest()
        self._changed.set()
        return instance

    def _forget_oldest(self) -> None:
        while len(self._instances) > self.config.instances:
            idle = next((one for one in self._instances.values() if one.session is None), None)
            if idle is None:
                return
            self.end(idle)

    def find(self, instance_id: str) -> Instance:
        """The living instance that has this id.

        Raises:
            NoInstance: there is none.
        """
        instance = self._instances.get(instance_id)
        if instance is None:
            raise NoInstance(
                f"instance not found: {instance_id[:80]} does not exist, or its lifetime is over",
                hint="ask for another with /get",
            )
        return instance

    async def reset(self, instance_id: str) -> None:
        """Give the instance's browser back, with everything in it. Calls in line for it are refused."""
        instance = self.find(instance_id)
        session, instance.session = instance.session, None
        instance.resets += 1
        instance.failure, instance.shown = "", None
        if session is not None:
            await asyncio.shield(self._in_background(session.close()))

    def end(self, instance: Instance) -> None:
        """The instance is over: its browser is given back in the background."""
        if self._instances.pop(instance.id, None) is None:
            return
        instance.is_over = True
        session, instance.session = instance.session, None
        if session is not None:
            self._in_background(session.close())

    def _in_background(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._endings.add(task)
        task.add_done_callback(self._endings.discard)
        return task

    # --- use ----------------------------------------------------------------------------------------

    @asynccontextmanager
    async def using(self, instance_id: str) -> AsyncIterator[tuple[Instance, Session]]:
        """Hold an instance for one call: calls of one instance never overlap.

        Raises:
            NoInstance: there is none, or it ended or was reset while this call stood in line.
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
                if instance.session is not session:  # it was taken from under this call
                    self._check(instance, resets)
                    raise
                instance.failure, instance.session = error.message, None
                self._in_background(session.close())
                raise
            finally:
                instance.used = asyncio.get_running_loop().time()

    def _check(self, instance: Instance, resets: int) -> None:
        if instance.is_over or instance.resets != resets:
            raise NoInstance(f"instance not found: {instance.id} ended or was reset meanwhile")
        if instance.failure:
            raise BrowserError(
                f"the instance's browser is gone: {instance.failure}", hint="/reset gives it a fresh one"
            )

    async def _reopen(self, instance: Instance, resets: int) -> Session:
        session = await self.client.open(_OPTIONS)
        try:
            self._check(instance, resets)
        except WebGymError:
            await asyncio.shield(self._in_background(session.close()))
            raise
        instance.session = session
        self._changed.set()
        return session

    # --- the reaper ---------------------------------------------------------------------------------

    def _deadline(self, instance: Instance) -> float:
        """When an instance is to be looked at next."""
        is_again = instance.resets > 0 and instance.session is not None
        if not is_again:
            return instance.ends
        now = asyncio.get_running_loop().time()
        used = now if instance.turn.locked() else instance.used
        return min(instance.ends, used + self.config.reset_idle_seconds)

    async def _reap(self) -> None:
        """End what is over. Sleeps until the next one can be."""
        loop = asyncio.get_running_loop()
        while True:
            self._changed.clear()
            for instance in tuple(self._instances.values()):
                if self._deadline(instance) <= loop.time():
                    log.warning("instance %s was not given back and is taken back", instance.id)
                    self.end(instance)
            soonest = min(map(self._deadline, self._instances.values()), default=None)
            try:
                async with asyncio.timeout_at(soonest):
                    await self._changed.wait()
            except TimeoutError:
                continue
