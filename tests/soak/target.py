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
from tests.soak.leaks import Census, leaked, take

from webgym.bench.server_process import start_server, stop_server
from webgym.browser.config import BrowserConfig
from webgym.server.config import ClientLimits, GatewayConfig, ServerConfig
from webgym.server.messages import Watched
from webgym.server.operations import WATCH

_MIB = 1024 * 1024
_POLL_SECONDS = 0.1


class SoakPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The size of a soak, and the limits of the server under test.

    Attributes:
        seconds: duration of clients and faults.
        seed: of all random choices. Their effects depend on timing.
        clients: number of parallel clients.
        slots: number of slots of all workers together; with fewer slots than clients, some always wait.
        workers: number of worker processes behind the gateway.
        faults: mean number of faults per minute.
        hostile: share of the pages that are hostile.
        disk_bytes: size of the browsers' disk, if one can be mounted.
        episodes: number of episodes after which a browser is replaced.
    """

    seconds: float = 300.0
    seed: int = 0
    clients: int = 10
    slots: int = 6
    workers: int = 2
    faults: float = 20.0
    hostile: float = 0.25
    disk_bytes: int = 768 * _MIB
    episodes: int = 20

    def server(self, temporary_root: Path) -> ServerConfig:
        """Settings of the server, with limits so tight that faults reach them soon."""
        browser = BrowserConfig(
            temporary_root=temporary_root,
            execute_seconds=3,
            navigate_seconds=6,
            settle_seconds=3,
            screenshot_seconds=6,
            slot_bytes=500 * _MIB,
            recycle_episodes=self.episodes,
        )
        return ServerConfig(
            slots=self.slots,
            allocate_seconds=20,
            relaunch_seconds=(0.2, 2.0),
            receive_seconds=2,
            dead_peer_seconds=5,
            keep_alive_seconds=5,
            beat_seconds=0.5,
            browser=browser.allowing("127.0.0.1"),
        )

    def fleet(self) -> GatewayConfig:
        """Settings of the gateway, which soon gives up a worker that does not respond."""
        return GatewayConfig(
            workers=self.workers,
            stop_seconds=5,
            restart_seconds=(0.2, 2.0),
            silent_seconds=6,
            answer_seconds=3,
            idle_seconds=3,
            dead_peer_seconds=5,
        )

    def client(self, *, direct: bool) -> ClientLimits:
        """Limits of clients. A call without a reply within them is an error, so no call hangs.

        Args:
            direct: whether clients call workers directly.
        """
        return ClientLimits(
            direct=direct,
            allocate=self.clients,
            release=self.clients,
            reply_seconds=60,
            connect_seconds=5,
            keep_alive_seconds=3,
            dead_peer_seconds=5,
        )


class Target:
    """A server that can be killed and started again at the same address.

    Args:
        plan: of the soak.
        root: folder of the browsers' profiles.
        log: file descriptor of the server's log.

    Attributes:
        url: its base URL.
        token: of every call.
        opened_before: number of sessions that were opened before its last start.
    """

    def __init__(self, plan: SoakPlan, root: Path, log: int) -> None:
        self._log = log
        self.plan = plan
        self.root = root
        self._config = plan.server(root)
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
async def running_target(plan: SoakPlan, root: Path, log: int) -> AsyncIterator[Target]:
    """Run a server until the block ends; for the arguments see :class:`Target`."""
    target = Target(plan, root, log)
    await target.start()
    try:
        yield target
    finally:
        await target.stop()
