"""Attempts without browsers: a page is rendered once, and nothing is left behind."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from playwright.async_api import Error

from webgym.agent.solver import Solver
from webgym.core.action import Answer, GoBack, Navigate
from webgym.offline.web import OfflineWeb
from webgym.server.messages import SessionOptions
from webgym.study import static_browsers
from webgym.study.static_browsers import PageImages, StaticBrowsers, StaticSession

WEB = OfflineWeb(7, per_family=6, collection="small")


@pytest.mark.browser
async def test_a_page_that_many_ask_for_is_drawn_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []

    def counted(path: Path, data: bytes, **options: Any) -> None:
        drawn.append(path)
        path.write_bytes(data)

    monkeypatch.setattr(static_browsers, "write_whole", counted)
    async with PageImages(tmp_path, (64, 32)) as images:
        found = await asyncio.gather(*(images.of(b"<p>7</p>") for _ in range(4)))
    assert len(drawn) == 1
    assert len(set(found)) == 1


@pytest.mark.browser
async def test_a_browser_that_does_not_start_leaves_no_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = set(psutil.Process().children(recursive=True))
    monkeypatch.setattr(static_browsers, "find_browser", lambda: SimpleNamespace(path=str(tmp_path / "none")))
    with pytest.raises(Error, match="none"):
        async with PageImages(tmp_path, (64, 32)):
            pass
    assert set(psutil.Process().children(recursive=True)) <= before


async def test_a_visitor_is_known_until_the_session_is_closed() -> None:
    host = next(iter(WEB.specs))
    held = StaticBrowsers(WEB, None)
    session = await held.open(SessionOptions(cookies=held.cookies("ann")))
    await session.step(Navigate(f"http://{host}/"))
    assert await held.state("ann", host) == await held.state("ann", host) is not None
    await session.close()
    assert await held.state("ann", host) is None


async def opened(held: StaticBrowsers, url: str) -> StaticSession:
    session = await held.open(SessionOptions(cookies=held.cookies("ann")))
    await session.step(Navigate(url))
    return session


async def test_navigation_keeps_the_visitor_with_state_and_history() -> None:
    """As in a browser: the cart is still full at the start page, and a visit elsewhere changes nothing."""
    held = StaticBrowsers(WEB, None)
    start, other = (f"http://{host}/" for host in list(WEB.specs)[:2])
    market = next(host for host, spec in WEB.specs.items() if spec.family.family == "market")
    tasks = (task for task in WEB.tasks_of(market) if task.truth)
    task = next(task for task in tasks if task.truth and any(fact.state for fact in task.truth.facts))
    assert task.truth is not None
    session, solver = await opened(held, task.website), Solver(task.website, task.truth.moves)
    view = await session.step()
    while not isinstance(action := solver.next(view.observation, "marks").action, Answer):
        view = await session.step(action)
    bought = await held.state("ann", market)
    assert bought
    assert bought["cart"]
    before = view.observation
    for url in (task.website, other if task.website == start else start):
        view = await session.step(Navigate(url))
        assert view.observation.url == url
        assert await held.state("ann", market) == bought
    await session.step(GoBack())
    assert (await session.step(GoBack())).observation.url == before.url


async def test_an_address_without_a_page_is_a_page_as_in_a_browser() -> None:
    """Measured with Chromium and the served websites."""
    start = f"http://{next(iter(WEB.specs))}/"
    host = start.split("/")[2]
    session = await opened(StaticBrowsers(WEB, None), start)
    for url, at, status, says in (
        (f"{start}a b?c=d e", f"{start}a%20b?c=d%20e", 404, ""),
        (host.upper(), start, 200, ""),
        (f"https://{host}", f"https://{host}/", None, f"https://{host}/: net::ERR_SSL_PROTOCOL_ERROR"),
        ("http://none.test", "http://none.test/", None, "http://none.test/: net::ERR_NAME_NOT_RESOLVED"),
        ("http://", "http://none.test/", None, "http://: Page.navigate: Cannot navigate to invalid URL"),
        ("data:,a", "http://none.test/", None, '"data:,a" was not opened: only http and https addresses are'),
        ("http://none.webgym.test/", "http://none.webgym.test/", 404, ""),
    ):
        view = (await session.step(Navigate(url))).observation
        assert (view.url, view.status) == (at, status)
        assert [notice.text for notice in view.notices if notice.kind == "navigation_failed"] == [
            says
        ] * bool(says)
    visited = [(await session.step(GoBack())).observation.url for _ in range(5)]
    assert visited == [
        "http://none.test/",
        f"https://{host}/",
        start,
        f"https://{host}/",
        f"{start}a%20b?c=d%20e",
    ]
