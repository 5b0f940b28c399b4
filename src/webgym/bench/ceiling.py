"""The browser server compared with Chromium alone.

Three contenders take turns on the same pages: a bare loop over the tabs of one browser, the same loop with a
browser per tab, and the server. The first has no isolation, so that one crash ends all tabs; the second has
the isolation of the server and nothing else. The difference between the first two is the cost of isolation,
that between the last two the cost of everything else that the server does.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack
from pathlib import Path

import msgspec

from webgym.bench.bare_browsers import BareBrowsers, bare_browsers
from webgym.bench.pages import PageServer
from webgym.bench.stepping import (
    BenchPlan,
    Report,
    StepFunction,
    StepTimes,
    browser_for,
    config_for,
    measured_server,
    run_steps,
    sessions_on,
    step_function,
)
from webgym.bench.usage import CpuTimes
from webgym.core.action import Navigate
from webgym.server.client import Session

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
) -> list[Ceiling]:
    """Measure the server and the bare loops, in turn, on each page."""
    results = []
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
                for contender in contenders:
                    rounds[contender.name].append(await contender.round(plan.round_seconds))
            results.append(Ceiling(page, rounds))
    return results
