"""Three treatments of pages while the model thinks: let them run, stop processes, withhold frames.

    python benchmarks/frame_control.py

Each way has its own browsers, with one busy page each (animation, canvas, timer). Measured are the CPU use
without actions, and CPU time and latency of a step (scroll, 50 ms pause, screenshot). Frame control is
`HeadlessExperimental.beginFrame` of Chromium: a page draws only on command, but its timers keep running.
"""

from __future__ import annotations

import asyncio
import logging
import os
import statistics
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import uvloop

from webgym.bench.pages import PageServer, serving_pages
from webgym.bench.usage import CpuTimes
from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import BrowserContext, CreatedTarget, Nothing, Screenshot, Wire
from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot
from webgym.core.errors import BrowserError

PAGES = 4
STEPS = 25
IDLE_SECONDS = 4.0
PAUSE_SECONDS = 0.05
FRAME_MILLISECONDS = 16.6
CALL_SECONDS = 8.0
PICTURE = {"format": "png", "optimizeForSpeed": True}
FLAGS = (
    "--enable-begin-frame-control --run-all-compositor-stages-before-draw "
    "--disable-new-content-rendering-timeout"
)
WAYS = ("running", "stopped", "frame control")


class Attached(Wire, frozen=True):
    session_id: str


class Frame(Wire, frozen=True):
    screenshot_data: bytes = b""


class Tab:
    """A busy page in its own browser."""

    def __init__(self, way: str, process: BrowserProcess, session: Session) -> None:
        self.way = way
        self.process = process
        self.session = session
        self.missing = 0
        self._is_loaded = asyncio.Event()
        session.on("Page.loadEventFired", Nothing, lambda _: self._is_loaded.set())

    async def do(self, method: str, **params: Any) -> None:
        await self.session.do(method, params, seconds=CALL_SECONDS)

    async def frame(self, **params: Any) -> Frame:
        params["interval"] = FRAME_MILLISECONDS
        return await self.session.call(
            "HeadlessExperimental.beginFrame", params, reply=Frame, seconds=CALL_SECONDS
        )

    async def open(self, url: str) -> None:
        await self.do("Page.enable")
        await self.do("Page.navigate", url=url)
        while not self._is_loaded.is_set():
            if self.way == "frame control":
                await self.frame()
            await asyncio.sleep(FRAME_MILLISECONDS / 1000)

    async def step(self, number: int) -> None:
        down = 576 if number % 4 < 2 else -576
        wheel = self.do("Input.dispatchMouseEvent", type="mouseWheel", x=640, y=384, deltaX=0, deltaY=down)
        if self.way == "frame control":
            turned = asyncio.ensure_future(wheel)  # completes with a frame
            while not turned.done():
                await self.frame()
            await asyncio.sleep(PAUSE_SECONDS)
            await self.frame()
            picture = (await self.frame(screenshot=PICTURE)).screenshot_data
            self.missing += not picture
            return
        if self.way == "stopped":
            self.process.thaw()
        await wheel
        await asyncio.sleep(PAUSE_SECONDS)
        await self.session.call("Page.captureScreenshot", PICTURE, reply=Screenshot, seconds=CALL_SECONDS)
        if self.way == "stopped":
            self.process.freeze()


async def tab(way: str, executable: Path, egress: Egress, config: BrowserConfig) -> Tab:
    process, _ = await launch_sandboxed(config, executable, ProfileRoot(), None, egress)
    connection = process.connection
    context = await connection.call("Target.createBrowserContext", reply=BrowserContext, seconds=CALL_SECONDS)
    wanted: dict[str, Any] = {
        "url": "about:blank",
        "browserContextId": context.browser_context_id,
        "width": 1280,
        "height": 768,
    }
    if way == "frame control":
        wanted["enableBeginFrameControl"] = True
    made = await connection.call("Target.createTarget", wanted, reply=CreatedTarget, seconds=CALL_SECONDS)
    attach = {"targetId": made.target_id, "flatten": True}
    attached = await connection.call("Target.attachToTarget", attach, reply=Attached, seconds=CALL_SECONDS)
    return Tab(way, process, Session(connection, attached.session_id))


async def measure(way: str, executable: Path, pages: PageServer) -> str:
    config = BrowserConfig().allowing(pages.rule)
    latencies: list[float] = []
    failed = 0
    async with AsyncExitStack() as stack:
        egress = await stack.enter_async_context(Egress(config.egress))
        tabs = [await tab(way, executable, egress, config) for _ in range(PAGES)]
        for one in tabs:
            stack.push_async_callback(one.process.kill)
        for one in tabs:
            await one.open(pages.url("busy"))
            await one.step(0)
        cpu = CpuTimes(os.getpid())
        await asyncio.sleep(IDLE_SECONDS)
        used = cpu.since_last()
        idle = (sum(used.values()) - used.get("server", 0.0)) / IDLE_SECONDS

        async def run(one: Tab) -> None:
            nonlocal failed
            for number in range(STEPS):
                start = time.perf_counter()
                try:
                    await one.step(number)
                except BrowserError:
                    failed += 1
                    return
                latencies.append(time.perf_counter() - start)

        await asyncio.gather(*map(run, tabs))
        spent = sum(cpu.since_last().values())
    steps = max(1, len(latencies))
    p50 = statistics.median(latencies) if latencies else float("nan")
    missing = sum(one.missing for one in tabs)
    return (
        f"| {way} | {idle:.2f} | {spent / steps * 1000:.1f} ms | {p50 * 1000:.0f} ms "
        f"| {len(latencies)} of {PAGES * STEPS} | {missing} | {failed} |"
    )


async def main() -> None:
    logging.disable()
    browser = find_browser().path
    print(f"| {PAGES} busy pages | idle CPU use, cores | CPU per step | p50 | steps | no screenshot | hung |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        controlled = Path(folder) / "chromium"
        controlled.write_text(f'#!/bin/sh\nexec "{browser}" {FLAGS} "$@"\n')
        controlled.chmod(0o755)
        async with serving_pages() as pages:
            for way in WAYS:
                print(await measure(way, controlled if way == "frame control" else browser, pages))


if __name__ == "__main__":
    uvloop.run(main())
