"""The offline web over real HTTP: hosts, visitors, administration, misbehaviour, latency."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

import httpx
import pytest
from pydantic import SecretStr

from webgym.core.errors import ConfigError
from webgym.offline import latency
from webgym.offline.app import VISITOR_COOKIE, RunningSites, SitesApp, serving
from webgym.offline.config import CollectionName, SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Behaviour, Visit

TOKEN = "a token for tests"
FORM = {"content-type": "application/x-www-form-urlencoded"}


@pytest.fixture(scope="module")
def web() -> OfflineWeb:
    return OfflineWeb(11, per_family=10)


@asynccontextmanager
async def served(web: OfflineWeb, **settings: Any) -> AsyncIterator[tuple[RunningSites, httpx.AsyncClient]]:
    config = SitesConfig(latency=0, token=SecretStr(TOKEN), **settings)
    async with (
        serving(config, web) as sites,
        httpx.AsyncClient(base_url=sites.url, trust_env=False, verify=False, timeout=20) as client,
    ):
        yield sites, client


def host_of(web: OfflineWeb, behaviour: Behaviour = "good", nth: int = 0) -> str:
    return [host for host, spec in web.specs.items() if spec.behaviour == behaviour][nth]


async def consent(client: httpx.AsyncClient, host: str, visitor: str, choice: str) -> None:
    headers = {"host": host, "cookie": f"{VISITOR_COOKIE}={visitor}"}
    answer = await client.post("/consent", data={"choice": choice}, headers=headers)
    assert answer.status_code == 204


async def test_the_host_decides_which_website_answers(web: OfflineWeb) -> None:
    async with served(web) as (_, client):
        for nth in (0, 1, -9):
            host = host_of(web, nth=nth)
            for spelling in (host, host.upper(), f"{host}:80"):
                answer = await client.get("/", headers={"host": spelling})
                assert answer.status_code == 200
                assert web.specs[host].brand.replace("&", "&amp;") in answer.text
        stranger = await client.get("/", headers={"host": "nobody.webgym.test"})
        assert stranger.status_code == 404


LONG = "9" * 10_000


@pytest.mark.parametrize("collection", ["large", "small"])
def test_a_long_number_is_refused_by_every_page_that_takes_one(collection: CollectionName) -> None:
    web = OfflineWeb(11, per_family=2, collection=collection)
    for site in (web.website(host) for host in web.specs):
        assert site is not None
        names = {"page", "step", "floor", "top", "time", "people", "servings", "count", "number", "since"}
        for route in site.routes:
            path = site.path(route.pattern, **dict.fromkeys(re.findall(r"{(\w+)}", route.pattern), LONG))
            query = dict.fromkeys(names, LONG)
            form = query if route.method == "POST" else {}
            lists = {name: [value] for name, value in query.items()}
            visit = Visit(method=route.method, path=path, query=query, lists=lists, form=form, state={})
            assert site.handle(visit).status in (400, 403), path


async def test_a_form_that_no_page_has_is_refused_and_the_next_one_is_taken(web: OfflineWeb) -> None:
    host = {"host": host_of(web)}
    async with served(web) as (_, client):
        for content in (b"choice=" + b"x" * 60_000_000, b"x" * 60_000_000):
            with suppress(httpx.WriteError):  # it is not read to its end
                large = await client.post("/consent", content=content, headers=host | FORM)
                assert large.status_code == 413
        torn = {"content-type": "multipart/form-data; boundary=x"}
        answer = await client.post("/consent", content=b"nothing", headers=host | torn)
        assert answer.status_code == 400
        many = await client.post("/consent", data={"choice": LONG}, headers=host)
        assert many.status_code == 400
        await consent(client, host["host"], "a", "all")


async def test_assets_and_pictures_come_with_their_types(web: OfflineWeb) -> None:
    host = {"host": host_of(web)}
    async with served(web) as (_, client):
        types = {
            path: (await client.get(path, headers=host)).headers["content-type"]
            for path in ("/assets/site.css", "/assets/site.js", "/picture/thing/mug.svg")
        }
        assert types["/assets/site.css"].startswith("text/css")
        assert types["/assets/site.js"].startswith("text/javascript")
        assert types["/picture/thing/mug.svg"].startswith("image/svg+xml")
        for outside in ("/assets/../app.py", "/assets/%2e%2e/app.py", "/assets/none.css"):
            assert (await client.get(outside, headers=host)).status_code == 404


async def test_a_new_visitor_is_given_a_cookie_and_a_known_one_is_not(web: OfflineWeb) -> None:
    async with served(web) as (_, client):
        new = await client.get("/", headers={"host": host_of(web)})
        assert VISITOR_COOKIE in new.headers["set-cookie"]
        assert "HttpOnly" in new.headers["set-cookie"]
        known = {"host": host_of(web), "cookie": f"{VISITOR_COOKIE}=ann"}
        given = (await client.get("/", headers=known)).headers.get_list("set-cookie")
        assert not any(VISITOR_COOKIE in cookie for cookie in given)


async def test_what_a_visitor_does_stays_with_the_visitor_and_the_website(web: OfflineWeb) -> None:
    with_banner = [
        host
        for host, spec in web.specs.items()
        if (site := web.website(host)) and site.look.consent != "none" and spec.behaviour == "good"
    ][:2]

    async with served(web) as (_, client):
        await consent(client, with_banner[0], "ann", "all")

        async def has_banner(host: str, visitor: str) -> bool:
            headers = {"host": host, "cookie": f"{VISITOR_COOKIE}={visitor}"}
            return 'data-do="consent"' in (await client.get("/", headers=headers)).text

        assert not await has_banner(with_banner[0], "ann")
        assert await has_banner(with_banner[0], "bob")
        assert await has_banner(with_banner[1], "ann")


async def test_the_administration_needs_its_token(web: OfflineWeb) -> None:
    async with served(web) as (sites, client):
        assert sites.token == TOKEN
        for path in ("/websites", f"/visitors/ann/{host_of(web)}", "/"):
            for given in ({}, {"authorization": "Bearer wrong"}, {"authorization": f"Bearer {TOKEN}x"}):
                assert (await client.get(path, headers=given)).status_code == 401
        right = {"authorization": f"Bearer {TOKEN}"}
        listed = (await client.get("/websites", headers=right)).json()
        assert {entry["host"] for entry in listed} == set(web.specs)
        assert (await client.get("/nothing", headers=right)).status_code == 404
        # No website answers for the administration, whatever token comes along.
        elsewhere = {**right, "host": host_of(web)}
        assert (await client.get("/websites", headers=elsewhere)).status_code == 404


async def test_the_state_of_a_visitor_is_told_unless_there_is_none(web: OfflineWeb) -> None:
    right = {"authorization": f"Bearer {TOKEN}"}
    host, forgetful = host_of(web), host_of(web, "forgets")
    async with served(web) as (_, client):
        assert (await client.get(f"/visitors/ann/{host}", headers=right)).status_code == 404
        await consent(client, host, "ann", "all")
        told = await client.get(f"/visitors/ann/{host}", headers=right)
        assert told.status_code == 200
        site = web.website(host)
        assert site is not None
        assert told.json() == site.report({"consent": "all"})
        await consent(client, forgetful, "ann", "all")
        lost = await client.get(f"/visitors/ann/{forgetful}", headers=right)
        assert lost.status_code == 404
        assert forgetful in lost.json()["error"]
        assert (await client.get("/visitors/ann/nobody.webgym.test", headers=right)).status_code == 404


async def test_a_state_that_a_restart_has_lost_in_part_is_not_told(web: OfflineWeb) -> None:
    """What was bought before the restart is missing in it, so that it would show a failure of the agent's."""
    right, host = {"authorization": f"Bearer {TOKEN}"}, host_of(web)
    cookies = f"{VISITOR_COOKIE}=ann"
    for restarted in (False, True):
        async with served(web) as (_, client):
            given = (await client.get("/", headers={"host": host, "cookie": cookies})).headers
            told = await client.get(f"/visitors/ann/{host}", headers=right)
            assert told.status_code == (404 if restarted else 200)
            stranger = {"host": host, "cookie": f"{VISITOR_COOKIE}=bob"}
            await client.get("/", headers=stranger)
            assert (await client.get(f"/visitors/bob/{host}", headers=right)).status_code == 200
            cookies = "; ".join([cookies, *(it.partition(";")[0] for it in given.get_list("set-cookie"))])


