"""The server against Chromium's own ceiling, and what of the difference its own browsers make.

Three contenders take turns on the same pages: a bare loop over tabs of one browser, the same loop with a
browser for each tab, and the server. The first shares everything, and one crash ends all of it; the second
isolates as the server does, and does nothing else; so the step from the first to the second is the price of
isolation, and the step to the third that of all that the server adds.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack
from pathlib import Path

import msgspec

from webgym.bench.bare import BareBrowsers, bare_browsers
from webgym.bench.pages import PageServer
from webgym.bench.stepping import (
    BenchPlan,
    Paced,
    Say,
    Stepper,
    browser_for,
    config_for,
    measured_server,
    paced,
    sessions_on,
    stepper,
)
from webgym.bench.usage import CpuTimes
from webgym.core.action import Navigate
from webgym.server.client import Session

SHARED, APART, SERVER = "bare loop, one browser", "bare loop, a browser each", "server"


class Ceiling(msgspec.Struct, frozen=True):
    """Rounds on one page, by contender, in turn."""

    page: str
    rounds: dict[str, list[Paced]]

    def ratios(self, name: str) -> list[float]:
        """Server over this contender, round by round; of rounds in which the contender made a step."""
        pairs = zip(self.rounds[SERVER], self.rounds[name], strict=True)
        return [ours.rate / theirs.rate for ours, theirs in pairs if theirs.rate]


class _Contender:
    """What steps, and how its CPU time is read."""

    def __init__(self, name: str, steppers: Sequence[Stepper], meters: Sequence[CpuTimes]) -> None:
        self.name = name
        self._steppers = steppers
        self._meters = meters

    async def round(self, seconds: float) -> Paced:
        self._used()
        own = time.process_time()
        run = await paced(self._steppers, seconds)
        cpu = {**self._used(), "client": time.process_time() - own}
        return msgspec.structs.replace(run, cpu=cpu)

    def _used(self) -> dict[str, float]:
        used: dict[str, float] = {}
        for meter in self._meters:
            for kind, seconds in meter.since_last().items():
                used[kind] = used.get(kind, 0.0) + seconds
        return used


class _Bare(_Contender):
    """A bare loop: its browsers are stopped while others are measured."""

    def __init__(self, name: str, bare: BareBrowsers) -> None:
        super().__init__(name, [tab.step for tab in bare.tabs], [CpuTimes(pid) for pid in bare.pids])
        self._bare = bare

    async def open(self, url: str) -> None:
        with self._bare.awake():
            await asyncio.gather(*(tab.open(url) for tab in self._bare.tabs))

    async def round(self, seconds: float) -> Paced:
        with self._bare.awake():
            return await super().round(seconds)


class _Served(_Contender):
    """Sessions of a server."""

    def __init__(self, sessions: Sequence[Session], pid: int) -> None:
        super().__init__(SERVER, [stepper(session) for session in sessions], [CpuTimes(pid)])
        self._sessions = sessions

    async def open(self, url: str) -> None:
        await asyncio.gather(*(session.step(Navigate(url)) for session in self._sessions))


async def against_ceiling(plan: BenchPlan, executable: Path, pages: PageServer, say: Say) -> list[Ceiling]:
    """Steps per second of the server and of the bare loops, on each page."""
    found = []
    config = browser_for(pages)
    async with AsyncExitStack() as stack:
        say(f"starting {plan.sessions} sessions, and bare browsers with as many tabs")
        address, client = await stack.enter_async_context(measured_server(config_for(plan.sessions, pages)))
        sessions = await sessions_on(client, plan.sessions, pages.url("static"))
        shared = await stack.enter_async_context(bare_browsers(executable, 1, plan.sessions, config))
        apart = await stack.enter_async_context(bare_browsers(executable, plan.sessions, 1, config))
        contenders = (_Bare(SHARED, shared), _Bare(APART, apart), _Served(sessions, address.pid))
        for page in ("static", "busy"):
            for contender in contenders:
                await contender.open(pages.url(page))
            rounds: dict[str, list[Paced]] = {contender.name: [] for contender in contenders}
            for number in range(plan.rounds):
                say(f"{page} pages, round {number + 1} of {plan.rounds}")
                for contender in contenders:
                    rounds[contender.name].append(await contender.round(plan.round_seconds))
            found.append(Ceiling(page, rounds))
    return found
