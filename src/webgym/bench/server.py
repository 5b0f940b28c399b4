"""``webgym bench server``: the browser server against Chromium's own ceiling, frozen and not, and how dense.

Everything is measured in one run and reported as ratios; rounds of what is compared take turns.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from pathlib import Path
from typing import get_args

import msgspec

from webgym.bench.ceiling import Ceiling, against_ceiling
from webgym.bench.pages import PageServer, serving_pages
from webgym.bench.stepping import (
    BenchPlan,
    Paced,
    Say,
    Visitor,
    config_for,
    deed,
    measured_server,
    paced,
    quantile,
    sessions_on,
    stepper,
    until,
)
from webgym.bench.usage import CpuTimes, browser_bytes
from webgym.browser.find import find_browser
from webgym.core.action import Navigate
from webgym.server.client import BrowserClient, Session
from webgym.server.config import Admission, Queues
from webgym.server.messages import Pressure, SessionOptions

_CALM_SECONDS = 3.0
"""Between the last call and the look at idle processors, and length of that look, at most."""


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
            "execute": lambda session, number: session.execute(deed(number)),
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
        await until(client, lambda pressure: pressure.slots.free == slots)
        if not opened:
            meter.since_last()
        began = time.perf_counter()
        session = await client.open(SessionOptions())
        opened.append(time.perf_counter() - began)
        began = time.perf_counter()
        await session.close()
        closed.append(time.perf_counter() - began)
    await until(client, lambda pressure: pressure.slots.free == slots)
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

    for queues in get_args(Queues):
        say(f"screenshots behind {plan.burst} navigations, {queues.replace('_', ' ')} queue")
        admission = Admission(queues=queues)
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
                await until(client, is_under_way)
                for session in looking:
                    group.create_task(look(session))
            seconds[queues] = waits
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
