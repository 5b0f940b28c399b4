"""Steps per second, step latency, CPU and memory per session of the whole system on this machine.

    .venv/bin/python benchmarks/steps.py --sessions 4 8 16

Everything is real: offline web (without simulated latency), HTTP server, a Chromium per session, scripted
policy without mistakes, judge, records on disk. CPU time includes all processes of the run. Memory is the
proportional set size of the browsers, divided by the number of sessions. Only figures of one run are
comparable, not those of different machines or days.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import statistics
import tempfile
import time
from pathlib import Path

import psutil

from webgym.offline.config import SitesConfig
from webgym.rollout.config import CollectorConfig
from webgym.rollout.progress import Progress
from webgym.run.collect import collect
from webgym.run.config import PolicyChoice, RunConfig, TaskChoice

SAMPLE_SECONDS = 1.0


class Watch:
    """Samples CPU time and memory of our browsers during a run."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.cpu: dict[int, float] = {}
        self.pss: list[int] = []

    async def __aenter__(self) -> None:
        self._task = asyncio.create_task(self._sample())

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()

    async def _sample(self) -> None:
        while True:
            await asyncio.sleep(SAMPLE_SECONDS)
            total = 0
            for process in psutil.Process().children(recursive=True):
                try:
                    times = process.cpu_times()
                    self.cpu[process.pid] = times.user + times.system
                    total += process.memory_full_info().pss
                except psutil.Error:
                    continue
            self.pss.append(total)


async def measure(sessions: int, tasks: int, seed: int) -> str:
    """Measure a row of the table."""
    watches: list[Watch] = []

    def show(progress: Progress) -> Watch:
        watches.append(Watch(progress))
        return watches[-1]

    config = RunConfig(
        seed=seed,
        tasks=TaskChoice(split="test", count=tasks),
        policy=PolicyChoice(name="scripted"),
        sites=SitesConfig(latency=0, slow_seconds=0),
        collector=CollectorConfig(sessions=sessions, straggler_share=1.0),
    )
    ours = psutil.Process()
    before, started = ours.cpu_times(), time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        summary = await collect(config, Path(scratch) / "run", show=show)
    seconds, after = time.perf_counter() - started, ours.cpu_times()
    python = after.user + after.system - before.user - before.system
    browsers = sum(watches[0].cpu.values())
    steps, latency = summary["steps"], summary["step_milliseconds"]
    memory = statistics.median(watches[0].pss) / sessions / 2**20 if watches[0].pss else float("nan")
    p50, p95 = latency["p50"] or 0, latency["p95"] or 0
    browser_ms, python_ms = browsers * 1000 / steps, python * 1000 / steps
    return (
        f"{sessions:8} {summary['attempts']:9} {steps:6} {steps / seconds:8.1f} {p50:8.0f} {p95:8.0f} "
        f"{browser_ms:11.0f} {python_ms:10.0f} {memory:11.0f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "--sessions", type=int, nargs="+", default=[4, 8, 16], help="numbers of sessions, a row for each"
    )
    parser.add_argument("--tasks", type=int, default=60, help="number of tasks per row")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(f"{len(os.sched_getaffinity(0))} cores; wall time includes starting the browsers")
    print("sessions  attempts  steps  steps/s   p50 ms   p95 ms  browser ms  python ms  MB/session")
    for sessions in given.sessions:
        print(asyncio.run(measure(sessions, given.tasks, given.seed)), flush=True)


if __name__ == "__main__":
    main()
