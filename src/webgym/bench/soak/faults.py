"""What goes wrong meanwhile: processes killed and stopped, connections, the disk."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
from collections.abc import Awaitable, Callable
from random import Random

from webgym.bench.soak.books import Books
from webgym.bench.soak.callers import stop_halfway, vanish
from webgym.bench.soak.disk import Disk
from webgym.bench.soak.leaks import Process, processes_of
from webgym.bench.soak.target import Target

log = logging.getLogger(__name__)

_STANDSTILL_SECONDS = 3.0
_FULL_SECONDS = 3.0

Fault = Callable[[], Awaitable[bool]]


class Faults:
    """Makes one fault after the other happen, at random.

    Args:
        disk: where the browsers' profiles are.
        seed: of the order, and of the victims.
    """

    def __init__(self, target: Target, books: Books, disk: Disk, seed: str) -> None:
        self._target = target
        self._books = books
        self._disk = disk
        self._random = Random(seed)
        self._over = asyncio.Event()
        self._kinds: dict[str, tuple[int, Fault]] = {
            "browser killed": (4, lambda: self._strike("browser", signal.SIGKILL)),
            "browser's whole group killed": (2, lambda: self._strike("browser", signal.SIGKILL, group=True)),
            "renderer killed": (4, lambda: self._strike("renderer", signal.SIGKILL)),
            "GPU process killed": (3, lambda: self._strike("gpu-process", signal.SIGKILL)),
            "zygote killed": (1, lambda: self._strike("zygote", signal.SIGKILL)),
            "browser stopped": (2, lambda: self._strike("browser", signal.SIGSTOP, while_it_runs=True)),
            "renderer stopped": (2, lambda: self._strike("renderer", signal.SIGSTOP, while_it_runs=True)),
            "worker killed": (1, lambda: self._strike("worker", signal.SIGKILL)),
            "worker stopped": (1, lambda: self._strike("worker", signal.SIGSTOP)),
            "gateway stood still": (1, self._stand_still),
            "gateway killed, started again": (1, self._restart),
            "client vanished": (4, self._vanish),
            "half-open connection": (3, self._stop_halfway),
            "disk full": (1, self._fill_disk),
        }
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, seconds: float) -> None:
        """Let faults happen for so long, at the plan's rate, and wait until those that take time are over.

        Every kind comes once before any comes twice, as far as the time allows.
        """
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds
        first = list(self._kinds)
        self._random.shuffle(first)
        names = list(self._kinds)
        weights = [weight for weight, _ in self._kinds.values()]
        try:
            while True:
                pause = self._random.expovariate(self._target.plan.faults / 60)
                if loop.time() + pause >= end:
                    break
                await asyncio.sleep(pause)
                name = first.pop() if first else self._random.choices(names, weights)[0]
                if await self._kinds[name][1]():
                    self._books.faults[name] += 1
            await asyncio.sleep(max(0.0, end - loop.time()))
        finally:
            self._over.set()
            await asyncio.gather(*self._tasks)

    async def _processes(self) -> list[Process]:
        return await asyncio.to_thread(processes_of, self._target.pid)

    async def _strike(
        self, kind: str, number: signal.Signals, *, group: bool = False, while_it_runs: bool = False
    ) -> bool:
        """Send a signal to one of the kind. Whether there was one."""
        found = [
            one
            for one in await self._processes()
            if one.kind == kind and (one.is_running or not while_it_runs)
        ]
        if not found:
            return False
        victim = self._random.choice(found)
        try:
            if group:
                os.killpg(victim.group, number)
            else:
                os.kill(victim.pid, number)
        except ProcessLookupError:
            return False
        return True

    async def _stand_still(self) -> bool:
        os.kill(self._target.pid, signal.SIGSTOP)
        try:
            await asyncio.sleep(_STANDSTILL_SECONDS)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._target.pid, signal.SIGCONT)
        return True

    async def _restart(self) -> bool:
        await self._target.kill()
        self._target.opened_before = self._books.opened
        await self._target.start()
        return True

    async def _vanish(self) -> bool:
        going = vanish(self._target, self._books, self._random, self._over)
        return self._in_background("client vanished", going)

    async def _stop_halfway(self) -> bool:
        return self._in_background(
            "half-open connection", stop_halfway(self._target, self._books, self._random)
        )

    async def _fill_disk(self) -> bool:
        if not self._disk.can_be_filled:
            return False
        try:
            await asyncio.to_thread(self._disk.fill)
            await asyncio.sleep(_FULL_SECONDS)
        finally:
            self._disk.clear()
        return True

    def _in_background(self, name: str, work: Awaitable[bool]) -> bool:
        """Let it happen while other faults do. It is counted when it is over."""

        async def done() -> None:
            if await work:
                self._books.faults[name] += 1

        task = asyncio.get_running_loop().create_task(done())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return False
