"""A small website, and slots with a real Chromium."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.types import Receive, Scope, Send
from tests.serving import serving as serving_on_loopback

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.observe import Look
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate, Target
from webgym.core.observation import Element

VIEWPORT = (800, 600)
"""Of most tests: drawing and sending half of the usual pixels saves an eighth of a step's CPU time."""

Handler = Callable[[Request], Awaitable[Response]]


class Site:
    """Pages by path, each answered by a handler; what was asked for is kept in ``hits``."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.hits: list[str] = []
        self._handlers: dict[str, Handler] = {}
        self._count = 0

    def url(self, path: str = "/") -> str:
        return f"http://127.0.0.1:{self.port}{path}"

    def elsewhere(self, url: str, host: str = "a") -> str:
        """The same page at another origin."""
        return url.replace(self.url(""), f"http://{host}.elsewhere.test")

    def page(self, body: str, path: str | None = None, *, status: int = 200) -> str:
        """Serve this HTML; its URL."""
        self._count += 1
        path = path or f"/page{self._count}"

        async def answer(_: Request) -> Response:
            return HTMLResponse(f"<!doctype html><meta charset=utf-8>{body}", status)

        return self.on(path, answer)

    def on(self, path: str, handler: Handler) -> str:
        self._handlers[path] = handler
        return self.url(path)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope, receive)
        self.hits.append(request.url.path)
        handler = self._handlers.get(request.url.path)
        response = await handler(request) if handler else Response("nothing here", 404)
        await response(scope, receive, send)


def serving() -> AbstractAsyncContextManager[Site]:
    return serving_on_loopback(Site, lambda site: site)


@pytest.fixture(scope="session")
def executable() -> Path:
    return find_browser().path


@pytest.fixture(scope="package")
def profiles(tmp_path_factory: pytest.TempPathFactory) -> ProfileRoot:
    return ProfileRoot(tmp_path_factory.mktemp("profiles"))


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def module_site() -> AsyncIterator[Site]:
    async with serving() as site:
        yield site


@pytest.fixture
def site(module_site: Site) -> Site:
    module_site.hits.clear()
    return module_site


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def egress(module_site: Site) -> AsyncIterator[Egress]:
    """A way out that leads to this machine, where the small website is, under other names as well."""
    elsewhere = f"*.elsewhere.test=127.0.0.1:{module_site.port}"
    async with Egress(EgressConfig(allow=("127.0.0.1", elsewhere))) as egress:
        yield egress


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def shared_slot(executable: Path, profiles: ProfileRoot, egress: Egress) -> AsyncIterator[Slot]:
    """One browser for all modules: every test has an episode of its own in it."""
    slot = Slot(BrowserConfig(), executable, profiles, egress)
    yield slot
    await slot.stop()


MODES = pytest.mark.parametrize("mode", ["marks", pytest.param("coordinates", marks=pytest.mark.slow)])
"""Of tests in which it matters little how an element is pointed at: ``make test`` has one of them."""


def one_in(every: int, rows: Iterable[str]) -> list[Any]:
    """The names of a table's rows that make the same assertion: ``make test`` has one in so many of them."""
    return [
        pytest.param(name, marks=() if number % every == 0 else pytest.mark.slow)
        for number, name in enumerate(rows)
    ]


def batches(every: int, rows: Iterable[str], size: int = 12) -> list[Any]:
    """The same, a dozen names for one tab: to clear a tab costs as much as to look at a small page."""
    names = list(rows)
    quick, slow = names[::every], [name for number, name in enumerate(names) if number % every]
    parts: list[tuple[list[str], Any]] = [(quick, ()), (slow, pytest.mark.slow)]
    return [
        pytest.param(some[at : at + size], id=some[at], marks=marks)
        for some, marks in parts
        for at in range(0, len(some), size)
    ]


class Tab:
    """A slot with an open episode, and the last look."""

    def __init__(self, slot: Slot, options: PageOptions) -> None:
        self.slot = slot
        self.options = options
        self.last: Look | None = None

    async def step(self, action: object = None) -> Look:
        self.last = await self.slot.step(action)  # type: ignore[arg-type]
        return self.last

    async def goto(self, url: str) -> Look:
        return await self.step(Navigate(url))

    def find(self, name: str, role: str | None = None) -> Element:
        assert self.last is not None
        elements = self.last.observation.elements or ()
        found = [one for one in elements if one.name == name and role in (None, one.role)]
        assert found, f"no {name!r} among {[(one.role, one.name) for one in elements]}"
        return found[0]

    def at(self, name: str, role: str | None = None) -> Target:
        """Where to click this element, in the tab's mode."""
        element = self.find(name, role)
        if self.options.mode == "marks":
            return Target(element=element.number)
        x, y, width, height = element.box
        wide, tall = self.options.viewport
        return Target(coordinate=((x + width / 2) / wide * 1000, (y + height / 2) / tall * 1000))

    @property
    def text(self) -> list[str]:
        assert self.last is not None
        return (self.last.observation.text or "").split("\n")

    @property
    def notices(self) -> list[tuple[str, str]]:
        assert self.last is not None
        return [(notice.kind, notice.text) for notice in self.last.observation.notices]


Open = Callable[..., Awaitable[Tab]]
OUTSIDE = {"type": "mouseMoved", "x": -1, "y": -1}


@pytest_asyncio.fixture(loop_scope="package")
async def open_tab(request: pytest.FixtureRequest, shared_slot: Slot) -> AsyncIterator[Open]:
    """Open an episode, with limits of its own if need be.

    Without options it takes the last episode's tab, unless that test failed: without its cookies, history and
    what was learned, its mouse outside; but with the process that Chromium started for it, which is most of
    what a tab costs.
    """
    failed, is_usual = request.session.testsfailed, True

    async def open_one(mode: str = "coordinates", config: BrowserConfig | None = None, **more: object) -> Tab:
        nonlocal is_usual
        is_usual = config is None and not more
        usual: dict[str, object] = {"text": True, "elements": True, "viewport": VIEWPORT}
        options = PageOptions(mode=mode, **(usual | more))  # type: ignore[arg-type]
        if shared_slot.is_open and not shared_slot.is_frozen and is_usual:
            await shared_slot.begin_again(options)
            await shared_slot.page.session.do("Input.dispatchMouseEvent", OUTSIDE, seconds=5)
        else:
            shared_slot.config = config or BrowserConfig()
            await shared_slot.open(options)
        return Tab(shared_slot, options)

    yield open_one
    if not is_usual or request.session.testsfailed > failed:
        await shared_slot.close()
        shared_slot.config = BrowserConfig()


@pytest_asyncio.fixture(loop_scope="package")
async def tab(open_tab: Open) -> Tab:
    return await open_tab()


@pytest_asyncio.fixture(loop_scope="package")
async def new_tab(shared_slot: Slot, open_tab: Open) -> AsyncIterator[Tab]:
    """An episode in a tab that no other test had or gets."""
    await shared_slot.close()
    yield await open_tab()
    await shared_slot.close()
