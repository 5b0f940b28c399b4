"""One server with tight limits for all faults, hostile pages beside it, and a census around every fault."""

from __future__ import annotations

import asyncio
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
import pytest_asyncio
from tests.hostile import serving_hostile_pages

from webgym.browser.config import BrowserConfig
from webgym.browser.process import BrowserProcess
from webgym.browser.slot import Slot
from webgym.core.action import LeftClick, Navigate, Target
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ServerConfig
from webgym.server.messages import SessionOptions
from webgym.server.worker import RunningServer, running_server

from .census import LAUNCHED, nothing_leaks, of_groups, open_descriptors

MIB = 1024 * 1024

BROWSER = BrowserConfig(
    execute_seconds=3,
    navigate_seconds=6,
    settle_seconds=3,
    screenshot_seconds=6,
    screenshot_try_seconds=3,
    slot_bytes=500 * MIB,
).allowing("127.0.0.1")
"""So tight that a test need not wait for long."""

CLICK = LeftClick(Target(coordinate=(500, 500)))


@pytest.fixture(scope="session", autouse=True)
def _launches() -> Any:
    """Remember every browser that is started."""
    first = BrowserProcess.__init__

    def remember(self: BrowserProcess, pid: int, *more: Any) -> None:
        LAUNCHED.add(pid)
        first(self, pid, *more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BrowserProcess, "__init__", remember)
        yield


@pytest.fixture(scope="session")
def temporary(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the server keeps its profiles, and nobody else anything."""
    return tmp_path_factory.mktemp("browsers")


@pytest_asyncio.fixture(scope="session", loop_scope="session")
async def pages() -> AsyncIterator[str]:
    """Base URL of the hostile pages."""
    async with serving_hostile_pages() as url:
        yield url


@pytest_asyncio.fixture(scope="session", loop_scope="session")
async def server(temporary: Path) -> AsyncIterator[RunningServer]:
    browser = BROWSER.model_copy(update={"temporary_root": temporary})
    config = ServerConfig(
        slots=2,
        allocate_seconds=30,
        receive_seconds=2,
        dead_peer_seconds=2,
        browser=browser,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("webgym.browser.memory.MEMORY_LOOK_SECONDS", 0.1)
        patch.setattr("webgym.browser.slot.CLOSE_SECONDS", 3.0)
        patch.setattr("webgym.server.pool.SWEEP_SECONDS", 0.5)
        async with running_server(config) as server:
            yield server


class Bench:
    """A client beside the server it speaks to."""

    def __init__(self, server: RunningServer, client: BrowserClient, pages: str) -> None:
        self.server = server
        self.client = client
        self.pages = pages

    async def open(self, path: str = "/", **options: Any) -> tuple[Session, Slot]:
        """A session on this page, and the slot that it runs in."""
        session = await self.client.open(SessionOptions(text=True, elements=True, **options))
        grant = session.grant
        lease = self.server.service.leases.check(grant.session_id, grant.secret, str(grant.generation))
        if path:
            await session.step(Navigate(self.pages + path))
        return session, lease.slot

    def descriptors(self, kind: str) -> list[str]:
        """Open descriptors of this process, of one kind."""
        return [name for name in open_descriptors() if name.startswith(kind)]

    async def until(self, holds: Callable[[], object], seconds: float = 30.0) -> None:
        async with asyncio.timeout(seconds):
            while not holds():
                await asyncio.sleep(0.02)


Around = Callable[[], AbstractAsyncContextManager[Bench]]


@pytest.fixture
def fault(server: RunningServer, temporary: Path, pages: str) -> Around:
    """A block with a client of its own. After it everything must be as before, and both slots must work."""

    @asynccontextmanager
    async def around() -> AsyncIterator[Bench]:
        async with nothing_leaks(server, temporary):
            async with BrowserClient(server.url, token=server.token) as client:
                bench = Bench(server, client, pages)
                yield bench
            async with BrowserClient(server.url, token=server.token) as client:
                bench = Bench(server, client, pages)
                for session, _ in await asyncio.gather(*(bench.open() for _ in range(2))):
                    assert (await session.step()).observation.title == "calm"
                    await session.close()

    return around


class ServerApart:
    """A server that is a process of its own.

    Attributes:
        temporary: where its profiles are.
    """

    def __init__(self, process: Process, url: str, token: str, temporary: Path) -> None:
        self.process = process
        self.url = url
        self.token = token
        self.temporary = temporary
        self.groups: set[int] = set()

    def send(self, number: signal.Signals) -> None:
        self.groups |= {child.pid for child in psutil.Process(self.process.pid).children()}
        self.process.send_signal(number)

    async def gone(self) -> None:
        """The server has ended, and nothing of its browsers is left."""
        await self.process.wait()
        async with asyncio.timeout(30):
            while of_groups(self.groups):
                await asyncio.sleep(0.02)


class Apart:
    """Starts servers as processes of their own; none is left behind."""

    def __init__(self, temporary: Path) -> None:
        self.temporary = temporary

    @asynccontextmanager
    async def server(self, **settings: Any) -> AsyncIterator[ServerApart]:
        browser = BROWSER.model_copy(update={"temporary_root": self.temporary})
        config = ServerConfig.model_validate({"browser": browser, **settings})
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            str(Path(__file__).with_name("server_apart.py")),
            config.model_dump_json(),
            stdout=PIPE,
            stderr=DEVNULL,
        )
        assert process.stdout is not None
        url, token = [(await process.stdout.readline()).decode().strip() for _ in range(2)]
        assert url, "the server did not come up"
        server = ServerApart(process, url, token, self.temporary)
        try:
            yield server
        finally:
            if process.returncode is None:
                server.send(signal.SIGKILL)
            await process.communicate()
            await server.gone()


@pytest.fixture
def apart(tmp_path: Path) -> Apart:
    return Apart(tmp_path)
