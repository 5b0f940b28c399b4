"""Measure a cell of ``webgym bench rollout``, with the real collector, server, Chromium and store."""

from __future__ import annotations

import asyncio
import os
import shutil
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Final

import msgspec
import uvloop
from pydantic import SecretStr

from webgym.bench.rollout.endpoint import Endpoint, serving_endpoint
from webgym.bench.rollout.plan import PARTS, Cell, RolloutPlan, scripts_of
from webgym.bench.server_process import ServerAddress, start_server, stop_server
from webgym.bench.stepping import wait_until
from webgym.bench.usage import CpuTimes
from webgym.browser.config import BrowserConfig
from webgym.browser.find import find_browser
from webgym.core.errors import ConfigError, RunFolderError
from webgym.core.outcome import Outcome
from webgym.offline.app import RunningSites, serving
from webgym.offline.web import OfflineWeb
from webgym.results.summary import environment_milliseconds
from webgym.run.collect import collect
from webgym.run.config import RunConfig, Secrets
from webgym.server.client import BrowserClient
from webgym.server.config import Admission, ServerConfig
from webgym.store.runs import RunReader

PLAN: Final = "plan.json"
"""File of the plan in the folder of the results."""
_SAMPLE_SECONDS = 1.0
_READY_SECONDS = 300.0


class Load(msgspec.Struct, frozen=True):
    """The load in an interval of about a second.

    Attributes:
        seconds: time from the start to the end of the interval.
        cpu: share of the browsers' processors that they and their server used.
        policy: share of the time in which GPUs were busy.
        requests: number of requests at the policy at the end.
        cpu_seconds: CPU time of the browsers and their server.
    """

    seconds: float
    cpu: float
    policy: float
    requests: int
    cpu_seconds: float = 0.0


class Measured(msgspec.Struct, frozen=True):
    """The result of a cell.

    Attributes:
        cell: the measurement.
        seconds: wall time.
        outcomes: number of attempts by outcome.
        steps: number of steps of all attempts.
        cpu_seconds: CPU time of the browsers and their server.
        policy_seconds: busy time of all GPUs.
        prompt_tokens: number of tokens of all requests.
        read_tokens: number of these that were not in the prefix cache.
        between: seconds from every reply to the next screenshot: the action and the loading of the page.
        loads: loads over time.
        machine_load: the machine's load average over a minute when the cell started.
    """

    cell: Cell
    seconds: float
    outcomes: dict[str, int]
    steps: int
    cpu_seconds: float
    policy_seconds: float
    prompt_tokens: int
    read_tokens: int
    between: list[float]
    loads: list[Load]
    machine_load: float

    @property
    def ended(self) -> int:
        """The number of attempts with a reward."""
        return sum(count for name, count in self.outcomes.items() if Outcome(name).is_rewarded)

    @property
    def lost(self) -> int:
        """The number of attempts that ended without a reward, before the time limit."""
        return sum(self.outcomes.values()) - self.ended - self.outcomes.get(Outcome.CANCELLED, 0)

    @property
    def lost_share(self) -> float:
        """The share of attempts that ended without a reward."""
        return self.lost / max(1, sum(self.outcomes.values()))

    @property
    def per_minute(self) -> float:
        """The number of attempts with a reward per minute."""
        return 60 * self.ended / self.seconds

    @property
    def cpu(self) -> float:
        """The mean use of the browsers' processors, between 0 and 1."""
        return self.cpu_seconds / (self.seconds * self.cell.cpus)

    @property
    def policy(self) -> float:
        """The mean use of the GPUs, between 0 and 1."""
        return self.policy_seconds / (self.seconds * self.cell.gpus)


class CellResult(msgspec.Struct, frozen=True):
    """The results of all rounds of a cell, in order."""

    rounds: list[Measured]

    @property
    def cell(self) -> Cell:
        """The cell of the first round."""
        return self.rounds[0].cell

    def of(self, name: str) -> list[float]:
        """An attribute of :class:`Measured` in every round."""
        return [float(getattr(result, name)) for result in self.rounds]


def by_cell(measured: Sequence[Measured]) -> list[CellResult]:
    """Group results by cell."""
    cells: dict[Cell, list[Measured]] = {}
    for result in measured:
        cells.setdefault(msgspec.structs.replace(result.cell, round=0), []).append(result)
    return [CellResult(sorted(rounds, key=lambda measured: measured.cell.round)) for rounds in cells.values()]


