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

import msgspec
import uvloop
from pydantic import SecretStr

from webgym.bench.rollout.endpoint import Endpoint, serving_endpoint
from webgym.bench.rollout.plan import Cell, RolloutPlan, scripts_of
from webgym.bench.rollout.results import Load, Measured, file_of
from webgym.bench.server_process import ServerAddress, start_server, stop_server
from webgym.bench.stepping import CpuTimes, wait_until
from webgym.browser.config import BrowserConfig
from webgym.browser.find import find_browser
from webgym.core.errors import ConfigError, RunFolderError
from webgym.offline.app import RunningSites, serving
from webgym.offline.web import OfflineWeb
from webgym.results.summary import environment_milliseconds
from webgym.run.collect import collect
from webgym.run.config import RunConfig, Secrets
from webgym.server.client import BrowserClient
from webgym.server.config import Admission, ServerConfig
from webgym.store.runs import RunReader

_SAMPLE_SECONDS = 1.0
_READY_SECONDS = 300.0


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
    chat = {"base_url": endpoint.url, "model": "bench", "concurrency": cell.sessions}
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
