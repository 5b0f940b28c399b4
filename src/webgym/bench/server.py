"""``webgym bench server``: the browser server compared with Chromium alone, freezing, and density.

Everything is measured in one run and compared as ratios; contenders take turns.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from typing import get_args

import msgspec

from webgym.bench.pages import PageServer, serving_pages
from webgym.bench.stepping import (
    KINDS,
    MEGABYTE,
    BenchPlan,
    CpuTimes,
    Report,
    StepFunction,
    StepTimes,
    Visitor,
    browser_bytes,
    browser_for,
    by_kind,
    click_or_scroll,
    config_for,
    measured_server,
    milliseconds,
    quantile,
    run_steps,
    sessions_on,
    spread,
    step_function,
    wait_until,
)
from webgym.browser.cdp import CommandFailed
from webgym.browser.cdp import Session as CdpSession
from webgym.browser.cdp_messages import Attached, BrowserContext, CreatedTarget, EmptyReply, Screenshot
from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot
from webgym.core.action import Navigate
from webgym.core.tables import Table, printed
from webgym.server.client import BrowserClient, Session
from webgym.server.config import Admission, Queues
from webgym.server.messages import Pressure, SessionOptions

PAUSE_SECONDS = 0.05
"""Pause between input and screenshot."""
_CALL_SECONDS = 60.0
_WIDTH, _HEIGHT = 1280, 768
_CALM_SECONDS = 3.0
"""Pause before idle CPU use is measured, and duration of that measurement, at most."""


# --- the ceiling -------------------------------------------------------------------------------------------

# Three contenders take turns on the same pages: a bare loop over the tabs of one browser, the same loop with
# a browser per tab, and the server. The first has no isolation, so that one crash ends all tabs; the second
# has the isolation of the server and nothing else. The difference between the first two is the cost of
# isolation, that between the last two the cost of everything else that the server does.
#
# A step of a bare loop is an input event, a fixed pause for the page to react, and a screenshot, without
# leases, HTTP, observations, or waiting for the page to settle.

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
    attached = await connection.call("Target.attachToTarget", attach, reply=Attached, seconds=_CALL_SECONDS)
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


# --- freezing while the model thinks ---------------------------------------------------------------------


class Thinking(msgspec.Struct, frozen=True):
    """Sessions on busy pages with a pause between steps, with and without freezing in the pauses.

    Attributes:
        sessions: their number.
        think_seconds: the pause between the steps of a session.
        frozen: steps with freezing.
        unfrozen: steps without freezing.
        idle: CPU use of the browsers in cores while no session makes a step: with and without freezing.
    """

    sessions: int
    think_seconds: float
    frozen: StepTimes
    unfrozen: StepTimes
    idle: tuple[float, float]

    @property
    def allowed(self) -> float:
        """Steps per second if steps took no time."""
        return self.sessions / self.think_seconds

    def table(self) -> Table:
        """Both kinds of slots, and the ratio between them."""
        rows = []
        slots = (("frozen between steps", self.frozen), ("not frozen", self.unfrozen))
        for (name, run), idle in zip(slots, self.idle, strict=True):
            times = [milliseconds(run.latencies, share) for share in (0.5, 0.95)]
            rates = (f"{run.rate:.1f}", f"{run.rate / self.allowed:.2f}")
            rows.append((name, f"{idle:.2f}", *times, *rates, str(run.failures)))
        if self.frozen.latencies and self.unfrozen.latencies:
            slower = quantile(self.unfrozen.latencies, 0.5) / quantile(self.frozen.latencies, 0.5)
            faster = self.frozen.rate / self.unfrozen.rate
            rows.append(("ratio", "", f"{slower:.1f}x", "", f"{faster:.1f}x", "", ""))
        return Table(
            f"{self.sessions} sessions on busy pages, {self.think_seconds:g} s of thinking per step "
            f"(at most {self.allowed:.1f} steps/s)",
            (
                "slots",
                "idle CPU use, cores",
                "step p50, ms",
                "p95, ms",
                "steps/s",
                "of the maximum",
                "failed",
            ),
            rows,
        )


async def thinking(plan: BenchPlan, pages: PageServer, report: Report) -> Thinking:
    """Measure step latency and throughput of many sessions on busy pages, with and without freezing."""
    runs, idle = [], []
    calm = min(_CALM_SECONDS, plan.thinking_seconds)
    for freeze in (True, False):
        report(f"{plan.thinkers} busy sessions, {'frozen' if freeze else 'running'} while the model thinks")
        async with measured_server(config_for(plan.thinkers, pages, freeze=freeze)) as (address, client):
            visitors = [Visitor(client, pages.url("busy")) for _ in range(plan.thinkers)]
            await asyncio.gather(*(visitor.open() for visitor in visitors))
            await asyncio.sleep(calm)
            cpu, began = CpuTimes(address.pid), time.perf_counter()
            await asyncio.sleep(calm)
            used = cpu.since_last()
            idle.append((sum(used.values()) - used.get("server", 0.0)) / (time.perf_counter() - began))
            run = await run_steps([v.step for v in visitors], plan.thinking_seconds, plan.think_seconds)
            runs.append(msgspec.structs.replace(run, cpu=cpu.since_last()))
    return Thinking(plan.thinkers, plan.think_seconds, runs[0], runs[1], (idle[0], idle[1]))


# --- cost per operation ----------------------------------------------------------------------------------


class Cost(msgspec.Struct, frozen=True):
    """The cost of an operation.

    Attributes:
        operation: its name.
        cpu: CPU milliseconds per call, by kind of process.
        wall: median wall time per call, milliseconds.
    """

    operation: str
    cpu: dict[str, float]
    wall: float


async def costs(plan: BenchPlan, pages: PageServer, report: Report) -> list[Cost]:
    """Measure the CPU time of every kind of operation, one call at a time."""
    report("CPU time per operation")
    results = []
    slots = 4
    async with measured_server(config_for(slots, pages)) as (address, client):
        sessions = await sessions_on(client, slots, pages.url("static"))
        meter = CpuTimes(address.pid)
        operations: dict[str, Callable[[Session, int], Awaitable[object]]] = {
            "navigate": lambda session, _: session.navigate(pages.url("static")),
            "execute": lambda session, number: session.execute(click_or_scroll(number)),
            "screenshot": lambda session, _: session.screenshot(),
            "metadata": lambda session, _: session.metadata(),
            "step": lambda session, number: step_function(session)(number),
        }
        for name, operation in operations.items():
            meter.since_last()
            walls = []
            for number in range(plan.calls):
                began = time.perf_counter()
                await operation(sessions[number % slots], number // slots)
                walls.append(time.perf_counter() - began)
            results.append(_cost(name, meter.since_last(), walls))
        for session in sessions:
            await session.close()
        results.extend(await _open_and_close(plan, client, meter, slots))
    return results


async def _open_and_close(plan: BenchPlan, client: BrowserClient, meter: CpuTimes, slots: int) -> list[Cost]:
    """The cost of opening and closing sessions while slots are free; the CPU time is that of both."""
    opened: list[float] = []
    closed: list[float] = []
    for _ in range(plan.calls):
        await wait_until(client, lambda pressure: pressure.slots.free == slots)
        if not opened:
            meter.since_last()
        began = time.perf_counter()
        session = await client.open(SessionOptions())
        opened.append(time.perf_counter() - began)
        began = time.perf_counter()
        await session.close()
        closed.append(time.perf_counter() - began)
    await wait_until(client, lambda pressure: pressure.slots.free == slots)
    cost = _cost("allocate + release", meter.since_last(), opened)
    return [
        cost,
        Cost("  allocate, p95", {}, quantile(opened, 0.95) * 1000),
        Cost("  release", {}, quantile(closed, 0.5) * 1000),
    ]


def _cost(name: str, seconds: dict[str, float], walls: list[float]) -> Cost:
    cpu = {kind: used * 1000 / len(walls) for kind, used in seconds.items() if used > 0}
    return Cost(name, cpu, quantile(walls, 0.5) * 1000)


def _cost_table(costs: Sequence[Cost]) -> Table:
    rows = [
        (cost.operation, *(by_kind(cost.cpu) if cost.cpu else [""] * (len(KINDS) + 1)), f"{cost.wall:.1f}")
        for cost in costs
    ]
    return Table(
        "CPU milliseconds per call, one at a time, by kind of process; median wall milliseconds",
        ("operation", *KINDS.values(), "all", "wall"),
        rows,
    )


# --- a burst of navigations -----------------------------------------------------------------------------


class Burst(msgspec.Struct, frozen=True):
    """Times of screenshots that were requested during a burst of navigations.

    Attributes:
        navigations: their number.
        seconds: times of the screenshots, by kind of queue.
    """

    navigations: int
    seconds: dict[str, list[float]]

    def table(self) -> Table:
        """The times by kind of queue."""
        rows = [
            (name.replace("_", " "), milliseconds(waits, 0.5), milliseconds(waits, 1.0))
            for name, waits in self.seconds.items()
        ]
        return Table(
            f"Screenshots that are requested during a burst of {self.navigations} navigations",
            ("queue", "p50, ms", "max, ms"),
            rows,
        )


async def burst(plan: BenchPlan, pages: PageServer, report: Report) -> Burst:
    """Time screenshots during a burst of navigations, with a queue per operation and with one queue."""
    seconds: dict[str, list[float]] = {}

    screenshots = max(2, plan.burst // 6)

    def is_under_way(now: Pressure) -> bool:
        load = now.operations["navigate"]
        first = plan.burst + screenshots  # of each session
        return load.done + load.running + load.waiting - first >= plan.burst // 2

    for queues in get_args(Queues):
        report(f"screenshots during {plan.burst} navigations, {queues.replace('_', ' ')} queue")
        admission = Admission(queues=queues)
        async with measured_server(config_for(plan.burst + screenshots, pages, admission=admission)) as (
            _,
            client,
        ):
            sessions = await sessions_on(client, plan.burst + screenshots, pages.url("static"))
            navigating, waiting = sessions[: plan.burst], sessions[plan.burst :]
            waits: list[float] = []

            async def screenshot(session: Session, waits: list[float] = waits) -> None:
                began = time.perf_counter()
                await session.screenshot()
                waits.append(time.perf_counter() - began)

            async with asyncio.TaskGroup() as group:
                for session in navigating:
                    group.create_task(session.step(Navigate(pages.url("static"))))
                await wait_until(client, is_under_way)
                for session in waiting:
                    group.create_task(screenshot(session))
            seconds[queues] = waits
    return Burst(plan.burst, seconds)


# --- density ---------------------------------------------------------------------------------------------


class Density(msgspec.Struct, frozen=True):
    """The results of the part ``density``: many parallel sessions.

    Attributes:
        sessions: their number.
        ready_seconds: time from the start of the server until all slots were ready.
        bytes: proportional set size of all browsers, by number of sessions, each of which shows a page.
        steps: steps of all sessions.
    """

    sessions: int
    ready_seconds: float
    bytes: dict[int, int]
    steps: StepTimes

    @property
    def marginal(self) -> float:
        """Bytes per additional session."""
        (few, at_few), (many, at_many) = min(self.bytes.items()), max(self.bytes.items())
        return (at_many - at_few) / (many - few)

    def table(self) -> Table:
        """What many sessions need, and how they step."""
        run = self.steps
        rows = [
            ("live sessions", str(self.sessions)),
            ("failed steps", f"{run.failures} of {run.steps}"),
            ("time until all were ready, s", f"{self.ready_seconds:.0f}"),
            ("memory per additional session (PSS), MB", f"{self.marginal / MEGABYTE:.0f}"),
            ("memory of all browsers, GB", f"{max(self.bytes.values()) / MEGABYTE / 1024:.1f}"),
            ("steps per second, half of the sessions on busy pages", f"{run.rate:.1f}"),
            ("step p50 / p95, ms", milliseconds(run.latencies, 0.5, 0.95)),
        ]
        return Table("Density", ("", "measured"), rows)


async def density(plan: BenchPlan, pages: PageServer, report: Report) -> Density:
    """Measure many sessions at the same time, half of them on static and half on busy pages."""
    sizes: dict[int, int] = {}
    began = time.perf_counter()
    few = max(1, plan.dense // 8)
    for slots in (few, plan.dense):
        report(f"starting {slots} sessions")
        began = time.perf_counter()
        async with measured_server(config_for(slots, pages)) as (address, client):
            ready = time.perf_counter() - began
            sessions = await sessions_on(client, slots, pages.url("static"))
            await asyncio.gather(*(step_function(session)(0) for session in sessions))
            sizes[slots] = await asyncio.to_thread(browser_bytes, address.pid)
            if slots == few:
                continue
            report(f"{slots} sessions step, half of them on busy pages")
            await asyncio.gather(*(s.step(Navigate(pages.url("busy"))) for s in sessions[::2]))

            steps = await run_steps(
                [step_function(s) for s in sessions], plan.thinking_seconds, plan.think_seconds
            )
    return Density(plan.dense, ready, sizes, steps)


# --- all parts -------------------------------------------------------------------------------------------


class ServerFigures(msgspec.Struct, frozen=True, omit_defaults=True):
    """The results of a run; parts that were not run are ``None``.

    Attributes:
        plan: the size of the benchmark.
        browser: the version of Chromium.
        processors: the number that this process may use.
    """

    plan: BenchPlan
    browser: str
    processors: int
    ceiling: list[Ceiling] | None = None
    costs: list[Cost] | None = None
    thinking: Thinking | None = None
    burst: Burst | None = None
    density: Density | None = None

    @property
    def head(self) -> str:
        """What was measured: the browser and the machine."""
        return f"Chromium {self.browser}, {self.processors} processors"

    def __str__(self) -> str:
        return printed([self.head, "", *self.tables()])

    def tables(self) -> Iterator[Table]:
        """The tables of every part that was run."""
        if self.ceiling:
            yield from ceiling_tables(self.ceiling, self.plan.sessions)
        if self.costs:
            yield _cost_table(self.costs)
        for part in (self.thinking, self.burst, self.density):
            if part is not None:
                yield part.table()


PARTS = ("ceiling", "costs", "thinking", "burst", "density")


async def measure(
    plan: BenchPlan, parts: Sequence[str], browser: Path | None, report: Report
) -> AsyncIterator[ServerFigures]:
    """Run parts of the benchmark.

    Args:
        plan: their size.
        parts: of :data:`PARTS`.
        browser: the executable; ``None`` searches for one.
        report: called with a line about the progress.

    Yields:
        All results so far, after every part, and after every round of the part ``ceiling``.
    """
    chromium = await asyncio.to_thread(find_browser, browser)
    figures = ServerFigures(plan, chromium.version, len(os.sched_getaffinity(0)))
    async with serving_pages() as pages:
        runs: dict[str, Callable[[], Awaitable[object]]] = {
            "costs": lambda: costs(plan, pages, report),
            "thinking": lambda: thinking(plan, pages, report),
            "burst": lambda: burst(plan, pages, report),
            "density": lambda: density(plan, pages, report),
        }
        if "ceiling" in parts:
            async for rounds in against_ceiling(plan, chromium.path, pages, report):
                figures = msgspec.structs.replace(figures, ceiling=rounds)
                yield figures
        for part, run in runs.items():
            if part in parts:
                figures = msgspec.structs.replace(figures, **{part: await run()})
                yield figures
