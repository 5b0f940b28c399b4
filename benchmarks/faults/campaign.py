"""Run a campaign: collector, server and offline web in processes of their own, and faults that end them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import signal
import socket
import sys
from asyncio.subprocess import DEVNULL, Process
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import httpx
import msgspec
from benchmarks.faults.collector import FOLDER
from tests.soak.leaks import processes_of

from webgym.bench.server_process import start_server, stop_server
from webgym.browser.config import BrowserConfig
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.judge.config import JudgeChoice
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import CollectorConfig
from webgym.run.config import SITES_TOKEN, PolicyChoice, RunConfig, ServerChoice, TaskChoice
from webgym.server.config import GatewayConfig, ServerConfig
from webgym.store.runs import RunReader
from webgym.tasks.formats import write_tasks

KINDS: Final = ("renderer", "browser", "worker", "server", "collector", "web", "policy", "judge")
_TOKEN: Final = "the-token-of-the-campaign"
_AWAY_SECONDS: Final = (0.0, 1.5)
"""How long a server, an offline web or an endpoint is away."""
_START_SECONDS: Final = 60.0
_MOST_STARTS: Final = 200
"""Starts of the collector after which a run is given up."""


class Campaign(msgspec.Struct, frozen=True, kw_only=True):
    """The size of a campaign.

    Attributes:
        seed: of tasks, policy and faults. What a fault hits depends on timing.
        kinds: which faults; empty for none.
        per_minute: mean number of faults per minute.
        seconds: no fault is caused after this time.
        sessions: parallel attempts.
        per_family: number of websites per family.
    """

    seed: int
    kinds: tuple[str, ...] = KINDS
    per_minute: float = 12.0
    seconds: float = 3600.0
    sessions: int = 2
    per_family: int = 3


class Ran(msgspec.Struct, frozen=True):
    """What came of a run.

    Attributes:
        rewards: the reward of every sample that has one, by its task and number.
        outcomes: number of attempts by outcome.
        faults: number of faults by kind.
    """

    rewards: dict[tuple[str, int], float]
    outcomes: dict[str, int]
    faults: dict[str, int]


class _World:
    """The processes of one run, each of which can be killed.

    Attributes:
        faults: number of faults by kind so far.
    """

    def __init__(self, campaign: Campaign, tasks: Sequence[Task], folder: Path) -> None:
        self._campaign = campaign
        self._folder = folder
        self._run = folder / "run"
        self._random = random.Random(campaign.seed)
        self._web: Process | None = None
        self._server: Process | None = None
        self._collector: Process | None = None
        self._sites_port, self._server_port = _free_port(), _free_port()
        self.faults: Counter[str] = Counter()
        folder.mkdir(parents=True)
        write_tasks(folder / "tasks.jsonl", tasks)
        (folder / "config.json").write_text(self._config().model_dump_json())

    def _config(self) -> RunConfig:
        return RunConfig(
            seed=self._campaign.seed,
            retries=50,
            tasks=TaskChoice(file=self._folder / "tasks.jsonl", split="all", count="all"),
            policy=PolicyChoice(check=False),
            judge=JudgeChoice(name="benchmarks.faults.collector:judge"),
            server=ServerChoice(
                url=f"http://127.0.0.1:{self._server_port}", sites_url=f"http://127.0.0.1:{self._sites_port}"
            ),
            sites=SitesConfig(per_family=self._campaign.per_family, latency=0),
            collector=CollectorConfig(
                sessions=self._campaign.sessions,
                straggler_share=1.0,
                server_retry_seconds=0.1,
                give_up_after=1000,
            ),
        )

    async def _python(self, *command: str) -> Process:
        environment = os.environ | {
            SITES_TOKEN: _TOKEN,
            "WEBGYM_TOKEN": _TOKEN,
            FOLDER: str(self._folder),
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        }
        with (self._folder / "log.txt").open("ab") as log:
            return await asyncio.create_subprocess_exec(
                sys.executable, *command, env=environment, stdin=DEVNULL, stdout=log, stderr=log
            )

    async def start(self) -> None:
        """Start the offline web and the server; :meth:`collect` starts the collector."""
        await self._start_web()
        await self._start_server()

    async def stop(self) -> None:
        """End everything."""
        for process in (self._collector, self._web):
            if process is not None:
                await _kill(process)
        if self._server is not None:
            await stop_server(self._server)

    async def _start_web(self) -> None:
        per_family = str(self._campaign.per_family)
        self._web = await self._python(
            *("-m", "webgym", "sites", "serve", "--port", str(self._sites_port)),
            *("--latency", "0", "--per-family", per_family),
        )
        headers = {"authorization": f"Bearer {_TOKEN}"}
        async with asyncio.timeout(_START_SECONDS), httpx.AsyncClient(trust_env=False) as http:
            while True:
                with contextlib.suppress(httpx.HTTPError):
                    await http.get(f"http://127.0.0.1:{self._sites_port}/websites", headers=headers)
                    return
                await asyncio.sleep(0.05)

    async def _start_server(self) -> None:
        web = OfflineWeb(self._config().sites.seed, per_family=self._campaign.per_family)
        browser = BrowserConfig().allowing(*web.allowed_hosts(f"127.0.0.1:{self._sites_port}"))
        config = ServerConfig(
            slots=self._campaign.sessions,
            port=self._server_port,
            token=_TOKEN,
            relaunch_seconds=(0.2, 2.0),
            browser=browser,
        )
        fleet = GatewayConfig(workers=min(2, self._campaign.sessions), restart_seconds=(0.2, 2.0))
        log = os.open(self._folder / "server.txt", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        try:
            self._server, _ = await start_server(config, fleet, log)
        finally:
            os.close(log)

    async def collect(self) -> None:
        """Collect the whole run, however often the collector is killed or gives up."""
        for _ in range(_MOST_STARTS):
            self._collector = await self._python("-m", "benchmarks.faults.collector", str(self._run))
            if await self._collector.wait() == 0:
                return
            await asyncio.sleep(self._random.uniform(*_AWAY_SECONDS))
        raise RuntimeError(f"the collector ended {_MOST_STARTS} times; see {self._folder / 'log.txt'}")

    def result(self) -> Ran:
        """The rewards so far."""
        recorded = list(RunReader(self._run).trajectories())
        return Ran(
            {
                (each.episode.task_id, each.episode.sample): reward
                for each in recorded
                if (reward := each.outcome.reward) is not None
            },
            dict(Counter(each.outcome.value for each in recorded)),
            dict(self.faults),
        )

    # --- faults -----------------------------------------------------------------------------------------

    async def cause_faults(self) -> None:
        """Cause faults at the campaign's rate. Every kind comes once before any comes twice."""
        causes: dict[str, Callable[[], Awaitable[bool]]] = {
            "renderer": lambda: self._kill_one("renderer"),
            "browser": lambda: self._kill_one("browser"),
            "worker": lambda: self._kill_one("worker"),
            "server": self._restart_server,
            "collector": self._kill_collector,
            "web": self._restart_web,
            "policy": lambda: self._take_away("policy"),
            "judge": lambda: self._take_away("judge"),
        }
        loop = asyncio.get_running_loop()
        end, first = loop.time() + self._campaign.seconds, list(self._campaign.kinds)
        self._random.shuffle(first)
        while first or self._campaign.kinds:
            await asyncio.sleep(self._random.expovariate(self._campaign.per_minute / 60))
            if loop.time() >= end:
                return
            kind = first.pop() if first else self._random.choice(self._campaign.kinds)
            if await causes[kind]():
                self.faults[kind] += 1

    async def _kill_one(self, kind: str) -> bool:
        assert self._server is not None
        processes = await asyncio.to_thread(processes_of, self._server.pid)
        if not (victims := [process for process in processes if process.kind == kind]):
            return False
        victim = self._random.choice(victims)
        with contextlib.suppress(ProcessLookupError):
            if kind == "browser":
                os.killpg(victim.group, signal.SIGKILL)
            else:
                os.kill(victim.pid, signal.SIGKILL)
        return True

    async def _away(self) -> None:
        await asyncio.sleep(self._random.uniform(*_AWAY_SECONDS))

    async def _restart_server(self) -> bool:
        assert self._server is not None
        await _kill(self._server)
        await self._away()
        await self._start_server()
        return True

    async def _restart_web(self) -> bool:
        assert self._web is not None
        await _kill(self._web)
        await self._away()
        await self._start_web()
        return True

    async def _kill_collector(self) -> bool:
        if self._collector is None or self._collector.returncode is not None:
            return False
        await _kill(self._collector)
        return True

    async def _take_away(self, endpoint: str) -> bool:
        (self._folder / endpoint).touch()
        await self._away()
        (self._folder / endpoint).unlink()
        return True


