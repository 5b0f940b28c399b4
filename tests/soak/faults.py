"""Random faults: killed and stopped processes, broken connections, a full disk; and clients that vanish."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
from collections.abc import Awaitable, Callable
from random import Random

import httpx
from tests.soak.counts import Counts
from tests.soak.disk import Disk
from tests.soak.leaks import Process, processes_of
from tests.soak.target import Target

from webgym.core.background import BackgroundTasks
from webgym.server.messages import GENERATION_HEADER, SECRET_HEADER, error_of

log = logging.getLogger(__name__)

_STANDSTILL_SECONDS = 3.0
_FULL_SECONDS = 3.0

Fault = Callable[[], Awaitable[bool]]


class Faults:
    """Causes random faults.

    Args:
        target: the server.
        counts: to update.
        disk: of the browsers' profiles.
        seed: of the choice of faults and processes.
    """

    def __init__(self, target: Target, counts: Counts, disk: Disk, seed: str) -> None:
        self._target = target
        self._counts = counts
        self._disk = disk
        self._random = Random(seed)
        self._over = asyncio.Event()
        self._kinds: dict[str, tuple[int, Fault]] = {
            "browser killed": (4, lambda: self._signal("browser", signal.SIGKILL)),
            "browser's whole group killed": (2, lambda: self._signal("browser", signal.SIGKILL, group=True)),
            "renderer killed": (4, lambda: self._signal("renderer", signal.SIGKILL)),
            "GPU process killed": (3, lambda: self._signal("gpu-process", signal.SIGKILL)),
            "zygote killed": (1, lambda: self._signal("zygote", signal.SIGKILL)),
            "browser stopped": (2, lambda: self._signal("browser", signal.SIGSTOP, while_it_runs=True)),
            "renderer stopped": (2, lambda: self._signal("renderer", signal.SIGSTOP, while_it_runs=True)),
            "worker killed": (1, lambda: self._signal("worker", signal.SIGKILL)),
            "worker stopped": (1, lambda: self._signal("worker", signal.SIGSTOP)),
            "gateway stood still": (1, self._stand_still),
            "gateway killed, started again": (1, self._restart),
            "client vanished": (4, self._vanish),
            "half-open connection": (3, self._stop_halfway),
            "disk full": (1, self._fill_disk),
        }
        self._tasks = BackgroundTasks()
        self._stopped: set[int] = set()

    async def run(self, seconds: float) -> None:
        """Cause faults at the plan's rate for some time, and wait until the last of them are over.

        Every kind of fault is caused once before any is caused twice, if there is enough time.
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
                    self._counts.faults[name] += 1
            await asyncio.sleep(max(0.0, end - loop.time()))
        except BaseException:  # interrupted: a stopped worker would not see that its gateway ends
            for pid in self._stopped:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
            raise
        finally:
            self._over.set()
            await asyncio.gather(*self._tasks)

    async def _processes(self) -> list[Process]:
        return await asyncio.to_thread(processes_of, self._target.pid)

    async def _signal(
        self, kind: str, number: signal.Signals, *, group: bool = False, while_it_runs: bool = False
    ) -> bool:
        """Send a signal to a random process of a kind.

        Args:
            kind: see :class:`tests.soak.leaks.Process`.
            number: the signal.
            group: whether to signal the process group.
            while_it_runs: whether to leave out stopped processes.

        Returns:
            Whether there was such a process.
        """
        candidates = [
            process
            for process in await self._processes()
            if process.kind == kind and (process.is_running or not while_it_runs)
        ]
        if not candidates:
            return False
        victim = self._random.choice(candidates)
        try:
            if group:
                os.killpg(victim.group, number)
            else:
                os.kill(victim.pid, number)
        except ProcessLookupError:
            return False
        if number == signal.SIGSTOP:
            self._stopped.add(victim.pid)
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
        self._target.opened_before = self._counts.opened
        await self._target.start()
        return True

    async def _vanish(self) -> bool:
        work = vanish(self._target, self._counts, self._random, self._over)
        return self._in_background("client vanished", work)

    async def _stop_halfway(self) -> bool:
        return self._in_background(
            "half-open connection", stop_halfway(self._target, self._counts, self._random)
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
        """Run a fault in the background; it is counted when it is over. Returns false: not counted yet."""

        async def done() -> None:
            if await work:
                self._counts.faults[name] += 1

        self._tasks.start(done())
        return False


_TTL_SECONDS = 2.0
_ANSWER_SECONDS = 60.0
_CLOSED_SECONDS = 20.0
"""Time limit until the server must have closed a half-open connection; it waits two seconds for the rest."""


async def vanish(target: Target, counts: Counts, random: Random, over: asyncio.Event) -> bool:
    """Open a session and drop it: by closing the connection, by silence, or in the middle of a step.

    Returns:
        Whether a session was opened.
    """
    headers = {"authorization": f"Bearer {target.token}"}
    async with httpx.AsyncClient(
        base_url=target.url, headers=headers, timeout=_ANSWER_SECONDS, trust_env=False
    ) as http:
        try:
            response = await http.post("/v1/sessions", json={"ttl_seconds": _TTL_SECONDS})
        except httpx.HTTPError:
            return False  # killed: whether it opened a session is unknown, even to itself
        if response.status_code != httpx.codes.OK:
            counts.count_refused(error_of(response.content, response.status_code, "the server"))
            return False
        counts.opened += 1
        counts.vanished += 1
        grant = response.json()
        how = random.choice(("closed", "silence", "in a step"))
        if how == "in a step":
            proof = {SECRET_HEADER: grant["secret"], GENERATION_HEADER: str(grant["generation"])}
            step = {"action": {"name": "wait", "time": 3}}
            with contextlib.suppress(httpx.HTTPError):
                await http.post(
                    f"/v1/sessions/{grant['session_id']}/step", json=step, headers=proof, timeout=1.0
                )
        elif how == "silence":
            await over.wait()  # the connection stays open without data
    return True


async def stop_halfway(target: Target, counts: Counts, random: Random) -> bool:
    """Send a part of a request and wait until the server closes the connection.

    Returns:
        Whether the server accepted the connection.
    """
    host, port = target.url.removeprefix("http://").split(":")
    try:
        reader, writer = await asyncio.open_connection(host, int(port))
    except OSError:
        return False  # the gateway is down
    counts.half_open += 1
    whole = (
        f"POST /v1/sessions HTTP/1.1\r\nhost: localhost\r\nauthorization: Bearer {target.token}\r\n"
        "content-length: 100\r\n\r\n"
    ).encode()
    writer.write(random.choice((b"", whole[: len(whole) // 2], whole + b'{"mode":')))
    try:
        async with asyncio.timeout(_CLOSED_SECONDS):
            response = await reader.read()
    except ConnectionError:
        response = b""
    except TimeoutError:
        return True
    finally:
        writer.transport.abort()
    if response:
        counts.untyped.append(f"an incomplete request got a response: {response[:80]!r}")
    counts.hung_up_on += 1
    return True
