"""Attempts at the small websites without browsers: the real agent, pages and judge, many times faster.

A page without scripts needs a browser only for rendering, and only once. Prompts, observations and the
effects of actions are the same as with browsers. What browsers add is missing: elapsed time, failures, and
changes that a page makes by itself. Use this for studies and pretraining; measure results that matter with
real browsers.
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

from webgym.agent.agent import Agent
from webgym.browser.config import Cookie
from webgym.browser.find import find_browser
from webgym.browser.process import PICTURE_FLAGS
from webgym.core.action import BrowserAction, Navigate
from webgym.core.errors import NavigationFailed, PolicyError
from webgym.core.observation import Probed
from webgym.core.trajectory import Episode
from webgym.offline.web import OfflineWeb
from webgym.rollout.attempt import Attempt, AttemptContext
from webgym.rollout.config import AttemptConfig
from webgym.rollout.driver import NoStore
from webgym.rollout.plan import Planned
from webgym.rollout.progress import Progress
from webgym.server.messages import SessionOptions, View
from webgym.store.files import write_whole
from webgym.study.static_pages import StaticBrowser, read_page


class PageImages:
    """Screenshots of pages by their HTML, identical to a slot's. Entering the context starts a Chromium.

    Args:
        folder: screenshots are stored here; those already there are not rendered again.
        viewport: width and height, pixels.
    """

    def __init__(self, folder: Path, viewport: tuple[int, int]) -> None:
        self._folder = folder
        self._viewport = viewport
        self._by_page: dict[bytes, tuple[str, bytes]] = {}
        self._lock = asyncio.Lock()
        self._open = AsyncExitStack()
        self._page: Any = None

    async def __aenter__(self) -> Self:
        from playwright.async_api import async_playwright  # its import costs more than all of ours

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
        """A page's screenshot.

        Args:
            body: its HTML.

        Returns:
            Its name (SHA-256, as in a run's store) and the PNG.
        """
        page = hashlib.sha256(body).digest()
        if page not in self._by_page:
            async with self._lock:
                if page not in self._by_page:
                    png = await self._render(body, page.hex())
                    self._by_page[page] = (_name(png), png)
        return self._by_page[page]

    def pictures(self) -> dict[str, bytes]:
        """All screenshots in the folder, by name."""
        images = (path.read_bytes() for path in sorted(self._folder.glob("*.png")))
        return {_name(png): png for png in images}

    async def _render(self, body: bytes, page: str) -> bytes:
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
    """Replaces a browser server and the served offline web for the small websites.

    Args:
        web: the websites, of the small collection.
        pictures: folder for screenshots; ``None`` if the policy reads only elements: nothing is rendered
            then, and screenshots are empty.

    Attributes:
        signs: the texts of every screenshot, by its name, with their upper left corners in CSS pixels.
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
        """A website's server state for a visitor whose session is open; ``None`` if there is none."""
        browser, site = self._visits.get(visitor), self.web.website(host)
        if browser is None or site is None or host not in browser.states:
            return None
        return site.report(browser.states[host])

    def visit(self, visitor: str, url: str) -> StaticBrowser:
        """Open a page in a new browser for the visitor.

        Raises:
            NavigationFailed: there is no such website.
        """
        site = self.web.website(urlsplit(url).hostname or "")
        if site is None:
            raise NavigationFailed(f"{url} is not one of the small websites")
        self._visits[visitor] = StaticBrowser(site, self.web.collection.viewport, self.web.website, url)
        return self._visits[visitor]

    def leave(self, visitor: str) -> None:
        """Forget a visitor."""
        self._visits.pop(visitor, None)

    async def observe(self, browser: StaticBrowser) -> View:
        """The observation of a visitor's page, with its screenshot."""
        observation, image = browser.observe(), b""
        if self.page_images is not None:
            name, image = await self.page_images.of(browser.body)
            observation = msgspec.structs.replace(observation, screenshot=name)
        if observation.screenshot not in self.signs:
            self.signs[observation.screenshot] = read_page(browser.body).signs
        return View(observation, image)


class StaticSession:
    """A browser session without a browser."""

    def __init__(self, browsers: StaticBrowsers, visitor: str) -> None:
        self.id = visitor
        self._browsers = browsers
        self._browser: StaticBrowser | None = None

    async def step(self, action: BrowserAction | None = None) -> View:
        """Carry out an action and observe the page.

        Raises:
            NavigationFailed: no page is open yet, and the action opens none.
        """
        if self._browser is None:
            if not isinstance(action, Navigate):
                raise NavigationFailed("no page is open yet")
            self._browser = self._browsers.visit(self.id, action.url)
        elif action is not None:
            self._browser.act(action)
        return await self._browsers.observe(self._browser)

    async def probe(self, url: str) -> Probed:
        """Its websites are always there."""
        del url
        return Probed(status=200)

    async def close(self) -> None:
        """Forget the visitor."""
        self._browsers.leave(self.id)


class StaticCollector:
    """Makes single attempts outside a run; returns their episodes and stores nothing.

    Args:
        browsers: where the attempts take place.
        agent: chooses the actions.
        config: budgets and limits of an attempt.
        seed: of the policy's random choices.
    """

    def __init__(self, browsers: StaticBrowsers, agent: Agent, config: AttemptConfig, seed: int = 0) -> None:
        self._browsers = browsers
        self._context = AttemptContext(
            client=browsers,
            agent=agent,
            store=NoStore(),
            config=config,
            progress=Progress(total=0),
            site_state=browsers,
            seed=seed,
        )

    async def make(self, planned: Planned) -> Episode:
        """Make an attempt.

        Raises:
            PolicyError: the attempt ended early.
        """
        attempt = Attempt(self._context, planned)
        session = await self._browsers.open(attempt.options())
        try:
            await attempt.run(session)
        finally:
            await session.close()
        episode = attempt.episode()
        if not episode.ending.is_regular:
            failure = episode.failure
            raise PolicyError(f"{planned.attempt_id}: {failure.message if failure else episode.ending}")
        return episode
