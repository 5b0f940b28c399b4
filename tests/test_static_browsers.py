"""Attempts without browsers: a page is rendered once, and nothing is left behind."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from playwright.async_api import Error

from webgym import static_browsers
from webgym.core.action import Navigate
from webgym.offline.web import OfflineWeb
from webgym.server.messages import SessionOptions
from webgym.static_browsers import PageImages, StaticBrowsers


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
    web = OfflineWeb(7, per_family=6, collection="small")
    host = next(iter(web.tasks())).website.split("/")[2]
    held = StaticBrowsers(web, None)
    session = await held.open(SessionOptions(cookies=held.cookies("ann")))
    await session.step(Navigate(f"http://{host}/"))
    assert await held.state("ann", host) == await held.state("ann", host) is not None
    await session.close()
    assert await held.state("ann", host) is None
