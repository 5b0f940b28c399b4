"""One cell of ``webgym bench rollout``: the real collector, server, Chromium and store, and who was busy."""

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
from webgym.core.errors import ConfigError, RunFolderError
from webgym.core.outcome import Outcome
from webgym.offline.app import RunningSites, serving
from webgym.offline.web import OfflineWeb
from webgym.rollout.store import RunReader
from webgym.rollout.summary import environment_milliseconds
from webgym.run_config import RunConfig, Secrets
from webgym.runs import collect
from webgym.server.client import BrowserClient
from webgym.server.config import Admission, ServerConfig

PLAN: Final = "plan.json"
_SAMPLE_SECONDS = 1.0
_READY_SECONDS = 300.0


class Load(msgspec.Struct, frozen=True):
    """Of one moment.

    Attributes:
        seconds: since the beginning.
        cpu: share of the browsers' processors that they and their server used since the last moment.
        cpu_seconds: what they used.
        policy: share of the time since then in which GPUs worked.
        requests: at the policy.
    """

    seconds: float
    cpu: float
    policy: float
    requests: int
    cpu_seconds: float = 0.0


class Measured(msgspec.Struct, frozen=True):
    """What one cell found.

    Attributes:
        seconds: wall time.
        outcomes: of the attempts.
        steps: of the attempts.
        cpu_seconds: of the browsers and their server.
        policy_seconds: that GPUs worked.
        prompt_tokens, read_tokens: of all requests, and those of them that the prefix cache did not have.
        between: seconds from each reply to the next look at the page: the action, its page, the screenshot.
        loads: over time.
        machine_load: processes that wanted a processor of the whole machine when the cell began, one minute's
            average: what else went on.
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
        """Attempts that ended by themselves, whatever their reward."""
        return sum(count for name, count in self.outcomes.items() if Outcome(name).is_rewarded)

    @property
    def crashes(self) -> int:
        """Attempts that ended in an error of the environment."""
        return self.outcomes.get(Outcome.ENVIRONMENT_ERROR, 0)

    @property
    def crashed(self) -> float:
        """Share of the attempts that ended in an error of the environment."""
        return self.crashes / max(1, sum(self.outcomes.values()))

    @property
    def per_minute(self) -> float:
        """Attempts that ended by themselves, per minute."""
        return 60 * self.ended / self.seconds

    @property
    def cpu(self) -> float:
        """Share of the browsers' processors in use."""
        return self.cpu_seconds / (self.seconds * self.cell.cpus)

    @property
    def policy(self) -> float:
        """Share of the time in which GPUs worked."""
        return self.policy_seconds / (self.seconds * self.cell.gpus)


class Repeated(msgspec.Struct, frozen=True):
    """All rounds of one cell, in order."""

    rounds: list[Measured]

    @property
    def cell(self) -> Cell:
        """Of the first round."""
        return self.rounds[0].cell

    def of(self, name: str) -> list[float]:
        """A figure of every round."""
        return [float(getattr(one, name)) for one in self.rounds]


def repeated(found: Sequence[Measured]) -> list[Repeated]:
    """Cells with their rounds."""
    cells: dict[Cell, list[Measured]] = {}
    for one in found:
        cells.setdefault(msgspec.structs.replace(one.cell, round=0), []).append(one)
    return [Repeated(sorted(each, key=lambda one: one.cell.round)) for each in cells.values()]


def over_async(one: Repeated, cells: Sequence[Repeated]) -> list[float]:
    """Wall time over that of async with a queue per operation, of the same processors and round."""
    bases = {
        (measured.cell.round, measured.cell.cpus): measured.seconds
        for each in cells
        if each.cell.mode == "async"
        for measured in each.rounds
    }
    found = (
        (measured.seconds, bases.get((measured.cell.round, measured.cell.cpus))) for measured in one.rounds
    )
    return [seconds / base for seconds, base in found if base]


@contextmanager
def _confined(cpus: int) -> Iterator[None]:
    """Whatever is started in the block may use the first so many of our processors.

    Raises:
        ConfigError: there are not so many.
    """
    ours = os.sched_getaffinity(0)
    if cpus > len(ours):
        raise ConfigError(f"{cpus} processors are asked for, and there are {len(ours)}", hint="give --cpus")
    os.sched_setaffinity(0, sorted(ours)[:cpus])
    try:
        yield
    finally:
        os.sched_setaffinity(0, ours)


