"""What attempts at one task load once: parts of pages that a website calls public."""

from __future__ import annotations

import gzip

import pytest
from starlette.requests import Request
from starlette.responses import Response

from webgym.browser import shared_parts
from webgym.browser.shared_parts import SharedParts, _Part

from .conftest import Open, Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

SCRIPT = "document.querySelector('p').textContent += ' and'"
KEPT = {"cache-control": "public, max-age=600"}
LOADED = {
    "kept": (KEPT, 1),
    "kept, compressed": (KEPT | {"content-encoding": "gzip", "vary": "Accept-Encoding"}, 1),
    "without a word": ({}, 2),
    "asked for again": ({"cache-control": "public, no-cache, max-age=600"}, 2),
    "not stored": ({"cache-control": "public, no-store, max-age=600"}, 2),
    "old already": (KEPT | {"age": "600"}, 2),
    "not for everybody": ({"cache-control": "max-age=600"}, 2),
    "by cookie": (KEPT | {"vary": "Accept-Encoding, Cookie"}, 2),
}
"""Headers of a script, and how often two sessions of a group load it."""


async def test_what_sessions_of_a_group_share(site: Site, open_tab: Open) -> None:
    paths = {f"/part{number}.js": headers for number, (headers, _) in enumerate(LOADED.values())}

    async def script(request: Request) -> Response:
        headers = paths[request.url.path]
        body = SCRIPT.encode()
        body = gzip.compress(body) if "content-encoding" in headers else body
        return Response(body, headers=headers, media_type="text/javascript")

    for path in paths:
        site.on(path, script)
    page = site.page("<p>here</p>" + "".join(f"<script src={path}></script>" for path in paths))

    async def loaded(group: str) -> list[int]:
        site.hits.clear()
        tab = await open_tab(shared=group)
        await tab.goto(page)
        assert tab.text == ["here" + " and" * len(paths)]
        return [site.hits.count(path) for path in paths]

    once = [1] * len(paths)
    assert await loaded("a") == once
    again = dict(zip(LOADED, await loaded("a"), strict=True))
    assert again == {name: times - 1 for name, (_, times) in LOADED.items()}
    assert await loaded("b") == once, "another group"
    assert await loaded("") == once, "none"


async def test_an_origin_with_credentials_shares_nothing(site: Site, open_tab: Open) -> None:
    async def script(_: Request) -> Response:
        return Response(SCRIPT, headers=KEPT, media_type="text/javascript")

    site.on("/secret.js", script)
    page = site.page("<p>here</p><script src=/secret.js></script>")
    for _ in range(2):
        tab = await open_tab(shared="c", credentials={site.url().rstrip("/"): "ann:secret"})
        await tab.goto(page)
        assert tab.text == ["here and"]
    assert site.hits.count("/secret.js") == 2


async def test_the_parts_used_longest_ago_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_parts, "SHARED_CHARACTERS", 20)
    parts, fresh = SharedParts(), _Part(float("inf"), [], "12345678")
    parts.put("g", "one", fresh)
    parts.put("g", "two", fresh)
    assert parts.get("g", "one") is fresh
    parts.put("g", "three", fresh)
    parts.put("g", "three", fresh)
    assert [name for name in ("one", "two", "three") if parts.get("g", name)] == ["one", "three"]
    parts.put("g", "over", _Part(0.0, [], "12345678"))
    assert parts.get("g", "over") is None, "it is not fresh any more"
