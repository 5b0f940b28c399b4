"""One server with tight limits for all faults, hostile pages beside it, and a census around every fault."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from webgym.bench.hostile import serving_hostile_pages
from webgym.browser import BrowserConfig, Slot
from webgym.browser.process import BrowserProcess
from webgym.core.action import LeftClick, Navigate, Target
from webgym.server import BrowserClient, RunningServer, ServerConfig, Session, SessionOptions, running_server

from .census import LAUNCHED, nothing_leaks

MIB = 1024 * 1024

BROWSER = BrowserConfig(
    execute_seconds=2,
    navigate_seconds=4,
    settle_seconds=2,
    screenshot_seconds=4,
    screenshot_try_seconds=2,
    close_seconds=3,
    slot_bytes=500 * MIB,
    memory_look_seconds=0.1,
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
    async with running_server(ServerConfig(slots=2, allocate_seconds=30, browser=browser)) as server:
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
        grant = session._grant
        lease = self.server.service.leases.check(grant.session_id, grant.secret, str(grant.generation))
        if path:
            await session.step(Navigate(self.pages + path))
        return session, lease.slot

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