async def test_a_website_that_blocks_answers_every_page_with_a_challenge(web: OfflineWeb) -> None:
    headers = {"host": host_of(web, "blocks")}
    async with served(web) as (_, client):
        for path in ("/", "/anything"):
            answer = await client.get(path, headers=headers)
            assert answer.status_code == 403
            assert "Verify you are human" in answer.text


async def test_a_website_that_nags_says_so_in_its_pages(web: OfflineWeb) -> None:
    async with served(web) as (_, client):
        nagging = await client.get("/", headers={"host": host_of(web, "nags")})
        assert "alert(" in nagging.text
        calm = await client.get("/", headers={"host": host_of(web)})
        assert "alert(" not in calm.text


async def test_a_slow_website_takes_its_time_and_no_other_does(web: OfflineWeb) -> None:
    async with served(web, slow_seconds=1.5) as (_, client):

        async def took(behaviour: Behaviour, path: str) -> float:
            began = time.monotonic()
            await client.get(path, headers={"host": host_of(web, behaviour)})
            return time.monotonic() - began

        assert await took("slow", "/") >= 1.5
        assert min([await took("slow", "/picture/thing/x.svg") for _ in range(3)]) < 1.5
        assert min([await took("good", "/") for _ in range(3)]) < 1.5


async def test_simulated_latency_is_waited_for(web: OfflineWeb) -> None:
    host, path = host_of(web), "/picture/thing/x.svg"
    scale = 0.3 / latency.seconds(web.seed, host, path, 1, 1.0)
    async with (
        serving(SitesConfig(latency=min(scale, 100)), web) as sites,
        httpx.AsyncClient(base_url=sites.url, timeout=60) as client,
    ):
        began = time.monotonic()
        await client.get(path, headers={"host": host})
        assert time.monotonic() - began >= 0.3


async def test_latency_ends_when_the_websites_are_closed(
    web: OfflineWeb, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arrived, simulate = asyncio.Event(), SitesApp._simulate_latency

    async def noticed(*request: Any) -> None:
        arrived.set()
        await simulate(*request)

    monkeypatch.setattr(SitesApp, "_simulate_latency", noticed)
    async with httpx.AsyncClient(trust_env=False, timeout=20) as client:
        async with serving(SitesConfig(slow_seconds=1000), web) as sites:
            headers = {"host": host_of(web, "slow")}
            page = asyncio.create_task(client.get(sites.url, headers=headers))
            await arrived.wait()
            assert not page.done()
        assert (await page).status_code == 200
    assert "Exception in ASGI application" not in capfd.readouterr().err


async def test_an_address_that_is_taken_is_named(web: OfflineWeb) -> None:
    async with served(web) as (sites, _):
        port = int(sites.address.rpartition(":")[2])
        with pytest.raises(ConfigError, match=str(port)) as caught:
            async with serving(SitesConfig(port=port), web):
                pass
        assert "port" in (caught.value.hint or "")
