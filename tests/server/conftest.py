"""A small website beside a running server with real browsers."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable

import pytest_asyncio
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.types import Receive, Scope, Send
from tests.serving import serving

from webgym.browser.config import BrowserConfig
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ClientLimits, ServerConfig
from webgym.server.messages import SessionOptions
from webgym.server.worker import RunningServer, running_server

LOCAL = BrowserConfig().allowing("127.0.0.1")
"""Browsers that may open the small website, which is on this machine."""

TOKEN = "a-token-for-tests-only"

PAGES = {
    "/": "<title>Home</title><h1>Welcome</h1><a href=/next>Next</a><label>Name <input></label>"
    "<p style='height:2000px'>text</p>",
    "/next": "<title>Next</title><h1>Next page</h1>",
    "/counter": "<title>0</title><button onclick='document.title = ++n'>More</button><script>n = 0</script>",
    "/file": "<title>None</title>"
    "<label>File <input type=file onchange='document.title = files[0].name'></label>",
}


class Site:
    def __init__(self, port: int) -> None:
        self._port = port
        self.release = asyncio.Event()

    def url(self, path: str = "/") -> str:
        return f"http://127.0.0.1:{self._port}{path}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        path = Request(scope).url.path
        if path == "/held":  # answers when the test says so
            await self.release.wait()
        body = PAGES.get(path)
        response = HTMLResponse(f"<!doctype html>{body}") if body else Response("none", 404)
        await response(scope, receive, send)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def site() -> AsyncIterator[Site]:
    async with serving(Site, lambda site: site) as site:
        yield site
        site.release.set()


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def server() -> AsyncIterator[RunningServer]:
    """One server of two slots for a whole module. A slot that is being cleaned is waited for."""
    config = ServerConfig(slots=2, token=TOKEN, allocate_seconds=60, browser=LOCAL)
    async with running_server(config) as server:
        yield server


@pytest_asyncio.fixture(loop_scope="module")
async def client(server: RunningServer) -> AsyncIterator[BrowserClient]:
    async with BrowserClient(server.url, token=server.token) as client:
        yield client


Open = Callable[..., Awaitable[Session]]


@pytest_asyncio.fixture(loop_scope="module")
async def session(client: BrowserClient) -> Session:
    return await client.open(SessionOptions(text=True, elements=True))


def quick(**limits: float) -> ClientLimits:
    return ClientLimits.model_validate({"connect_seconds": 2, **limits})
