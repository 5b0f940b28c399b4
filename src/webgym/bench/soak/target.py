"""The server under test: a gateway and its workers, in separate processes that can be killed."""

from __future__ import annotations

import asyncio
from asyncio.subprocess import Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import aiohttp
import msgspec
import psutil

from webgym.bench.server_process import start_server, stop_server
from webgym.bench.soak.leaks import Census, leaked, take
from webgym.bench.soak.plan import SoakPlan
from webgym.server.messages import Watched
from webgym.server.operations import WATCH

_POLL_SECONDS = 0.1


class Target:
    """A server that can be killed and started again at the same address.

    Args:
        plan: of the benchmark.
        root: folder of the browsers' profiles.
        executable: of Chromium; ``None`` searches for it.
        log: file descriptor of the server's log.

    Attributes:
        url: its base URL.
        token: of every call.
        opened_before: number of sessions that were opened before its last start.
    """

    def __init__(self, plan: SoakPlan, root: Path, executable: Path | None, log: int) -> None:
        self._log = log
        self.plan = plan
        self.root = root
        self._config = plan.server(root, executable)
        self.url = ""
        self.token = ""
        self.opened_before = 0
        self._process: Process | None = None

    @property
    def pid(self) -> int:
        """The process id of the gateway."""
        assert self._process is not None
        return self._process.pid

    async def start(self) -> None:
        """Start the server, at its previous address if it had one."""
        self._process, address = await start_server(self._config, self.plan.fleet(), self._log)
        self.url, self.token = address.url, address.token
        port = int(self.url.rpartition(":")[2])
        self._config = self._config.model_copy(update={"port": port, "token": self.token})

    async def kill(self) -> None:
        """Kill the gateway with SIGKILL."""
        assert self._process is not None
        self._process.kill()
        await self._process.wait()

    async def stop(self) -> None:
        """Stop the server in the regular way."""
        assert self._process is not None
        await stop_server(self._process)

    async def watched(self) -> Watched:
        """The server's report about its sessions and slots.

        Raises:
            aiohttp.ClientError, OSError: it does not respond.
        """
        headers = {"authorization": f"Bearer {self.token}"}
        async with (
            aiohttp.ClientSession(headers=headers, raise_for_status=True) as http,
            http.request(WATCH.method, self.url + WATCH.path) as answer,
        ):
            return msgspec.json.decode(await answer.content.readline(), type=Watched)

    async def at_rest(self) -> list[str]:
        """Sessions and slots that are still in use; empty if there are none."""
        try:
            now = await self.watched()
        except (aiohttp.ClientError, OSError) as error:
            return [f"the server does not respond: {error!r}"]
        problems = [f"a lease: {session}" for session in now.sessions]
        if now.slots.free != self.plan.slots or now.slots.total != self.plan.slots or now.slots.waiting:
            problems.append(f"slots: {now.slots}")
        return problems

    async def settled(self, before: Census | None, seconds: float) -> tuple[Census | None, list[str]]:
        """Wait until nothing is in use and nothing is left over.

        Args:
            before: what existed before; ``None`` to wait only until nothing is in use.
            seconds: the time limit.

        Returns:
            What exists now, and what is in use or left over after the time limit.
        """
        loop = asyncio.get_running_loop()
        deadline = loop.time() + seconds
        census = None
        while True:
            if not (problems := await self.at_rest()):
                try:
                    census = await asyncio.to_thread(take, self.pid, self.root)
                except psutil.NoSuchProcess as error:  # it ended meanwhile
                    problems = [str(error)]
                else:
                    problems = leaked(before, census, self.plan.slots) if before is not None else []
            if not problems or loop.time() > deadline:
                return census, problems
            await asyncio.sleep(_POLL_SECONDS)


@asynccontextmanager
async def running_target(
    plan: SoakPlan, root: Path, executable: Path | None, log: int
) -> AsyncIterator[Target]:
    """Run a server until the block ends; for the arguments see :class:`Target`."""
    target = Target(plan, root, executable, log)
    await target.start()
    try:
        yield target
    finally:
        await target.stop()
