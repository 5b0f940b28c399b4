"""The pool of slots: starts, leases, cleans and replaces them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path

from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.memory import MemoryWatch
from webgym.browser.process import BrowserProcess
from webgym.browser.profiles import ProfileRoot
from webgym.browser.sandbox import SandboxState
from webgym.browser.slot import Slot
from webgym.core.background import BackgroundTasks
from webgym.core.errors import BrowserError, NoCapacity, TooManyWaiting
from webgym.server.config import ServerConfig
from webgym.server.messages import SlotLoad

log = logging.getLogger(__name__)

SWEEP_SECONDS = 30.0
"""Interval at which the files of dead servers are removed from the temporary folder. Servers also do so when
they start; it costs a lock per running server."""


class Pool:
    """A fixed number of slots, each with a fresh page ready.

    The first browser is launched at the start, so that a machine on which none starts fails at once. The
    others follow in the background, a few at a time.

    Args:
        config: the worker's settings.
        executable: the Chromium to run.
    """

    def __init__(self, config: ServerConfig, executable: Path) -> None:
        self.executable = executable
        self._config = config
        self.egress = Egress(config.browser.egress)
        self._profiles = ProfileRoot(config.browser.temporary_root)
        self._slots: list[Slot] = []
        self._free: asyncio.Queue[Slot] = asyncio.Queue()
        self._launches = asyncio.Semaphore(config.parallel_launches)
        self._tasks = BackgroundTasks()
        self._waiting = 0
        self._leased: set[Slot] = set()
        self._failing: dict[Slot, BrowserError] = {}
        self.on_change: Callable[[], None] = lambda: None
        """Called whenever :attr:`load` or :attr:`is_healthy` may have changed."""
        self.memory = MemoryWatch(config.browser, self._browsers)
        self.browser = ""
        self.sandbox = SandboxState(False, "no browser was started yet")

    # --- life ---------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Remove files of dead servers, start the first slot, and the others in the background.

        Raises:
            BrowserLaunchFailed: no browser starts.
        """
        await self._sweep()
        await self.egress.start()
        first = self._new_slot(self._config.browser)
        await self._make_ready(first)
        assert first.sandbox is not None
        self.browser, self.sandbox = first.version, first.sandbox
        self._free.put_nowait(first)
        self._tasks.start(self.memory.run())
        self._tasks.start(self._sweep_periodically())
        for _ in range(self._config.slots - 1):
            self._tasks.start(self._start_slot(self._new_slot(self._config.browser)))

    async def _sweep(self) -> None:
        swept = await asyncio.to_thread(self._profiles.sweep)
        if swept:
            log.warning("removed the files of %d dead server(s)", len(swept))

    async def _sweep_periodically(self) -> None:
        while True:
            await asyncio.sleep(SWEEP_SECONDS)
            try:
                await self._sweep()
            except OSError as error:
                log.error("the files of dead servers cannot be removed: %s", error)

    def _browsers(self) -> list[BrowserProcess]:
        processes = (slot.process for slot in self._slots)
        return [process for process in processes if process is not None and process.is_alive]

    def _new_slot(self, config: BrowserConfig) -> Slot:
        sandbox = self._slots[0].sandbox if self._slots else None
        slot = Slot(config, self.executable, self._profiles, self.egress, sandbox)
        self._slots.append(slot)
        return slot

    async def stop(self) -> None:
        """End every browser."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        ended = await asyncio.gather(*(slot.stop() for slot in self._slots), return_exceptions=True)
        for error in ended:
            if isinstance(error, BaseException):
                log.error("a browser did not end: %s", error)
        await self.egress.stop()

    # --- leasing ------------------------------------------------------------------------------------

    async def acquire(self, seconds: float | None = None) -> Slot:
        """A free slot, first come, first served.

        Args:
            seconds: longest wait; by default ``allocate_seconds``.

        Raises:
            NoCapacity: none became free in time.
            TooManyWaiting: none is free, and the queue is full.
            BrowserLaunchFailed: none can become free, because no browser starts.
        """
        self._check_health()
        seconds = self._config.allocate_seconds if seconds is None else seconds
        if self._free.empty() and self._waiting >= self._config.waiting:
            raise TooManyWaiting.of(self._waiting)
        self._waiting += 1
        self.on_change()
        try:
            async with asyncio.timeout(seconds):
                slot = await self._free.get()
        except TimeoutError:
            self._check_health()
            raise NoCapacity(
                f"all {len(self._slots)} slots were in use for {seconds:g} s",
                hint="close sessions, or start the server with more slots",
            ) from None
        finally:
            self._waiting -= 1
            self.on_change()
        self._leased.add(slot)
        return slot

    def _check_health(self) -> None:
        if not self.is_healthy:
            raise next(iter(self._failing.values()))

    async def clean(self, slot: Slot) -> None:
        """End the slot's episode, and create a fresh page for the next."""
        try:
            await slot.close()
            if not slot.needs_replacement:
                await slot.warm()
        except BrowserError as error:
            log.error("a slot could not be cleaned, its browser is replaced: %s", error)
            await slot.stop()

    def give_back(self, slot: Slot) -> None:
        """Make the slot available again; one without a fresh page gets a new browser first."""
        self._leased.discard(slot)
        if slot.is_warm and not slot.needs_replacement:
            self._make_available(slot)
        else:
            self.on_change()
            self._tasks.start(self._start_slot(slot))

    def _make_available(self, slot: Slot) -> None:
        self._free.put_nowait(slot)
        self.on_change()

    async def _make_ready(self, slot: Slot) -> None:
        await slot.start()
        with slot.awake():
            await slot.warm()

    async def _start_slot(self, slot: Slot) -> None:
        """Start the slot's browser, with as many attempts as necessary, and make the slot available."""
        pause, longest = self._config.relaunch_seconds
        while True:
            try:
                async with self._launches:
                    await self._make_ready(slot)
                break
            except Exception as error:  # whatever it is, the slot must not be lost
                failure = error if isinstance(error, BrowserError) else BrowserError(str(error))
                self._failing[slot] = failure
                self.on_change()
                log.error("a browser did not start, next try in %g s: %s", pause, error)
            await asyncio.sleep(pause)
            pause = min(pause * 2, longest)
        self._failing.pop(slot, None)
        self._make_available(slot)

    # --- state --------------------------------------------------------------------------------------

    @property
    def slots(self) -> tuple[Slot, ...]:
        """All slots."""
        return tuple(self._slots)

    @property
    def is_healthy(self) -> bool:
        """Whether at least one slot works."""
        return len(self._failing) < len(self._slots)

    @property
    def load(self) -> SlotLoad:
        """The slots by state at this moment."""
        free, leased = self._free.qsize(), len(self._leased)
        total = len(self._slots)
        return SlotLoad(total, free, leased, total - free - leased, self._waiting)