async def _kill(process: Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    await process.wait()


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


async def run(campaign: Campaign, tasks: Sequence[Task], folder: Path) -> Ran:
    """Collect a run of these tasks under a campaign's faults.

    Args:
        campaign: its size.
        tasks: of the offline web.
        folder: a new folder for the run, its settings and its logs.
    """
    world = _World(campaign, tasks, folder)
    await world.start()
    try:
        causing = asyncio.create_task(world.cause_faults())
        try:
            await world.collect()
        finally:
            causing.cancel()
            await asyncio.gather(causing, return_exceptions=True)
        return world.result()
    finally:
        await world.stop()


def differing(run: Ran, twin: Ran) -> list[str]:
    """The samples that were rewarded in both runs, and differently: a line each."""
    both = sorted(run.rewards.keys() & twin.rewards.keys())
    return [
        f"{task}#{sample}: {run.rewards[task, sample]:g} under faults, {twin.rewards[task, sample]:g} without"
        for task, sample in both
        if run.rewards[task, sample] != twin.rewards[task, sample]
    ]


def rows(run: Ran, twin: Ran) -> list[tuple[str, str, str]]:
    """Rows of a table: outcomes of the attempts, samples with a reward, their mean, and the faults."""

    def row(name: str, value: Callable[[Ran], str]) -> tuple[str, str, str]:
        return name, value(run), value(twin)

    outcomes = [name.value for name in Outcome if run.outcomes.get(name) or twin.outcomes.get(name)]
    return [
        *(row(name, partial(_count, "outcomes", name)) for name in outcomes),
        row("samples with a reward", lambda ran: str(len(ran.rewards))),
        row("mean reward", lambda ran: f"{sum(ran.rewards.values()) / max(1, len(ran.rewards)):.3f}"),
        *(row(f"fault: {kind}", partial(_count, "faults", kind)) for kind in run.faults),
    ]


def _count(what: str, name: str, ran: Ran) -> str:
    counts: dict[str, int] = getattr(ran, what)
    return str(counts.get(name, 0))
