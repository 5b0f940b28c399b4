"""64 workflows of the authors at once, on fewer browsers: each gets its whole episode and its own page."""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from typing import Any

import httpx
import pytest

from webgym.browser.document import Document
from webgym.browser.gestures import AnyAction
from webgym.browser.observe import Metadata
from webgym.browser.sandbox import SandboxState
from webgym.compat.app import running_compat
from webgym.core.action import Navigate
from webgym.server import pool
from webgym.server.config import ServerConfig
from webgym.server.messages import SessionOptions
from webgym.server.worker import RunningServer, running_server

from .conftest import LOCAL, PAGES, Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]

CLIENTS = 64
SLOTS = 6
KEY = "a-key-of-theirs"

PAGES["/many"] = (
    "<title>0</title>"
    "<style>button { position: absolute; left: 0; top: 0; width: 300px; height: 200px }</style>"
    "<button onclick='document.title = ++n'>More</button><script>n = 0</script>"
)


class Workflow:
    """One episode, call by call, with the timeouts and retries of ``areal/workflow/webgym_workflow.py``: only
    ``/get`` and ``/screenshot`` are tried again, with pauses; whatever else fails would be lost.

    Args:
        http: a client of the layer.
        seen: counts the answers, by path and status.
        pace: seconds that a second of their pauses lasts here.
    """

    def __init__(self, http: httpx.AsyncClient, seen: Counter[tuple[str, int]], pace: float = 1.0) -> None:
        self._http, self._seen, self._pace = http, seen, pace

    async def _call(self, method: str, path: str, *pauses: float, **given: Any) -> httpx.Response:
        for pause in (*pauses, None):
            response = await self._http.request(method, path, **given)
            self._seen[path, response.status_code] += 1
            if response.status_code == 200 or pause is None:
                break
            await asyncio.sleep(pause * self._pace)
        assert response.status_code == 200, (path, response.status_code, response.text)
        return response

    async def play(self, url: str, steps: int) -> list[tuple[str, str]]:
        """URL and title of the page after each step."""
        pauses = [min(20, 5 + 2 * attempt) for attempt in range(14)]
        instance = (await self._call("POST", "/get", *pauses, params={"lifetime_mins": 60})).json()
        await self._call("POST", "/execute", json=instance | {"visit_page": {"url": url}})
        size = (await self._call("GET", "/metadata", params=instance)).json()
        pages = []
        for _ in range(steps):
            shot = instance | {"interaction_mode": "coordinates"}
            picture = await self._call("GET", "/screenshot", 2, 4, 6, 8, params=shot)
            assert picture.headers["content-type"] == "image/png"
            middle = {"x": size["width"] / 10, "y": size["height"] / 10}
            await self._call("POST", "/execute", json=instance | {"click_coords": middle})
            told = (await self._call("POST", "/execute", json=instance | {"get_page_metadata": {}})).json()
            pages.append((told["url"], told["title"]))
            assert (await self._call("GET", "/probe", params=instance)).json()["status"] == "success"
        await self._call("POST", "/reset", params=instance, timeout=30)
        return pages


def client(url: str) -> httpx.AsyncClient:
    """A client for one workflow: one for all looks through all of its connections at every request."""
    headers = {"x-api-key": KEY}
    return httpx.AsyncClient(base_url=url, headers=headers, trust_env=False, verify=False, timeout=120)


@contextlib.asynccontextmanager
async def served(config: ServerConfig) -> AsyncIterator[tuple[RunningServer, str]]:
    async with (
        running_server(config) as server,
        running_compat(server.url, server.token, listening=ServerConfig(), key=KEY) as layer,
    ):
        yield server, layer.url


async def check_64_workflows(
    config: ServerConfig, url: str, steps: int, pace: float = 1.0
) -> Counter[tuple[str, int]]:
    """Play them, each on a page of its own; the answers by path and status."""
    seen: Counter[tuple[str, int]] = Counter()

    async def play(page: str) -> list[tuple[str, str]]:
        async with client(address) as http:
            return await Workflow(http, seen, pace).play(page, steps)

    urls = [f"{url}?client={number}" for number in range(CLIENTS)]
    async with served(config) as (server, address), asyncio.timeout(900):
        pages = await asyncio.gather(*map(play, urls))
        assert pages == [[(each, str(step + 1)) for step in range(steps)] for each in urls]
        async with client(address) as http:
            assert not (await http.get("/info")).json()["nodes"][0]["instances"]
        while len(server.service.leases):
            await asyncio.sleep(0.05)
    return seen


class StandInSlot:
    """A slot without a browser, whose pages count clicks in their titles."""

    def __init__(self, *_: Any) -> None:
        self.sandbox = SandboxState(False, "a stand-in has no browser")
        self.version = "stand-in"
        self.needs_replacement = self.is_open = False
        self._url, self._clicks = "about:blank", 0

    @property
    def is_warm(self) -> bool:
        return not self.is_open

    @contextlib.contextmanager
    def awake(self) -> Iterator[None]:
        yield

    async def start(self) -> None:
        self.is_open = False

    warm = close = stop = start

    async def open(self, options: SessionOptions) -> None:
        assert not self.is_open, "a slot is leased twice"
        self.is_open, self._url, self._clicks = True, "about:blank", 0

    async def act(self, action: AnyAction) -> None:
        url, clicks = self._url, self._clicks
        await asyncio.sleep(0)  # others may act meanwhile, but not on this page
        self._url, self._clicks = (action.url, 0) if isinstance(action, Navigate) else (url, clicks + 1)

    async def metadata(self) -> Metadata:
        return Metadata(self._url, str(self._clicks), (1, 1), 200, (0, 0), "quiet", ())

    async def read(self, _: Any) -> Document:
        return Document(self._url, str(self._clicks))

    async def screenshot(self) -> bytes:
        return b"a picture"


async def test_64_workflows_at_once_on_stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "Slot", StandInSlot)
    config = ServerConfig(slots=SLOTS, token="a-token-for-tests-only", allocate_seconds=0.5)
    seen = await check_64_workflows(config, "http://many.test/", steps=1, pace=0.2)
    assert seen["/get", 200] == CLIENTS
    assert seen["/get", 503] > 0, "nobody had to ask again"


@pytest.mark.slow
async def test_64_workflows_at_once(site: Site) -> None:
    config = ServerConfig(slots=SLOTS, token="a-token-for-tests-only", allocate_seconds=30, browser=LOCAL)
    print(dict(await check_64_workflows(config, site.url("/many"), steps=3)))
