"""Attempts at small websites without browser slots: the real agent, pages and judge, many times faster.

A page without scripts needs a browser only to be drawn, and each page needs to be drawn only once. What a
policy is asked, what it sees and what its actions do are the same as with browsers. What is missing is what
browsers add: time, failures, whatever a page does by itself. So it is for studies and for pretraining; a
result that is to be believed is made with browsers.
"""

from __future__ import annotations

import asyncio
import hashlib
import uuid
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

import msgspec
from playwright.async_api import async_playwright

from webgym.browser.find import find_browser
from webgym.browser.process import PICTURE_FLAGS
from webgym.core.action import BrowserAction, Navigate
from webgym.core.errors import NavigationFailed
from webgym.offline.static_browser import StaticBrowser
from webgym.offline.web import OfflineWeb
from webgym.server import Cookie, SessionOptions, View


class Drawings:
    """Pictures of pages by their HTML, the same as a slot's screenshots. Entering starts a Chromium.

    Args:
        folder: pictures are kept here, and those that are there are not drawn again.
        viewport: width and height, pixels.
    """

    def __init__(self, folder: Path, viewport: tuple[int, int]) -> None:
        self._folder = folder
        self._viewport = viewport
        self._known: dict[str, tuple[str, bytes]] = {}
        self._lock = asyncio.Lock()
        self._playwright: Any = None
        self._page: Any = None

    async def __aenter__(self) -> Self:
        self._folder.mkdir(parents=True, exist_ok=True)
        self._playwright = await async_playwright().start()
        browser = await self._playwright.chromium.launch(
            executable_path=find_browser().path, args=list(PICTURE_FLAGS)
        )
        width, height = self._viewport
        self._page = await browser.new_page(viewport={"width": width, "height": height})
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._page.context.browser.close()
        await self._playwright.stop()

    async def of(self, body: bytes) -> tuple[str, bytes]:
        """A page's picture.

        Args:
            body: its HTML.

        Returns:
            The name (SHA-256, as a run's store names it) and a PNG.
        """
        page = hashlib.sha256(body).hexdigest()
        if page not in self._known:
            path = self._folder / f"{page}.png"
            if not path.exists():
                await self._draw(body, path)
            png = path.read_bytes()
            self._known[page] = (_name(png), png)
        return self._known[page]

    def pictures(self) -> dict[str, bytes]:
        """All pictures in the folder, by name."""
        found = (path.read_bytes() for path in sorted(self._folder.glob("*.png")))
        return {_name(png): png for png in found}

    async def _draw(self, body: bytes, path: Path) -> None:
        async with self._lock:
            await self._page.set_content(body.decode(), wait_until="load")
            png = await self._page.screenshot(type="png")
        new = path.with_suffix(".new")
        new.write_bytes(png)
        new.replace(path)


def _name(png: bytes) -> str:
    return hashlib.sha256(png).hexdigest()


class Rehearsal:
    """In place of a browser server and the served offline web; entering starts what draws.

    Args:
        web: the websites, of the small collection.
        pictures: folder for the drawn pages.
    """

    def __init__(self, web: OfflineWeb, pictures: Path) -> None:
        self.web = web
        self.drawings = Drawings(pictures, web.collection.viewport)
        self._visits: dict[str, StaticBrowser] = {}

    async def __aenter__(self) -> Self:
        await self.drawings.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.drawings.__aexit__(kind, error, trace)

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        """What tells :meth:`open` who visits."""
        return (Cookie("visitor", visitor, domain=".test"),)

    async def open(self, options: SessionOptions | None = None) -> RehearsedSession:
        """A session; its options but for the visitor are not looked at."""
        visitor = options.cookies[0].value if options and options.cookies else uuid.uuid4().hex
        return RehearsedSession(self, visitor)

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """What a website's server holds for a visitor, who does not come again."""
        browser = self._visits.pop(visitor, None)
        return browser.site.report(browser.state) if browser and browser.site.host == host else None

    def visit(self, visitor: str, url: str) -> StaticBrowser:
        """The visitor's browser, at the start page of a website.

        Raises:
            NavigationFailed: there is no such website.
        """
        site = self.web.website(urlsplit(url).hostname or "")
        if site is None:
            raise NavigationFailed(f"{url} is none of the small websites")
        self._visits[visitor] = StaticBrowser(site, self.web.collection.viewport)
        return self._visits[visitor]


class RehearsedSession:
    """A browser session without a browser."""

    def __init__(self, rehearsal: Rehearsal, visitor: str) -> None:
        self.id = visitor
        self._rehearsal = rehearsal
        self._browser: StaticBrowser | None = None

    async def step(self, action: BrowserAction | None = None) -> View:
        """Carry an action out and look.

        Raises:
            NavigationFailed: nothing was opened yet, or there is no such website.
        """
        if isinstance(action, Navigate):
            self._browser = self._rehearsal.visit(self.id, action.url)
        elif self._browser is None:
            raise NavigationFailed("nothing is open yet")
        elif action is not None:
            self._browser.act(action)
        name, png = await self._rehearsal.drawings.of(self._browser.body)
        return View(msgspec.structs.replace(self._browser.observe(), screenshot=name), png)

    async def close(self) -> None:
        """Nothing is to be given back."""