@asynccontextmanager
async def _browsers(cell: Cell, sites: RunningSites) -> AsyncIterator[ServerAddress]:
    """A browser server, confined to the cell's processors, all of its slots ready."""
    with _confined(cell.cpus):  # its defaults, too, go by the processors that it may use
        config = ServerConfig(
            slots=cell.sessions,
            admission=Admission(queues=cell.queues),
            browser=BrowserConfig().allowing(*sites.allowed_hosts),
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
    """Carry the workload out in one cell.

    Args:
        scratch: folder for the run, which is removed; it must not exist.
    """
    web = OfflineWeb(plan.sites.seed)
    scripts = await asyncio.to_thread(scripts_of, plan, web, cell.trajectories)
    costs = plan.costs
    slower = {
        "prefill_tokens_per_second": costs.prefill_tokens_per_second / cell.slow,
        "decode_seconds": costs.decode_seconds * cell.slow,
        "decode_seconds_per_reply": costs.decode_seconds_per_reply * cell.slow,
    }
    machine_load = os.getloadavg()[0]
    async with (
        serving(plan.sites, web) as sites,
        serving_endpoint(scripts, costs.model_copy(update=slower), cell.gpus) as endpoint,
        _browsers(cell, sites) as browsers,
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
                    await collect(config, scratch, tasks=[one.task for one in scripts], secrets=secrets)
            seconds = time.monotonic() - began
        finally:
            watch.cancel()
            await asyncio.gather(watch, return_exceptions=True)
        # Sample by sample, as a session's processes are gone when it is over; and what came after the last.
        spent = sum(load.cpu_seconds for load in loads)
        spent += sum((await asyncio.to_thread(meter.since_last)).values())
        found = await asyncio.to_thread(_read, scratch)
        await asyncio.to_thread(shutil.rmtree, scratch, ignore_errors=True)
        return Measured(
            cell=cell,
            seconds=seconds,
            outcomes=found[0],
            steps=found[1],
            cpu_seconds=spent,
            policy_seconds=endpoint.busy_seconds,
            prompt_tokens=endpoint.prompt_tokens,
            read_tokens=endpoint.read_tokens,
            between=found[2],
            loads=loads,
            machine_load=machine_load,
        )


def _run_config(
    plan: RolloutPlan, cell: Cell, sites: RunningSites, endpoint: Endpoint, browsers: ServerAddress
) -> RunConfig:
    """Every attempt is made once and to its own end: the same work in all cells, nothing cut short."""
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
    """Outcomes, steps, and the seconds between them."""
    outcomes: Counter[str] = Counter()
    steps, between = 0, list[float]()
    try:
        for trajectory in RunReader(run).trajectories():
            outcomes[trajectory.outcome.value] += 1
            steps += len(trajectory.episode.steps)
            between += [each / 1000 for each in environment_milliseconds(trajectory.episode.steps)]
    except RunFolderError:  # stopped before the run began
        return {}, 0, []
    return dict(outcomes), steps, between


async def _watch(cell: Cell, meter: CpuTimes, endpoint: Endpoint, began: float, loads: list[Load]) -> None:
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
    """Where a cell's figures are kept."""
    return folder / f"{cell.name}.json"


def read_bench(folder: Path) -> tuple[RolloutPlan, list[Measured]]:
    """The plan, and what was measured of it so far.

    Raises:
        RunFolderError: the folder holds no benchmark.
    """
    try:
        plan = msgspec.json.decode((folder / PLAN).read_bytes(), type=RolloutPlan)
        files = (file_of(folder, cell) for cell in plan.cells(PARTS))
        return plan, [msgspec.json.decode(f.read_bytes(), type=Measured) for f in files if f.exists()]
    except (OSError, msgspec.DecodeError) as error:
        raise RunFolderError(
            f"{folder} holds no figures of webgym bench rollout: {error}", hint="give its --out folder"
        ) from error


def begin(plan: RolloutPlan, folder: Path) -> list[Measured]:
    """Make the folder, or find what it holds.

    Raises:
        RunFolderError: it holds another plan, or something else.
    """
    if not (folder / PLAN).exists():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PLAN).write_bytes(msgspec.json.format(msgspec.json.encode(plan)))
    held, found = read_bench(folder)
    if held != plan:
        raise RunFolderError(f"{folder} holds another plan", hint="give the same options, or another --out")
    return found


def measure_into(folder: Path, plan: RolloutPlan, cell: Cell) -> Measured:
    """Measure a cell and keep its figures; those of one that is killed half-way are measured again."""
    scratch = folder / f"{cell.name}.run"
    if scratch.exists():
        shutil.rmtree(scratch)
    found = uvloop.run(measure(plan, cell, scratch))
    part = file_of(folder, cell).with_suffix(".part")
    part.write_bytes(msgspec.json.encode(found))
    part.replace(file_of(folder, cell))
    return found
