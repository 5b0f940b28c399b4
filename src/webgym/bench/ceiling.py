"""The browser server compared with Chromium alone.

Three contenders take turns on the same pages: a bare loop over the tabs of one browser, the same loop with a
browser per tab, and the server. The first has no isolation, so that one crash ends all tabs; the second has
the isolation of the server and nothing else. The difference between the first two is the cost of isolation,
that between the last two the cost of everything else that the server does.

A step of a bare loop is an input event, a fixed pause for the page to react, and a screenshot, without
leases, HTTP, observations, or waiting for the page to settle.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from pathlib import Path

import msgspec

from webgym.bench.pages import PageServer
from webgym.bench.stepping import (
    KINDS,
    BenchPlan,
    Report,
    StepFunction,
    StepTimes,
    browser_for,
    by_kind,
    config_for,
    measured_server,
    milliseconds,
    run_steps,
    sessions_on,
    spread,
    step_function,
)
from webgym.bench.usage import CpuTimes
from webgym.browser.cdp import CommandFailed
from webgym.browser.cdp import Session as CdpSession
from webgym.browser.cdp_messages import BrowserContext, CdpMessage, CreatedTarget, EmptyReply, Screenshot
from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot
from webgym.core.action import Navigate
from webgym.core.tables import Table
from webgym.server.client import Session

PAUSE_SECONDS = 0.05
"""Pause between input and screenshot."""
_CALL_SECONDS = 60.0
_WIDTH, _HEIGHT = 1280, 768


SHARED, APART, SERVER = "bare loop, one browser", "bare loop, a browser each", "server"


class Ceiling(msgspec.Struct, frozen=True):
    """Rounds on one page.

    Attributes:
        page: its name.
        rounds: by contender.
    """

    page: str
    rounds: dict[str, list[StepTimes]]

    def ratios(self, name: str) -> list[float]:
        """Steps per second of the server over those of a contender, for each round in which both made any."""
        pairs = zip(self.rounds[SERVER], self.rounds[name], strict=True)
        return [server.rate / other.rate for server, other in pairs if server.rate and other.rate]


# --- Chromium without a server ---------------------------------------------------------------------------


class _Attached(CdpMessage, frozen=True):
    session_id: str


class BareTab:
    """A tab in its own browser context."""

    def __init__(self, session: CdpSession) -> None:
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
            for kind in ("mousePressed", "mouseReleased"):
                await self._do(
                    "Input.dispatchMouseEvent", type=kind, x=40, y=400, button="left", clickCount=1
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
    session = CdpSession(connection, attached.session_id)
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


# --- the comparison ---------------------------------------------------------------------------------------


class _Contender:
    """A contender: its step functions and meters of its CPU time."""

    def __init__(self, name: str, step_functions: Sequence[StepFunction], meters: Sequence[CpuTimes]) -> None:
        self.name = name
        self._step_functions = step_functions
        self._meters = meters

    async def round(self, seconds: float) -> StepTimes:
        self._used()
        own = time.process_time()
        run = await run_steps(self._step_functions, seconds)
        cpu = {**self._used(), "client": time.process_time() - own}
        return msgspec.structs.replace(run, cpu=cpu)

    def _used(self) -> dict[str, float]:
        used: dict[str, float] = {}
        for meter in self._meters:
            for kind, seconds in meter.since_last().items():
                used[kind] = used.get(kind, 0.0) + seconds
        return used


class _Bare(_Contender):
    """A bare loop, whose browsers are stopped while others are measured."""

    def __init__(self, name: str, bare: BareBrowsers) -> None:
        super().__init__(name, [tab.step for tab in bare.tabs], [CpuTimes(pid) for pid in bare.pids])
        self._bare = bare

    async def open(self, url: str) -> None:
        with self._bare.running():
            await asyncio.gather(*(tab.open(url) for tab in self._bare.tabs))

    async def round(self, seconds: float) -> StepTimes:
        with self._bare.running():
            return await super().round(seconds)


class _Served(_Contender):
    """The sessions of a server."""

    def __init__(self, sessions: Sequence[Session], pid: int) -> None:
        super().__init__(SERVER, [step_function(session) for session in sessions], [CpuTimes(pid)])
        self._sessions = sessions

    async def open(self, url: str) -> None:
        await asyncio.gather(*(session.step(Navigate(url)) for session in self._sessions))


async def against_ceiling(
    plan: BenchPlan, executable: Path, pages: PageServer, report: Report
) -> AsyncIterator[list[Ceiling]]:
    """Measure the server and the bare loops, in turn, on each page.

    Yields:
        The results so far, after every round.
    """
    finished: list[Ceiling] = []
    config = browser_for(pages)
    async with AsyncExitStack() as stack:
        report(f"starting {plan.sessions} sessions, and bare browsers with as many tabs")
        address, client = await stack.enter_async_context(measured_server(config_for(plan.sessions, pages)))
        sessions = await sessions_on(client, plan.sessions, pages.url("static"))
        shared = await stack.enter_async_context(bare_browsers(executable, 1, plan.sessions, config))
        apart = await stack.enter_async_context(bare_browsers(executable, plan.sessions, 1, config))
        contenders = (_Bare(SHARED, shared), _Bare(APART, apart), _Served(sessions, address.pid))
        for page in ("static", "busy"):
            for contender in contenders:
                await contender.open(pages.url(page))
            rounds: dict[str, list[StepTimes]] = {contender.name: [] for contender in contenders}
            for number in range(plan.rounds):
                report(f"{page} pages, round {number + 1} of {plan.rounds}")
                made = [
                    (contender.name, await contender.round(plan.round_seconds)) for contender in contenders
                ]
                for name, run in made:
                    rounds[name].append(run)
                yield [*finished, Ceiling(page, rounds)]
            finished.append(Ceiling(page, rounds))


def ceiling_tables(results: Sequence[Ceiling], sessions: int) -> Iterator[Table]:
    """Steps per second and latencies, and the CPU time of a step."""
    rates, costs = [], []
    for ceiling in results:
        for name, runs in ceiling.rounds.items():
            row, steps = f"{ceiling.page}, {name}", sum(run.steps for run in runs)
            ratio = "" if name == SERVER else spread(ceiling.ratios(name), 2)
            latencies = [latency for run in runs for latency in run.latencies]
            rates.append((row, spread([run.rate for run in runs]), ratio, milliseconds(latencies, 0.5, 0.95)))
            kinds = {kind for run in runs for kind in run.cpu}
            cpu = {kind: sum(run.cpu.get(kind, 0.0) for run in runs) * 1000 / max(1, steps) for kind in kinds}
            costs.append((row, *by_kind(cpu)))
    yield Table(
        f"Against the ceiling: {sessions} sessions, median (min-max) of rounds",
        ("pages", "steps per second", "server / this", "step p50 / p95, ms"),
        rates,
    )
    yield Table("CPU milliseconds per step, by kind of process", ("pages", *KINDS.values(), "all"), costs)
