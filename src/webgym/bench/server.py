"""``webgym bench server``: the browser server against Chromium's own ceiling, frozen and not, and how dense.

Everything is measured in one run and reported as ratios; rounds of what is compared take turns.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path

import msgspec

from webgym.bench.apart import Address, server_apart
from webgym.bench.bare import bare_browser
from webgym.bench.pages import PageServer, serving_pages
from webgym.bench.usage import CpuTimes, browser_bytes
from webgym.browser.config import BrowserConfig
from webgym.browser.find import find_browser
from webgym.core.action import BrowserAction, LeftClick, Navigate, Scroll, Target
from webgym.core.errors import WebGymError
from webgym.server import BrowserClient, ClientLimits, ServerConfig, Session, SessionOptions
from webgym.server.config import Admission
from webgym.server.messages import Pressure

Say = Callable[[str], None]

_CLICK = LeftClick(Target(coordinate=(31, 521)))
_READY_SECONDS = 900.0
_ARRIVAL_SECONDS = 60.0
_POLL_SECONDS = 0.01
_CALM_SECONDS = 3.0
"""Between the last call and the look at idle processors, and length of that look, at most."""


class BenchPlan(msgspec.Struct, frozen=True, kw_only=True):
    """How much is measured.

    Attributes:
        sessions: against the ceiling, and per round.
        rounds: of each kind, in turn.
        round_seconds: wall time of one.
        thinkers: sessions of the freezing comparison.
        think_seconds: pause between a picture and the next action.
        thinking_seconds: wall time of each half of the comparison.
        dense: sessions of the density run; 0 leaves it out.
        calls: per operation, for its CPU time.
    """

    sessions: int = 32
    rounds: int = 5
    round_seconds: float = 6.0
    thinkers: int = 64
    think_seconds: float = 5.0
    thinking_seconds: float = 45.0
    dense: int = 200
    calls: int = 48
    burst: int = 48


class Paced(msgspec.Struct, frozen=True):
    """Steps of one round.

    Attributes:
        latencies: seconds, one per step that ended well in the time that counts.
        steps: all of them.
        failures: those of them that failed.
        cpu: seconds by kind of process, for all of them.
    """

    seconds: float
    latencies: list[float]
    steps: int
    failures: int = 0
    cpu: dict[str, float] = {}

    @property
    def rate(self) -> float:
        """Steps per second."""
        return len(self.latencies) / self.seconds


def quantile(values: Sequence[float], share: float) -> float:
    """The value below which this share lies; 0 of nothing."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0.0


async def paced(
    steppers: Sequence[Callable[[int], Awaitable[object]]], seconds: float, think: float = 0.0
) -> Paced:
    """Let all step at once, each one step after the other with a pause between, for so long.

    What ends within ``seconds`` counts; they begin when all have begun. Those that think between their steps
    are not waited for when time is up.
    """
    start = time.perf_counter()
    latencies: list[float] = []
    steps = failures = 0

    async def loop(index: int, step: Callable[[int], Awaitable[object]]) -> None:
        nonlocal steps, failures
        # a model's replies do not come in lock step
        await asyncio.sleep(think * index / len(steppers))
        number = index
        while (began := time.perf_counter()) - start < think + seconds:
            try:
                await step(number)
            except WebGymError:
                failures += 1
            else:
                ended = time.perf_counter()
                if think < ended - start < think + seconds:
                    latencies.append(ended - began)
            number += 1
            steps += 1
            if think:
                await asyncio.sleep(think)

    with suppress(TimeoutError):
        async with asyncio.timeout(think + seconds if think else None), asyncio.TaskGroup() as group:
            for index, step in enumerate(steppers):
                group.create_task(loop(index, step))
    return Paced(seconds, latencies, steps, failures)


def deed(number: int) -> BrowserAction:
    """Click or scroll in turn, as the bare loop does."""
    return _CLICK if number % 2 else Scroll("down" if number % 4 else "up")


def stepper(session: Session) -> Callable[[int], Awaitable[object]]:
    """Steps of a session."""
    return lambda number: session.step(deed(number))


