"""Shared by the parts of ``webgym bench server``: timed steps, texts in tables, servers with
sessions, usage of processors and memory."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress

import msgspec
import psutil

from webgym.bench.pages import PageServer
from webgym.bench.server_process import ServerAddress, server_process
from webgym.browser.config import BrowserConfig
from webgym.core.action import BrowserAction, LeftClick, Navigate, Scroll, Target
from webgym.core.errors import WebGymError
from webgym.core.tables import DASH
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ClientLimits, ServerConfig
from webgym.server.messages import Pressure, SessionOptions

MEGABYTE = 1024 * 1024

Report = Callable[[str], None]
StepFunction = Callable[[int], Awaitable[object]]

_CLICK = LeftClick(Target(coordinate=(31, 521)))
_READY_SECONDS = 900.0
_OPEN_SECONDS = 60.0
_POLL_SECONDS = 0.01


class BenchPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The size of the benchmark.

    Attributes:
        sessions: number of sessions of the part ``ceiling``.
        rounds: number of rounds of each contender in the part ``ceiling``.
        round_seconds: duration of a round.
        thinkers: number of sessions of the part ``thinking``.
        think_seconds: pause between a screenshot and the next action.
        thinking_seconds: duration of the parts ``density`` and ``thinking``, of the latter twice.
        dense: number of sessions of the part ``density``.
        calls: number of calls per operation in the part ``costs``.
        burst: number of navigations in the part ``burst``.
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


class StepTimes(msgspec.Struct, frozen=True):
    """The steps of one measurement.

    Attributes:
        seconds: its duration.
        latencies: seconds per step, of the steps that succeeded within the duration.
        steps: number of all steps.
        failures: number of steps that failed.
        cpu: CPU seconds of all steps, by kind of process.
    """

    seconds: float
    latencies: list[float]
    steps: int
    failures: int = 0
    cpu: dict[str, float] = {}

    @property
    def rate(self) -> float:
        """Successful steps per second."""
        return len(self.latencies) / self.seconds


def quantile(values: Sequence[float], share: float) -> float:
    """The value below which a share of the values lies; NaN if there are none."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else math.nan


# --- texts in tables --------------------------------------------------------------------------------------

KINDS = {name: name for name in ("client", "server", "browser", "renderer")} | {"gpu-process": "gpu"}
"""Kinds of processes with a column; the others use little, and are included in the sum only."""


def spread(values: Sequence[float], digits: int = 1) -> str:
    """The median and the range."""
    if not values:  # rounds so short that not a step ended
        return DASH
    middle = quantile(values, 0.5)
    return f"{middle:.{digits}f} ({min(values):.{digits}f}-{max(values):.{digits}f})"


def milliseconds(seconds: Sequence[float], *shares: float) -> str:
    """Quantiles in whole milliseconds."""
    found = (quantile(seconds, share) for share in shares)
    return " / ".join(DASH if math.isnan(value) else f"{value * 1000:.0f}" for value in found)


def by_kind(cpu: Mapping[str, float]) -> list[str]:
    """Milliseconds of every kind of :data:`KINDS`, and of all processes."""
    return [f"{cpu.get(kind, 0.0):.1f}" for kind in KINDS] + [f"{sum(cpu.values()):.1f}"]


# --- steps ------------------------------------------------------------------------------------------------


async def run_steps(step_functions: Sequence[StepFunction], seconds: float, think: float = 0.0) -> StepTimes:
    """Run several loops of steps in parallel, and time the steps.

    Args:
        step_functions: one per loop; called with the number of the step.
        seconds: the duration of the measurement, which starts when all loops have started. Steps count if
            they end within it.
        think: pause between the steps of a loop, seconds. With a pause, steps that are running at the end are
            cancelled; without one, they are awaited.
    """
    start = time.perf_counter()
    latencies: list[float] = []
    steps = failures = 0

    async def loop(index: int, step: StepFunction) -> None:
        nonlocal steps, failures
        # spread the loops evenly, as the replies of models do not arrive in lock step
        await asyncio.sleep(think * index / len(step_functions))
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
            for index, step in enumerate(step_functions):
                group.create_task(loop(index, step))
    return StepTimes(seconds, latencies, steps, failures)


def click_or_scroll(number: int) -> BrowserAction:
    """Click or scroll in turn, as :meth:`webgym.bench.server.BareTab.step` does."""
    return _CLICK if number % 2 else Scroll("down" if number % 4 else "up")


def step_function(session: Session) -> StepFunction:
    """A function that makes steps in a session."""
    return lambda number: session.step(click_or_scroll(number))


