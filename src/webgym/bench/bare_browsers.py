"""Chromium without a browser server: the highest speed that a server could reach.

A step is an input event, a fixed pause for the page to react, and a screenshot, without leases, HTTP,
observations, or waiting for the page to settle. The tabs of a browser are not isolated from each other.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from pathlib import Path

from webgym.browser.cdp import CommandFailed, Session
from webgym.browser.cdp_messages import BrowserContext, CdpMessage, CreatedTarget, EmptyReply, Screenshot
from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot

PAUSE_SECONDS = 0.05
"""Pause between input and screenshot."""
_CALL_SECONDS = 60.0
_WIDTH, _HEIGHT = 1280, 768


class _Attached(CdpMessage, frozen=True):
    session_id: str


class BareTab:
    """A tab in its own browser context."""

    def __init__(self, session: Session) -> None:
        self._session = session

    async def _do(self, method: str, **params: object) -> None:
        await self._session.do(method, params, seconds=_CALL_SECONDS)

    async def open(self, url: str) -> None:
        """Navigate to a URL and wait for the load event."""
        loaded = asyncio.Event()
        unsubscribe = self._session.on("Page.loadEventFired", EmptyReply, lambda _: loaded.set())
        await self._do("Page.navigate", url=url)
        await loaded.wait()
        unsubscribe()

    async def step(self, number: int) -> bytes:
        """Click or scroll in turn, pause, and take a screenshot.

        Returns:
            A PNG, encoded for speed.
        """
        if number % 2:
            await self._do(
                "Input.dispatchMouseEvent", type="mousePressed", x=40, y=400, button="left", clickCount=1
            )
            await self._do(
                "Input.dispatchMouseEvent", type="mouseReleased", x=40, y=400, button="left", clickCount=1
            )
        else:
            down = 576 if number % 4 else -576
            await self._do("Input.dispatchMouseEvent", type="mouseWheel", x=640, y=384, deltaX=0, deltaY=down)
        await asyncio.sleep(PAUSE_SECONDS)
        return await self._picture()

    async def _picture(self) -> bytes:
        params = {"format": "png", "optimizeForSpeed": True}
        while True:
            try:
                shot = await self._session.call(
                    "Page.captureScreenshot", params, reply=Screenshot, seconds=_CALL_SECONDS
                )
            except CommandFailed:
                continue  # fails while another tab opens or closes
            return shot.data


class BareBrowsers:
    """Browsers with tabs, whose processes are stopped while others are measured."""

    def __init__(self, processes: list[BrowserProcess], tabs: list[BareTab]) -> None:
        self._processes = processes
        self.tabs = tabs

    @property
    def pids(self) -> list[int]:
        """Process ids of the browsers."""
        return [process.pid for process in self._processes]

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let the browsers run until the block ends."""
        for process in self._processes:
            process.thaw()
        yield
        for process in self._processes:
            process.freeze()


async def _open_tab(process: BrowserProcess) -> BareTab:
    connection = process.connection
    context = await connection.call(
        "Target.createBrowserContext", reply=BrowserContext, seconds=_CALL_SECONDS
    )
    params = {
        "url": "about:blank",
        "browserContextId": context.browser_context_id,
        "width": _WIDTH,
        "height": _HEIGHT,
    }
    target = await connection.call("Target.createTarget", params, reply=CreatedTarget, seconds=_CALL_SECONDS)
    attach = {"targetId": target.target_id, "flatten": True}
    attached = await connection.call("Target.attachToTarget", attach, reply=_Attached, seconds=_CALL_SECONDS)
    session = Session(connection, attached.session_id)
    size = {"width": _WIDTH, "height": _HEIGHT, "deviceScaleFactor": 1, "mobile": False}
    await session.do("Page.enable", seconds=_CALL_SECONDS)
    await session.do("Emulation.setDeviceMetricsOverride", size, seconds=_CALL_SECONDS)
    return BareTab(session)


@asynccontextmanager
async def bare_browsers(
    executable: Path, browsers: int, tabs: int, config: BrowserConfig
) -> AsyncIterator[BareBrowsers]:
    """Run browsers with tabs until the block ends.

    Args:
        executable: the browser.
        browsers: their number.
        tabs: the number of tabs of each.
        config: of the browsers.
    """
    async with AsyncExitStack() as stack:
        egress = await stack.enter_async_context(Egress(config.egress))
        processes = []
        for _ in range(browsers):
            process, _ = await launch_sandboxed(config, executable, ProfileRoot(), None, egress.main)
            stack.push_async_callback(process.kill)
            processes.append(process)
        yield BareBrowsers(
            processes, [await _open_tab(process) for process in processes for _ in range(tabs)]
        )
