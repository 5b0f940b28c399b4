"""64 workflows of the authors at once, on fewer browsers: each gets its whole episode and its own page."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any

import httpx
import pytest

from webgym.server.compat import running_compat
from webgym.server.config import ServerConfig
from webgym.server.run_worker import running_server

from .conftest import LOCAL, PAGES, Site

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.asyncio(loop_scope="module")]

CLIENTS = 64
SLOTS = 6
STEPS = 3
KEY = "a-key-of-theirs"
TRIES = 200

PAGES["/many"] = (
    "<title>0</title>"
    "<style>button { position: absolute; left: 0; top: 0; width: 300px; height: 200px }</style>"
    "<button onclick='document.title = ++n'>More</button><script>n = 0</script>"
)


class Workflow:
    """One episode, call by call; what is busy is asked again, as theirs does."""

    def __init__(self, http: httpx.AsyncClient, seen: Counter[str]) -> None:
        self._http, self._seen = http, seen

    async def _call(self, method: str, path: str, **given: Any) -> httpx.Response:
        for _ in range(TRIES):
            self._seen[path] += 1
            response = await self._http.request(method, path, **given)
            if response.status_code == 200:
                return response
            assert response.status_code == 503, (path, response.status_code, response.text)
            self._seen["busy"] += 1
            await asyncio.sleep(0.5)
        raise AssertionError(f"{path} was busy {TRIES} times")

    async def play(self, url: str) -> list[str]:
        """The titles that the page had."""
        instance = (await self._call("POST", "/get", params={"lifetime_mins": 30})).json()
        await self._call("POST", "/execute", json=instance | {"visit_page": {"url": url}})
        size = (await self._call("GET", "/metadata", params=instance)).json()
        titles = []
        for _ in range(STEPS):
            shot = {"interaction_mode": "coordinates"}
            picture = await self._call("GET", "/screenshot", params=instance | shot)
            assert picture.headers["content-type"] == "image/png"
            middle = {"x": size["width"] / 10, "y": size["height"] / 10}
            await self._call("POST", "/execute", json=instance | {"click_coords": middle})
            told = await self._call("POST", "/execute", json=instance | {"get_page_metadata": {}})
            titles.append(str(told.json()["title"]))
            assert (await self._call("GET", "/probe", params=instance)).json()["status"] == "success"
        await self._call("POST", "/reset", params=instance)
        return titles


async def test_64_workflows_at_once(site: Site) -> None:
    config = ServerConfig(slots=SLOTS, token="a-token-for-tests-only", allocate_seconds=30, browser=LOCAL)
    seen: Counter[str] = Counter()
    async with (
        running_server(config) as server,
        running_compat(server.url, server.token, listening=ServerConfig(), key=KEY) as layer,
        httpx.AsyncClient(
            base_url=layer.url,
            headers={"x-api-key": KEY},
            trust_env=False,
            timeout=120,
            limits=httpx.Limits(max_connections=CLIENTS),
        ) as http,
    ):
        episodes = (Workflow(http, seen).play(site.url("/many")) for _ in range(CLIENTS))
        async with asyncio.timeout(900):
            titles = await asyncio.gather(*episodes)
            assert titles == [[str(step + 1) for step in range(STEPS)]] * CLIENTS
            info = (await http.get("/info")).json()
            assert not info["nodes"][0]["instances"]
            while len(server.service.leases):
                await asyncio.sleep(0.05)
    print(dict(seen))
