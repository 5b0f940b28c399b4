"""What the parts of ``webgym bench server`` have in common: steps by the clock, and servers to step on."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress

import msgspec

from webgym.bench.apart import Address, server_apart
from webgym.bench.pages import PageServer
from webgym.browser.config import BrowserConfig
from webgym.core.action import BrowserAction, LeftClick, Navigate, Scroll, Target
from webgym.core.errors import WebGymError
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ClientLimits, ServerConfig
from webgym.server.messages import Pressure, SessionOptions

Say = Callable[[str], None]
Stepper = Callable[[int], Awaitable[object]]

_CLICK = LeftClick(Target(coordinate=(31, 521)))
_READY_SECONDS = 900.0
_ARRIVAL_SECONDS = 60.0
_POLL_SECONDS = 0.01


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


async def paced(steppers: Sequence[Stepper], seconds: float, think: float = 0.0) -> Paced:
    """Let all step at once, each one step after the other with a pause between, for so long.

    What ends within ``seconds`` counts; they begin when all have begun. Those that think between their steps
    are not waited for when time is up.
    """
    start = time.perf_counter()
    latencies: list[float] = []
    steps = failures = 0

    async def loop(index: int, step: Stepper) -> None:
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


def stepper(session: Session) -> Stepper:
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
        await until(client, lambda pressure: pressure.slots.free == config.slots)
        yield address, client


async def until(client: BrowserClient, is_so: Callable[[Pressure], bool]) -> None:
    """Wait for a server's load to be like this."""
    async with asyncio.timeout(_READY_SECONDS):
        while not is_so(await client.pressure()):  # noqa: ASYNC110 - it is in another process
            await asyncio.sleep(_POLL_SECONDS)


def config_for(slots: int, pages: PageServer, *, freeze: bool = True, **changes: object) -> ServerConfig:
    """A server of so many slots that reaches the pages, and whose leases outlive the measurement."""
    config = ServerConfig(slots=slots, allocate_seconds=_READY_SECONDS, ttl_seconds=600.0)
    return config.model_copy(update={"browser": browser_for(pages, freeze=freeze), **changes})


def browser_for(pages: PageServer, *, freeze: bool = True) -> BrowserConfig:
    """Browsers that reach the pages."""
    return BrowserConfig(freeze=freeze).allowing(pages.rule)


async def sessions_on(client: BrowserClient, count: int, url: str) -> list[Session]:
    """Open so many sessions and have each look at the page."""

    async def one() -> Session:
        session = await client.open(SessionOptions())
        await session.step(Navigate(url))
        return session

    return list(await asyncio.gather(*(one() for _ in range(count))))