class Visitor:
    """Someone who steps on a page, and comes back in a new session when one is lost."""

    def __init__(self, client: BrowserClient, url: str) -> None:
        self._client = client
        self._url = url
        self._session: Session | None = None

    async def arrive(self) -> None:
        """See the page, however often it takes; whoever has not in good time begins with his first step."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_ARRIVAL_SECONDS):
                while self._session is None:
                    with suppress(WebGymError):
                        await self._enter()

    async def step(self, number: int) -> None:
        """One step.

        Raises:
            WebGymError: it failed.
        """
        session = self._session or await self._enter()
        try:
            await session.step(deed(number))
        except WebGymError:
            self._session = None
            with suppress(WebGymError):
                await session.close()
            raise

    async def _enter(self) -> Session:
        session = await self._client.open(SessionOptions())
        try:
            await session.step(Navigate(self._url))
        except WebGymError:
            with suppress(WebGymError):
                await session.close()
            raise
        self._session = session
        return session


# --- a server with sessions -----------------------------------------------------------------------------


@asynccontextmanager
async def measured_server(config: ServerConfig) -> AsyncIterator[tuple[Address, BrowserClient]]:
    """A server of its own process, all of its slots ready."""
    limits = ClientLimits(allocate=config.slots, release=config.slots, reply_seconds=_READY_SECONDS)
    async with (
        server_apart(config) as address,
        BrowserClient(address.url, token=address.token, limits=limits) as client,
    ):
        await _until(client, lambda pressure: pressure.slots.free == config.slots)
        yield address, client


async def _until(client: BrowserClient, is_so: Callable[[Pressure], bool]) -> None:
    async with asyncio.timeout(_READY_SECONDS):
        while not is_so(await client.pressure()):  # noqa: ASYNC110 - it is in another process
            await asyncio.sleep(_POLL_SECONDS)


def config_for(slots: int, pages: PageServer, *, freeze: bool = True, **changes: object) -> ServerConfig:
    """A server of so many slots that reaches the pages, and whose leases outlive the measurement."""
    config = ServerConfig(slots=slots, allocate_seconds=_READY_SECONDS, ttl_seconds=600.0)
    return config.model_copy(update={"browser": _browser_for(pages, freeze=freeze), **changes})


def _browser_for(pages: PageServer, *, freeze: bool = True) -> BrowserConfig:
    return BrowserConfig(freeze=freeze).allowing(pages.rule)


async def sessions_on(client: BrowserClient, count: int, url: str) -> list[Session]:
    """Open so many sessions and have each look at the page."""

    async def one() -> Session:
        session = await client.open(SessionOptions())
        await session.step(Navigate(url))
        return session

    return list(await asyncio.gather(*(one() for _ in range(count))))


# --- against the ceiling --------------------------------------------------------------------------------


class Ceiling(msgspec.Struct, frozen=True):
    """Rounds of the bare loop and of the server, in pairs, on one page."""

    page: str
    bare: list[Paced]
    server: list[Paced]

    @property
    def ratios(self) -> list[float]:
        """Server over bare loop, pair by pair."""
        return [ours.rate / bare.rate for ours, bare in zip(self.server, self.bare, strict=True)]


async def against_ceiling(plan: BenchPlan, executable: Path, pages: PageServer, say: Say) -> list[Ceiling]:
    """Steps per second of the server over those of the bare loop, on each page."""
    found = []
    async with AsyncExitStack() as stack:
        say(f"starting {plan.sessions} sessions and a bare browser with as many tabs")
        address, client = await stack.enter_async_context(measured_server(config_for(plan.sessions, pages)))
        bare = await stack.enter_async_context(bare_browser(executable, plan.sessions, _browser_for(pages)))
        sessions = await sessions_on(client, plan.sessions, pages.url("static"))
        server_cpu, bare_cpu = CpuTimes(address.pid), CpuTimes(bare.process.pid)
        for page in ("static", "busy"):
            bare.process.thaw()
            await asyncio.gather(*(tab.open(pages.url(page)) for tab in bare.tabs))
            bare.process.freeze()
            await asyncio.gather(*(session.step(Navigate(pages.url(page))) for session in sessions))
            rounds = Ceiling(page, [], [])
            for number in range(plan.rounds):
                say(f"{page} pages, round {number + 1} of {plan.rounds}")
                bare.process.thaw()
                bare_cpu.since_last()
                own = time.process_time()
                run = await paced([tab.step for tab in bare.tabs], plan.round_seconds)
                cpu = {**bare_cpu.since_last(), "client": time.process_time() - own}
                rounds.bare.append(msgspec.structs.replace(run, cpu=cpu))
                bare.process.freeze()
                server_cpu.since_last()
                own = time.process_time()
                run = await paced([stepper(session) for session in sessions], plan.round_seconds)
                cpu = {**server_cpu.since_last(), "client": time.process_time() - own}
                rounds.server.append(msgspec.structs.replace(run, cpu=cpu))
            found.append(rounds)
    return found


# --- frozen while the model thinks ----------------------------------------------------------------------


class Thinking(msgspec.Struct, frozen=True):
    """Busy pages and a model that thinks, with slots stopped between calls and not.

    Attributes:
        idle: processors that the browsers use while nobody steps: frozen, and not.
    """

    sessions: int
    think_seconds: float
    frozen: Paced
    unfrozen: Paced
    idle: tuple[float, float]

    @property
    def allowed(self) -> float:
        """Steps per second if a step took no time at all."""
        return self.sessions / self.think_seconds


async def thinking(plan: BenchPlan, pages: PageServer, say: Say) -> Thinking:
    """Step latency and throughput with many sessions on busy pages."""
    runs, idle = [], []
    calm = min(_CALM_SECONDS, plan.thinking_seconds)
    for freeze in (True, False):
        say(f"{plan.thinkers} busy sessions, {'frozen' if freeze else 'running'} while the model thinks")
        async with measured_server(config_for(plan.thinkers, pages, freeze=freeze)) as (address, client):
            visitors = [Visitor(client, pages.url("busy")) for _ in range(plan.thinkers)]
            await asyncio.gather(*(visitor.arrive() for visitor in visitors))
            await asyncio.sleep(calm)
            cpu, began = CpuTimes(address.pid), time.perf_counter()
            await asyncio.sleep(calm)
            used = cpu.since_last()
            idle.append((sum(used.values()) - used.get("server", 0.0)) / (time.perf_counter() - began))
            run = await paced([v.step for v in visitors], plan.thinking_seconds, plan.think_seconds)
            runs.append(msgspec.structs.replace(run, cpu=cpu.since_last()))
    return Thinking(plan.thinkers, plan.think_seconds, runs[0], runs[1], (idle[0], idle[1]))


# --- what each operation costs --------------------------------------------------------------------------


class Cost(msgspec.Struct, frozen=True):
    """One operation: CPU milliseconds per call by kind of process, and wall milliseconds, median."""

    operation: str
    cpu: dict[str, float]
    wall: float


async def costs(plan: BenchPlan, pages: PageServer, say: Say) -> list[Cost]:
    """CPU time per call, one operation type after the other, one call at a time."""
    say("CPU time per operation")
    found = []
    slots = 4
    async with measured_server(config_for(slots, pages)) as (address, client):
        sessions = await sessions_on(client, slots, pages.url("static"))
        meter = CpuTimes(address.pid)
        operations: dict[str, Callable[[Session, int], Awaitable[object]]] = {
            "navigate": lambda session, _: session.navigate(pages.url("static")),
            "execute": lambda session, number: session.execute(
                _CLICK if number % 2 else Scroll("down" if number % 4 else "up")
            ),
            "screenshot": lambda session, _: session.screenshot(),
            "metadata": lambda session, _: session.metadata(),
            "step": lambda session, number: stepper(session)(number),
        }
        for name, operation in operations.items():
            meter.since_last()
            walls = []
            for number in range(plan.calls):
                began = time.perf_counter()
                await operation(sessions[number % slots], number // slots)
                walls.append(time.perf_counter() - began)
            found.append(_cost(name, meter.since_last(), walls))
        for session in sessions:
            await session.close()
        found.extend(await _open_and_close(plan, client, meter, slots))
    return found


async def _open_and_close(plan: BenchPlan, client: BrowserClient, meter: CpuTimes, slots: int) -> list[Cost]:
    """Sessions opened and closed when a slot is free; the CPU time is that of both."""
    opened: list[float] = []
    closed: list[float] = []
    for _ in range(plan.calls):
        await _until(client, lambda pressure: pressure.slots.free == slots)
        if not opened:
            meter.since_last()
        began = time.perf_counter()
        session = await client.open(SessionOptions())
        opened.append(time.perf_counter() - began)
        began = time.perf_counter()
        await session.close()
        closed.append(time.perf_counter() - began)
    await _until(client, lambda pressure: pressure.slots.free == slots)
    cost = _cost("allocate + release", meter.since_last(), opened)
    return [
        cost,
        Cost("  allocate, p95", {}, quantile(opened, 0.95) * 1000),
        Cost("  release", {}, quantile(closed, 0.5) * 1000),
    ]


def _cost(name: str, seconds: dict[str, float], walls: list[float]) -> Cost:
    cpu = {kind: used * 1000 / len(walls) for kind, used in seconds.items() if used > 0}
    return Cost(name, cpu, quantile(walls, 0.5) * 1000)


# --- a burst of navigations -----------------------------------------------------------------------------


class Burst(msgspec.Struct, frozen=True):
    """How long screenshots took that came just after a burst of navigations, by order of admission."""

    navigations: int
    seconds: dict[str, list[float]]


async def burst(plan: BenchPlan, pages: PageServer, say: Say) -> Burst:
    """Screenshots behind a burst of navigations, with a queue per operation and with one for all."""
    seconds: dict[str, list[float]] = {}

    lookers = max(2, plan.burst // 6)

    def is_under_way(now: Pressure) -> bool:
        load = now.operations["navigate"]
        begun = load.done + load.running + load.waiting - plan.burst - lookers  # each was led there first
        return begun >= plan.burst // 2

    for order in ("per_operation", "global"):
        say(f"screenshots behind {plan.burst} navigations, {order.replace('_', ' ')} queue")
        admission = Admission(order=order)
        async with measured_server(config_for(plan.burst + lookers, pages, admission=admission)) as (
            _,
            client,
        ):
            sessions = await sessions_on(client, plan.burst + lookers, pages.url("static"))
            going, looking = sessions[: plan.burst], sessions[plan.burst :]
            waits: list[float] = []

            async def look(session: Session, waits: list[float] = waits) -> None:
                began = time.perf_counter()
                await session.screenshot()
                waits.append(time.perf_counter() - began)

            async with asyncio.TaskGroup() as group:
                for session in going:
                    group.create_task(session.step(Navigate(pages.url("static"))))
                await _until(client, is_under_way)
                for session in looking:
                    group.create_task(look(session))
            seconds[order] = waits
    return Burst(plan.burst, seconds)


# --- how dense ------------------------------------------------------------------------------------------


class Density(msgspec.Struct, frozen=True):
    """Many live sessions on one machine.

    Attributes:
        bytes: PSS of all browsers, by number of sessions that show a page.
    """

    sessions: int
    ready_seconds: float
    bytes: dict[int, int]
    steps: Paced

    @property
    def marginal(self) -> float:
        """Bytes per further session."""
        (few, at_few), (many, at_many) = min(self.bytes.items()), max(self.bytes.items())
        return (at_many - at_few) / (many - few)


async def density(plan: BenchPlan, pages: PageServer, say: Say) -> Density:
    """All sessions live at once, on static and busy pages in turn, each stepped several times."""
    sizes: dict[int, int] = {}
    began = time.perf_counter()
    few = max(1, plan.dense // 8)
    for slots in (few, plan.dense):
        say(f"starting {slots} sessions")
        began = time.perf_counter()
        async with measured_server(config_for(slots, pages)) as (address, client):
            ready = time.perf_counter() - began
            sessions = await sessions_on(client, slots, pages.url("static"))
            await asyncio.gather(*(stepper(session)(0) for session in sessions))
            sizes[slots] = await asyncio.to_thread(browser_bytes, address.pid)
            if slots == few:
                continue
            say(f"{slots} sessions step, half of them on busy pages")
            await asyncio.gather(*(s.step(Navigate(pages.url("busy"))) for s in sessions[::2]))

            steps = await paced([stepper(s) for s in sessions], plan.thinking_seconds, plan.think_seconds)
    return Density(plan.dense, ready, sizes, steps)


# --- all of it ------------------------------------------------------------------------------------------


class ServerFigures(msgspec.Struct, frozen=True, omit_defaults=True):
    """What one run found; a part that was left out is ``None``."""

    plan: BenchPlan
    browser: str
    processors: int
    ceiling: list[Ceiling] | None = None
    costs: list[Cost] | None = None
    thinking: Thinking | None = None
    burst: Burst | None = None
    density: Density | None = None


PARTS = ("ceiling", "costs", "thinking", "burst", "density")


async def measure(
    plan: BenchPlan, parts: Sequence[str], browser: Path | None, say: Say
) -> AsyncIterator[ServerFigures]:
    """Measure these parts, one after the other. After each comes all that is known by then."""
    found = await asyncio.to_thread(find_browser, browser)
    figures = ServerFigures(plan, found.version, len(os.sched_getaffinity(0)))
    async with serving_pages() as pages:
        runs: dict[str, Callable[[], Awaitable[object]]] = {
            "ceiling": lambda: against_ceiling(plan, found.path, pages, say),
            "costs": lambda: costs(plan, pages, say),
            "thinking": lambda: thinking(plan, pages, say),
            "burst": lambda: burst(plan, pages, say),
            "density": lambda: density(plan, pages, say),
        }
        for part in PARTS:
            if part in parts:
                figures = msgspec.structs.replace(figures, **{part: await runs[part]()})
                yield figures
