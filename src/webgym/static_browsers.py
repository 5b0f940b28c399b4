"""Attempts at the small websites without browsers: the real agent, pages and judge, many times faster.

A page without scripts needs a browser only to be rendered, and each page needs to be rendered only once. What
a policy is asked, what it sees and what its actions do are the same as with browsers. What is missing is what
browsers add: elapsed time, failures, and whatever a page does by itself. Use it for studies and pretraining;
measure results that matter with real browsers.
"""

from __future__ import annotations

import asyncio
import hashlib
import uuid
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import msgspec
from playwright.async_api import async_playwright

from webgym.agent.agent import Agent
from webgym.browser.config import Cookie
from webgym.browser.find import find_browser
from webgym.browser.process import PICTURE_FLAGS
from webgym.core.action import BrowserAction, Navigate
from webgym.core.errors import NavigationFailed, PolicyBadReply, PolicyError
from webgym.core.trajectory import Episode
from webgym.offline.static_browser import StaticBrowser, read_page
from webgym.offline.web import OfflineWeb
from webgym.rollout.attempt import Attempt, AttemptContext
from webgym.rollout.config import AttemptConfig
from webgym.rollout.files import write_whole
from webgym.rollout.judging import JUDGED
from webgym.rollout.plan import Planned
from webgym.rollout.progress import Progress
from webgym.server.messages import SessionOptions, View


class PageImages:
    """Screenshots of pages by their HTML, the same as a slot's. Entering the context starts a Chromium.

    Args:
        folder: screenshots are stored here; those already there are not rendered again.
        viewport: width and height, pixels.
    """

    def __init__(self, folder: Path, viewport: tuple[int, int]) -> None:
        self._folder = folder
        self._viewport = viewport
        self._known: dict[bytes, tuple[str, bytes]] = {}
        self._lock = asyncio.Lock()
        self._open = AsyncExitStack()
        self._page: Any = None

    async def __aenter__(self) -> Self:
        self._folder.mkdir(parents=True, exist_ok=True)
        width, height = self._viewport
        async with AsyncExitStack() as opening:
            playwright = await opening.enter_async_context(async_playwright())
            browser = await playwright.chromium.launch(
                executable_path=find_browser().path, args=list(PICTURE_FLAGS)
            )
            opening.push_async_callback(browser.close)
            self._page = await browser.new_page(viewport={"width": width, "height": height})
            self._open = opening.pop_all()
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._open.aclose()

    async def of(self, body: bytes) -> tuple[str, bytes]:
        """A page's picture.

        Args:
            body: its HTML.

        Returns:
            The name (SHA-256, as a run's store names it) and a PNG.
        """
        page = hashlib.sha256(body).digest()
        if page not in self._known:
            async with self._lock:
                if page not in self._known:
                    png = await self._drawn(body, page.hex())
                    self._known[page] = (_name(png), png)
        return self._known[page]

    def pictures(self) -> dict[str, bytes]:
        """All pictures in the folder, by name."""
        found = (path.read_bytes() for path in sorted(self._folder.glob("*.png")))
        return {_name(png): png for png in found}

    async def _drawn(self, body: bytes, page: str) -> bytes:
        path = self._folder / f"{page}.png"
        if path.exists():
            return path.read_bytes()
        await self._page.set_content(body.decode(), wait_until="load")
        png: bytes = await self._page.screenshot(type="png")
        write_whole(path, png, durable=False)
        return png


def _name(png: bytes) -> str:
    return hashlib.sha256(png).hexdigest()