class Visitor:
    """A client that makes steps on a page, and opens a new session when one is lost."""

    def __init__(self, client: BrowserClient, url: str) -> None:
        self._client = client
        self._url = url
        self._session: Session | None = None

    async def open(self) -> None:
        """Open a session on the page, with retries. After a time limit, this is left to the first step."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_OPEN_SECONDS):
                while self._session is None:
                    with suppress(WebGymError):
                        await self._enter()

    async def step(self, number: int) -> None:
        """Make a step.

        Raises:
            WebGymError: the step failed; the next one opens a new session.
        """
        session = self._session or await self._enter()
        try:
            await session.step(click_or_scroll(number))
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
async def measured_server(config: ServerConfig) -> AsyncIterator[tuple[ServerAddress, BrowserClient]]:
    """Run a server in a separate process until the block ends.

    Yields:
        Its address and a client, when all slots are ready.
    """
    limits = ClientLimits(
        allocate=config.slots, release=config.slots, reply_seconds=_READY_SECONDS, wait_seconds=_READY_SECONDS
    )
    async with (
        server_process(config) as address,
        BrowserClient(address.url, token=address.token, limits=limits) as client,
    ):
        await wait_until(client, lambda pressure: pressure.slots.free == config.slots)
        yield address, client


async def wait_until(client: BrowserClient, condition: Callable[[Pressure], bool]) -> None:
    """Wait until a condition on a server's load holds.

    Raises:
        TimeoutError: it does not hold in time.
    """
    async with asyncio.timeout(_READY_SECONDS):
        while not condition(await client.pressure()):  # noqa: ASYNC110 - the server is another process
            await asyncio.sleep(_POLL_SECONDS)


def config_for(slots: int, pages: PageServer, *, freeze: bool = True, **changes: object) -> ServerConfig:
    """Settings of a server whose browsers reach the pages, and whose leases outlast the measurement.

    Args:
        slots: their number.
        pages: to be reached.
        freeze: whether slots are frozen between calls.
        changes: further fields.
    """
    config = ServerConfig(slots=slots, allocate_seconds=_READY_SECONDS, ttl_seconds=600.0)
    return config.model_copy(update={"browser": browser_for(pages, freeze=freeze), **changes})


def browser_for(pages: PageServer, *, freeze: bool = True) -> BrowserConfig:
    """Settings of browsers that reach the pages."""
    return BrowserConfig(freeze=freeze).allowing(pages.rule)


async def sessions_on(client: BrowserClient, count: int, url: str) -> list[Session]:
    """Open sessions, each on the page at ``url``."""

    async def open_session() -> Session:
        session = await client.open(SessionOptions())
        await session.step(Navigate(url))
        return session

    return list(await asyncio.gather(*(open_session() for _ in range(count))))


# --- CPU time by kind of process, and memory ------------------------------------------------------------


def _kind(process: psutil.Process, root: int) -> str:
    if process.pid == root:
        return "server"
    types = [part for part in process.cmdline() if part.startswith("--type=")]
    return types[0].partition("=")[2] if types else "browser"


class CpuTimes:
    """CPU seconds of a process and its descendants, by kind: ``server``, ``browser``, ``renderer``, …

    A process that starts and ends between two readings is missed.

    Args:
        root: process id of the ``server``.
    """

    def __init__(self, root: int) -> None:
        self._root = root
        self._seen: dict[tuple[int, float], tuple[str, float]] = {}
        self._seen = self._read()

    def _read(self) -> dict[tuple[int, float], tuple[str, float]]:
        top = psutil.Process(self._root)
        now = {}
        for process in (top, *top.children(recursive=True)):
            try:
                key = (process.pid, process.create_time())
                kind = self._seen[key][0] if key in self._seen else _kind(process, self._root)
                spent = process.cpu_times()
                now[key] = (kind, spent.user + spent.system)
            except psutil.Error:
                continue
        return now

    def since_last(self) -> dict[str, float]:
        """CPU seconds by kind since the last call, or since the object was made."""
        now: dict[tuple[int, float], tuple[str, float]] = self._read()
        used: dict[str, float] = {}
        for key, (kind, seconds) in now.items():
            used[kind] = used.get(kind, 0.0) + seconds - self._seen.get(key, (kind, 0.0))[1]
        self._seen = now
        return used


def browser_bytes(root: int) -> int:
    """The proportional set size (PSS) of all descendants of a server, bytes: shared memory is divided among
    its users."""
    total = 0
    for process in psutil.Process(root).children(recursive=True):
        try:
            total += process.memory_full_info().pss
        except psutil.Error:
            continue
    return total
