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
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import msgspec
from playwright.async_api import async_playwright

from webgym.agent.agent import Agent
from webgym.browser.find import find_browser
from webgym.browser.process import PICTURE_FLAGS
from webgym.core.action import BrowserAction, Navigate
from webgym.core.errors import NavigationFailed, PolicyBadReply, PolicyError
from webgym.core.trajectory import Episode
from webgym.offline.static_browser import StaticBrowser, read_page
from webgym.offline.web import OfflineWeb
from webgym.rollout.attempt import Attempt, AttemptContext
from webgym.rollout.driver import AttemptConfig
from webgym.rollout.files import write_whole
from webgym.rollout.judging import JUDGED
from webgym.rollout.plan import Planned
from webgym.rollout.progress import Progress
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


class Rehearsal:
    """In place of a browser server and the served offline web; entering starts what draws.

    Args:
        web: the websites, of the small collection.
        pictures: folder for the drawn pages; ``None`` where the policy looks at elements alone: then nothing
            is drawn, and pictures are empty.

    Attributes:
        signs: what every picture that was looked at shows, with left upper corners, CSS pixels.
    """

    def __init__(self, web: OfflineWeb, pictures: Path | None) -> None:
        self.web = web
        self.drawings = None if pictures is None else Drawings(pictures, web.collection.viewport)
        self.signs: dict[str, tuple[tuple[str, tuple[int, int]], ...]] = {}
        self._visits: dict[str, StaticBrowser] = {}

    async def __aenter__(self) -> Self:
        if self.drawings is not None:
            await self.drawings.__aenter__()
        return self

    async def __aexit__(self, *exc: object) -> None:
        if self.drawings is not None:
            await self.drawings.__aexit__(*exc)

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        """What tells :meth:`open` who visits."""
        return (Cookie("visitor", visitor, domain=".test"),)

    async def open(self, options: SessionOptions | None = None) -> RehearsedSession:
        """A session; its options but for the visitor are not looked at."""
        visitor = options.cookies[0].value if options and options.cookies else uuid.uuid4().hex
        return RehearsedSession(self, visitor)

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
            raise NavigationFailed(f"{url} is none of the small websites")
        self._visits[visitor] = StaticBrowser(site, self.web.collection.viewport)
        return self._visits[visitor]

    def leave(self, visitor: str) -> None:
        """Forget a visitor."""
        self._visits.pop(visitor, None)

    async def look(self, browser: StaticBrowser) -> View:
        """What a visitor sees."""
        seen, image = browser.observe(), b""
        if self.drawings is not None:
            name, image = await self.drawings.of(browser.body)
            seen = msgspec.structs.replace(seen, screenshot=name)
        if seen.screenshot not in self.signs:
            self.signs[seen.screenshot] = read_page(browser.body).signs
        return View(seen, image)


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
        return await self._rehearsal.look(self._browser)

    async def close(self) -> None:
        """Forget the visitor."""
        self._rehearsal.leave(self.id)


class Rehearsals:
    """Attempts one by one, without a run: nothing of them is kept but the episode.

    Args:
        rehearsal: where.
        agent: decides.
        config: limits.
        seed: of the policy's play.
    """

    def __init__(self, rehearsal: Rehearsal, agent: Agent, config: AttemptConfig, seed: int = 0) -> None:
        self._rehearsal = rehearsal
        self._context = AttemptContext(
            client=rehearsal,
            agent=agent,
            store=_KeepsNothing(),
            config=config,
            progress=Progress(total=0),
            site_state=rehearsal,
            run_id="rehearsal",
            seed=seed,
        )

    async def make(self, planned: Planned) -> Episode:
        """An attempt, as a collector would have recorded it.

        Raises:
            PolicyError: it did not come to an end of its own, and not because no reply held an action.
        """
        attempt = Attempt(self._context, planned)
        session = await self._rehearsal.open(attempt.options())
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
