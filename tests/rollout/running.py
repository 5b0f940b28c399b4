"""Runs against stand-ins behind real HTTP, for tests of the collector."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web
from benchmarks.stand_ins import TOKEN, StandInBrowsers, StandInModel, serving_app
from pydantic import SecretStr
from tests.rollout.test_summary import task

from webgym.agent.config import AgentConfig
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Trajectory
from webgym.judge.config import JudgeChoice
from webgym.llm.config import ChatConfig, Retry
from webgym.offline.config import SitesConfig
from webgym.results.summary import Summary
from webgym.rollout.config import CollectorConfig
from webgym.rollout.progress import Progress
from webgym.rollout.sessions import Places
from webgym.run.collect import collect, resume
from webgym.run.config import PolicyChoice, RunConfig, Secrets, ServerChoice, TaskChoice
from webgym.store.runs import RunReader
from webgym.tasks.formats import write_tasks

SECONDS = 60
"""No wait of a test takes so long."""


async def until(holds: Callable[[], object]) -> None:
    async with asyncio.timeout(SECONDS):
        while not holds():
            await asyncio.sleep(0.005)


class Judge:
    """Behind HTTP; gives its verdicts when it is let."""

    def __init__(self) -> None:
        self.lets = asyncio.Event()
        self.lets.set()
        self.asked = 0

    def app(self) -> web.Application:
        app = web.Application()
        app.add_routes([web.get("/", self._verdict)])
        return app

    async def _verdict(self, _: web.Request) -> web.Response:
        self.asked += 1
        await self.lets.wait()
        return web.Response()


class Model(StandInModel):
    """Holds the requests after the first so many, until it may reply to more.

    Attributes:
        may: the number of requests that it may reply to.
        held: the number of requests that it holds.
    """

    def __init__(self, steps: int = 3) -> None:
        super().__init__(steps)
        self.may = math.inf
        self.held = self._begun = 0

    async def _reply(self, request: web.Request) -> web.Response:
        self.held += 1
        try:
            while self._begun >= self.may:
                await asyncio.sleep(0.005)
        finally:
            self.held -= 1
        self._begun += 1
        return await super()._reply(request)


class World:
    """Servers that stand in for everything that a collector talks to; each may be stopped and started."""

    def __init__(self) -> None:
        self.browsers = StandInBrowsers()
        self.model = Model()
        self.judge = Judge()
        self.ports: dict[str, int] = {}
        self._running: dict[str, AsyncExitStack] = {}

    async def start(self, name: str) -> None:
        stack = self._running[name] = AsyncExitStack()
        app = getattr(self, name).app()
        self.ports[name] = await stack.enter_async_context(serving_app(app, self.ports.get(name, 0)))

    async def stop(self, name: str) -> None:
        await self._running.pop(name).aclose()

    async def restart(self, name: str) -> None:
        await self.stop(name)
        await self.start(name)

    async def stop_all(self) -> None:
        for name in list(self._running):
            await self.stop(name)

    def url(self, name: str) -> str:
        return f"http://127.0.0.1:{self.ports[name]}"

    def config(
        self, path: Path, count: int, collector: dict[str, Any] | None = None, **more: Any
    ) -> RunConfig:
        """A run of so many tasks."""
        file = path / "tasks.jsonl"
        if not file.exists():
            write_tasks(file, [task(f"t{number}", 1 + number % 9) for number in range(count)])
        retry = Retry(tries=20, first_seconds=0.05, longest_seconds=0.2)
        chat = ChatConfig(base_url=f"{self.url('model')}/v1", model="m", retry=retry)
        return RunConfig(
            tasks=TaskChoice(file=file, split="all", count="all"),
            policy=PolicyChoice(chat=chat, check=False),
            agent=AgentConfig(image_max_side=None),
            judge=JudgeChoice(name="tests.rollout.stand_in_judge:judge"),
            server=ServerChoice(url=self.url("browsers")),
            collector=CollectorConfig(
                **{"sessions": 4, "straggler_share": 1.0, "server_retry_seconds": 0.05} | (collector or {})
            ),
            **more,
        )


@asynccontextmanager
async def a_world() -> AsyncIterator[World]:
    world = World()
    try:
        for name in ("browsers", "model", "judge"):
            await world.start(name)
        yield world
    finally:
        world.judge.lets.set()
        await world.stop_all()


class Run:
    """A run in the background, and its progress."""

    def __init__(self) -> None:
        self.progress = Progress(total=0)
        self.finishing = asyncio.Event()
        self.task: asyncio.Task[Summary]

    @asynccontextmanager
    async def _show(self, progress: Progress) -> AsyncIterator[None]:
        self.progress = progress
        yield

    def start(
        self,
        config: RunConfig | None,
        out: Path,
        tell: Callable[[str], None] | None = None,
        places: Places | None = None,
    ) -> Run:
        """Collect, or continue without a config."""
        given: dict[str, Any] = {
            "secrets": Secrets(server_token=SecretStr(TOKEN)),
            "show": self._show,
            "finishing": self.finishing,
            "tell": tell,
            "places": places,
        }
        job = collect(config, out, **given) if config else resume(out, **given)
        self.task = asyncio.create_task(job)
        return self

    async def end(self) -> Summary:
        async with asyncio.timeout(SECONDS):
            return await self.task

    async def stop(self) -> None:
        """Cancel it, as an interrupt does."""
        self.task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await self.end()


HALF = 24
"""Replies: of 4 attempts at a time, 6 to 8 have all theirs, whatever the pace."""


async def until_half(run: Run, world: World) -> None:
    """Until all that got their replies are recorded, and four attempts wait for the model."""
    await until(
        lambda: world.model.held == 4 and run.progress.done >= 6 and not run.progress.states["judging"]
    )


async def half_of(world: World, config: RunConfig | None, out: Path) -> Run:
    """A run of which half has ended, while the model holds the rest."""
    world.model.may = HALF
    run = Run().start(config, out)
    await until_half(run, world)
    return run


def books(out: Path) -> list[Trajectory]:
    """A run's trajectories, after it was checked that they add up and that nothing is there twice."""
    reader = RunReader(out)
    trajectories = list(reader.trajectories())
    assert len({each.episode.attempt_id for each in trajectories}) == len(trajectories)
    counts = Counter(each.outcome for each in trajectories)
    assert reader.summary is not None
    assert reader.summary["outcomes"] == {outcome.value: counts[outcome] for outcome in Outcome}
    ended = Counter(
        (each.episode.task_id, each.episode.sample) for each in trajectories if not each.outcome.is_retried
    )
    assert set(ended.values()) <= {1}, "a sample came to an end of its own twice"
    return trajectories


def outcomes(out: Path) -> dict[str, int]:
    """How many attempts of a run ended so."""
    return dict(Counter(each.outcome.value for each in books(out)))


def small_run(count: int, **more: Any) -> RunConfig:
    """A run of so many tasks on small websites, without browsers."""
    sites = SitesConfig(collection="small", per_family=1)
    return RunConfig(server=ServerChoice(static=True), sites=sites, tasks=TaskChoice(count=count), **more)