def over_async(result: CellResult, results: Sequence[CellResult]) -> list[float]:
    """Wall time of a cell over that of async with a queue per operation and as many processors, by round.

    Rounds with another number of steps than that of async, which are other work, have no ratio.
    """
    bases = {
        (measured.cell.round, measured.cell.cpus, measured.steps): measured.seconds
        for other in results
        if other.cell.mode == "async"
        for measured in other.rounds
    }
    pairs = (
        (measured.seconds, bases.get((measured.cell.round, measured.cell.cpus, measured.steps)))
        for measured in result.rounds
    )
    return [seconds / base for seconds, base in pairs if base]


@contextmanager
def _confined(cpus: int) -> Iterator[None]:
    """Confine processes that are started in the block to the first ``cpus`` of our processors."""
    available = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(available)[:cpus])
    try:
        yield
    finally:
        os.sched_setaffinity(0, available)


@asynccontextmanager
async def _browsers(cell: Cell, sites: RunningSites, browser: BrowserConfig) -> AsyncIterator[ServerAddress]:
    """Run a browser server on the cell's processors until the block ends; all of its slots are ready."""
    with _confined(cell.cpus):  # also for the settings, whose defaults depend on the number of processors
        config = ServerConfig(
            slots=cell.sessions,
            admission=Admission(queues=cell.queues),
            browser=browser.allowing(*sites.allowed_hosts),
        )
        process, address = await start_server(config)
    try:
        async with BrowserClient(address.url, token=address.token) as client:
            async with asyncio.timeout(_READY_SECONDS):
                await wait_until(client, lambda pressure: pressure.slots.free == cell.sessions)
        yield address
    finally:
        await stop_server(process)


async def measure(plan: RolloutPlan, cell: Cell, scratch: Path) -> Measured:
    """Carry out the workload of a cell.

    Args:
        plan: of the benchmark.
        cell: the measurement.
        scratch: folder of the run, which is removed afterwards; it must not exist.
    """
    network = plan.network
    web = OfflineWeb(network.sites.seed)
    scripts = await asyncio.to_thread(scripts_of, plan, web, cell.trajectories)
    costs = plan.costs
    slower = {
        "prefill_tokens_per_second": costs.prefill_tokens_per_second / cell.slow,
        "decode_seconds": costs.decode_seconds * cell.slow,
        "decode_seconds_per_reply": costs.decode_seconds_per_reply * cell.slow,
    }
    machine_load = os.getloadavg()[0]
    async with (
        serving(network.sites, web) as sites,
        serving_endpoint(scripts, costs.model_copy(update=slower), cell.gpus) as endpoint,
        _browsers(cell, sites, network.browser) as browsers,
    ):
        config = _run_config(plan, cell, sites, endpoint, browsers)
        secrets = Secrets(server_token=SecretStr(browsers.token), sites_token=SecretStr(sites.token))
        loads: list[Load] = []
        meter = CpuTimes(browsers.pid)
        began = time.monotonic()
        watch = asyncio.create_task(_watch(cell, meter, endpoint, began, loads))
        try:
            with suppress(TimeoutError):
                async with asyncio.timeout(cell.seconds):
                    tasks = [script.task for script in scripts]
                    await collect(config, scratch, tasks=tasks, secrets=secrets, show=None, tell=None)
            seconds = time.monotonic() - began
        finally:
            watch.cancel()
            await asyncio.gather(watch, return_exceptions=True)
        # The sum of intervals, as the processes of a session end with it, and the rest after the last one.
        spent = sum(load.cpu_seconds for load in loads)
        spent += sum((await asyncio.to_thread(meter.since_last)).values())
        outcomes, steps, between = await asyncio.to_thread(_read, scratch)
        await asyncio.to_thread(shutil.rmtree, scratch, ignore_errors=True)
        return Measured(
            cell=cell,
            seconds=seconds,
            outcomes=outcomes,
            steps=steps,
            cpu_seconds=spent,
            policy_seconds=endpoint.busy_seconds,
            prompt_tokens=endpoint.prompt_tokens,
            read_tokens=endpoint.read_tokens,
            between=between,
            loads=loads,
            machine_load=machine_load,
        )