class StaticBrowsers:
    """Stands in for a browser server and for the served offline web.

    Args:
        web: the websites, of the small collection.
        pictures: folder for screenshots; ``None`` if the policy reads only elements: then nothing is rendered
            and screenshots are empty.

    Attributes:
        signs: for every screenshot that was taken, its texts with their upper left corners, CSS pixels.
    """

    def __init__(self, web: OfflineWeb, pictures: Path | None) -> None:
        self.web = web
        self.page_images = None if pictures is None else PageImages(pictures, web.collection.viewport)
        self.signs: dict[str, tuple[tuple[str, tuple[int, int]], ...]] = {}
        self._visits: dict[str, StaticBrowser] = {}

    async def __aenter__(self) -> Self:
        if self.page_images is not None:
            await self.page_images.__aenter__()
        return self

    async def __aexit__(self, *exc: object) -> None:
        if self.page_images is not None:
            await self.page_images.__aexit__(*exc)

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        """The cookie by which :meth:`open` recognises the visitor."""
        return (Cookie("visitor", visitor, domain=".test"),)

    async def open(self, options: SessionOptions | None = None) -> StaticSession:
        """Open a session. All options except the visitor's cookie are ignored."""
        visitor = options.cookies[0].value if options and options.cookies else uuid.uuid4().hex
        return StaticSession(self, visitor)

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """What a website's server holds for a visitor whose session is not closed yet."""
        browser = self._visits.get(visitor)
        return browser.site.report(browser.state) if browser and browser.site.host == host else None

    def visit(self, visitor: str, url: str) -> StaticBrowser:
        """The visitor's browser, at the start page of a website.

        Raises:
            NavigationFailed: there is no such website.
        """
        site = self.web.website(urlsplit(url).hostname or "")
        if site is None:
            raise NavigationFailed(f"{url} is not one of the small websites")
        self._visits[visitor] = StaticBrowser(site, self.web.collection.viewport)
        return self._visits[visitor]

    def leave(self, visitor: str) -> None:
        """Forget a visitor."""
        self._visits.pop(visitor, None)

    async def look(self, browser: StaticBrowser) -> View:
        """What a visitor sees."""
        seen, image = browser.observe(), b""
        if self.page_images is not None:
            name, image = await self.page_images.of(browser.body)
            seen = msgspec.structs.replace(seen, screenshot=name)
        if seen.screenshot not in self.signs:
            self.signs[seen.screenshot] = read_page(browser.body).signs
        return View(seen, image)


class StaticSession:
    """A browser session without a browser."""

    def __init__(self, browsers: StaticBrowsers, visitor: str) -> None:
        self.id = visitor
        self._browsers = browsers
        self._browser: StaticBrowser | None = None

    async def step(self, action: BrowserAction | None = None) -> View:
        """Carry an action out and look.

        Raises:
            NavigationFailed: nothing was opened yet, or there is no such website.
        """
        if isinstance(action, Navigate):
            self._browser = self._browsers.visit(self.id, action.url)
        elif self._browser is None:
            raise NavigationFailed("nothing is open yet")
        elif action is not None:
            self._browser.act(action)
        return await self._browsers.look(self._browser)

    async def close(self) -> None:
        """Forget the visitor."""
        self._browsers.leave(self.id)


class StaticCollector:
    """Makes single attempts outside a run; only the episode is returned, nothing is stored.

    Args:
        browsers: where the attempts take place.
        agent: decides the actions.
        config: budgets and limits of an attempt.
        seed: of the policy's random choices.
    """

    def __init__(self, browsers: StaticBrowsers, agent: Agent, config: AttemptConfig, seed: int = 0) -> None:
        self._browsers = browsers
        self._context = AttemptContext(
            client=browsers,
            agent=agent,
            store=_KeepsNothing(),
            config=config,
            progress=Progress(total=0),
            site_state=browsers,
            run_id="static",
            seed=seed,
        )

    async def make(self, planned: Planned) -> Episode:
        """An attempt, as a collector would have recorded it.

        Raises:
            PolicyError: it did not come to an end of its own, and not because no reply held an action.
        """
        attempt = Attempt(self._context, planned)
        session = await self._browsers.open(attempt.options())
        try:
            await attempt.run(session)
        finally:
            await session.close()
        episode = attempt.episode()
        failure = episode.failure
        # A model that is only beginning may never say what to do.
        said_nothing = failure is not None and failure.code == PolicyBadReply.code
        if episode.ending not in JUDGED and not said_nothing:
            raise PolicyError(f"{planned.attempt_id}: {failure.message if failure else episode.ending}")
        return episode


class _KeepsNothing:
    async def put_image(self, name: str, data: bytes) -> None:
        pass