def _run_config(
    plan: RolloutPlan, cell: Cell, sites: RunningSites, endpoint: Endpoint, browsers: ServerAddress
) -> RunConfig:
    """Settings of the run. Attempts are not retried or ended early, so that all cells do the same work."""
    chat = {
        "base_url": endpoint.url,
        "model": "bench",
        "concurrency": cell.sessions,
        "adapt": {"first": cell.sessions, "shrink": 1.0},
    }
    settings = {
        "seed": plan.seed,
        "retries": 0,
        "tasks": {"split": "all"},
        "sites": {"seed": plan.network.sites.seed},
        "policy": {"name": "openai", "chat": chat, "check": False},
        "agent": {"mode": "marks", "rounds": 3},
        "server": {"url": browsers.url, "sites_url": sites.url},
        "collector": {
            "sessions": cell.sessions,
            "straggler_share": 1.0,
            "schedule": cell.schedule,
            "refills": cell.refills,
        },
    }
    return RunConfig.model_validate(settings)


def _read(run: Path) -> tuple[dict[str, int], int, list[float]]:
    """The outcomes of a run, its number of steps, and the seconds between reply and next screenshot."""
    outcomes: Counter[str] = Counter()
    steps, between = 0, list[float]()
    try:
        for trajectory in RunReader(run).trajectories():
            outcomes[trajectory.outcome.value] += 1
            steps += len(trajectory.episode.steps)
            between += [
                milliseconds / 1000 for milliseconds in environment_milliseconds(trajectory.episode.steps)
            ]
    except RunFolderError:  # stopped before the run began
        return {}, 0, []
    return dict(outcomes), steps, between


async def _watch(cell: Cell, meter: CpuTimes, endpoint: Endpoint, began: float, loads: list[Load]) -> None:
    """Append the load to ``loads`` every second, until cancelled."""
    worked, last = endpoint.busy_seconds, began
    while True:
        await asyncio.sleep(_SAMPLE_SECONDS)
        used = sum((await asyncio.to_thread(meter.since_last)).values())
        now, busy = time.monotonic(), endpoint.busy_seconds
        passed = now - last
        loads.append(
            Load(
                seconds=now - began,
                cpu=used / (passed * cell.cpus),
                cpu_seconds=used,
                policy=(busy - worked) / (passed * endpoint.gpus),
                requests=endpoint.requests,
            )
        )
        worked, last = busy, now


def file_of(folder: Path, cell: Cell) -> Path:
    """The file of a cell's result."""
    return folder / f"{cell.name}.json"


def read_bench(folder: Path) -> tuple[RolloutPlan, list[Measured]]:
    """Read a plan and its results so far.

    Raises:
        RunFolderError: the folder contains no benchmark.
    """
    try:
        plan = msgspec.json.decode((folder / PLAN).read_bytes(), type=RolloutPlan)
        files = (file_of(folder, cell) for cell in plan.cells(PARTS))
        return plan, [msgspec.json.decode(f.read_bytes(), type=Measured) for f in files if f.exists()]
    except (OSError, ValueError) as error:
        raise RunFolderError(
            f"{folder} contains no results of webgym bench rollout: {error}", hint="give its --out folder"
        ) from error


def check_machine(cells: Sequence[Cell]) -> None:
    """Refuse what cannot be measured here.

    Raises:
        ConfigError: there are fewer processors than a cell has.
        BrowserNotFound: there is no browser.
    """
    available, most = len(os.sched_getaffinity(0)), max(cell.cpus for cell in cells)
    if most > available:
        raise ConfigError(
            f"{most} processors are requested, but only {available} available", hint="give --cpus"
        )
    find_browser()


def begin(plan: RolloutPlan, folder: Path, *, new: bool = True) -> list[Measured]:
    """Make the folder of the benchmark, or read the results that it contains.

    Args:
        plan: of the benchmark.
        folder: of the results.
        new: whether the folder may be made.

    Raises:
        RunFolderError: the folder contains another plan, or something else, or cannot be written.
    """
    if new and not (folder / PLAN).exists():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / PLAN).write_bytes(msgspec.json.format(msgspec.json.encode(plan)))
        except OSError as error:
            reason = f"{folder} cannot be written: {error.strerror}"
            raise RunFolderError(reason, hint="give another --out") from error
    stored, results = read_bench(folder)
    if stored != plan:
        raise RunFolderError(
            f"{folder} contains another plan", hint="give the same options, or another --out"
        )
    return results


def measure_into(folder: Path, plan: RolloutPlan, cell: Cell) -> Measured:
    """Measure a cell and store its result. An interrupted measurement is repeated from the start."""
    scratch = folder / f"{cell.name}.run"
    if scratch.exists():
        shutil.rmtree(scratch)
    result = uvloop.run(measure(plan, cell, scratch))
    part = file_of(folder, cell).with_suffix(".part")
    part.write_bytes(msgspec.json.encode(result))
    part.replace(file_of(folder, cell))
    return result
