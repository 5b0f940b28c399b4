"""The cost of the collector itself: many parallel episodes in one process, with servers that cost little.

    PYTHONPATH=. .venv/bin/python benchmarks/collector.py --sessions 100 1000

Browser server and model endpoint are stand-ins behind real HTTP, in a separate process; agent, client and
records on disk are real. Times of steps and replies are uniformly distributed around the given means, so
that all sessions are active all the time. Pages are equal, so that each screenshot is stored once. CPU time
is that of the collector's process only.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import random
import tempfile
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from benchmarks.stand_ins import TOKEN, StandInBrowsers, StandInModel, serving_app
from pydantic import SecretStr

from webgym.agent.config import AgentConfig
from webgym.core.task import FactGroup, Rubric, Task
from webgym.judge.config import JudgeChoice
from webgym.llm.config import ChatConfig
from webgym.rollout.config import CollectorConfig
from webgym.rollout.progress import Progress
from webgym.run.collect import collect
from webgym.run.config import PolicyChoice, RunConfig, Secrets, ServerChoice, TaskChoice
from webgym.server.config import ClientLimits
from webgym.tasks.formats import write_tasks

PATIENT: Any = {"connect_seconds": 60}
"""Limits of the client: all sessions connect at the same time, to servers on the same processors."""


def judge(task: Task, episode: object) -> bool:
    """Accept every answer."""
    del task, episode
    return True


def around(seconds: float) -> Callable[[], float]:
    return lambda: random.uniform(0.5, 1.5) * seconds


async def serve(pipe: Connection, steps: int, step_seconds: float, reply_seconds: float) -> None:
    browsers = StandInBrowsers(around(step_seconds))
    model = StandInModel(steps, around(reply_seconds))
    async with serving_app(browsers.app()) as server, serving_app(model.app()) as endpoint:
        pipe.send((server, endpoint))
        await asyncio.to_thread(pipe.recv)
        pipe.send((browsers.most, model.most))


def stand_in(pipe: Connection, steps: int, step_seconds: float, reply_seconds: float) -> None:
    asyncio.run(serve(pipe, steps, step_seconds, reply_seconds))


class Watch:
    """Records the progress of a run, and its CPU time."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress

    async def __aenter__(self) -> None:
        self.began, self.used = time.monotonic(), sum(os.times()[:2])

    async def __aexit__(self, *_: object) -> None:
        self.seconds, self.cpu = time.monotonic() - self.began, sum(os.times()[:2]) - self.used


def settings(folder: Path, sessions: int, episodes: int, ports: tuple[int, int]) -> RunConfig:
    rubric = Rubric((FactGroup(1, "", ("it is",)),))
    names = (f"t{number}" for number in range(episodes))
    tasks = [Task(name, "Do it.", "stand-in.test", "Misc.", "News", rubric, "bench") for name in names]
    write_tasks(folder / "tasks.jsonl", tasks)
    chat = ChatConfig(base_url=f"http://127.0.0.1:{ports[1]}/v1", model="m", concurrency=sessions, **PATIENT)
    return RunConfig(
        tasks=TaskChoice(count="all", file=folder / "tasks.jsonl", split="all"),
        policy=PolicyChoice(chat=chat, check=False),
        agent=AgentConfig(image_max_side=None),
        judge=JudgeChoice(name="benchmarks.collector:judge"),
        server=ServerChoice(url=f"http://127.0.0.1:{ports[0]}"),
        collector=CollectorConfig(sessions=sessions, straggler_share=1.0, policy_calls=sessions),
        limits=ClientLimits(navigate=sessions, execute=sessions, allocate=64, release=64, **PATIENT),
    )


async def measure(sessions: int, given: argparse.Namespace) -> str:
    """Measure a row of the table."""
    pipe, other = multiprocessing.Pipe()
    context = multiprocessing.get_context("spawn")
    servers = context.Process(
        target=stand_in, args=(other, given.steps, given.step_seconds, given.reply_seconds)
    )
    servers.start()
    try:
        ports = await asyncio.to_thread(pipe.recv)
        watches: list[Watch] = []

        def show(progress: Progress) -> Watch:
            watches.append(Watch(progress))
            return watches[-1]

        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            config = settings(folder, sessions, sessions * given.rounds, ports)
            secrets = Secrets(server_token=SecretStr(TOKEN))
            summary = await collect(config, folder / "run", secrets=secrets, show=show)
        pipe.send("end")
        most, asked = await asyncio.to_thread(pipe.recv)
    finally:
        servers.terminate()
        servers.join()
    watch, lag = watches[0], watches[0].progress.lag
    steps = summary["steps"]
    return (
        f"| {sessions} | {most} | {asked} | {summary['outcomes']['success']} of {sessions * given.rounds} "
        f"| {steps / watch.seconds:.0f} | {watch.cpu / steps * 1000:.2f} | {watch.cpu / watch.seconds:.2f} "
        f"| {lag.milliseconds(0.5):.1f} | {lag.milliseconds(0.99):.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sessions", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--rounds", type=int, default=1, help="number of episodes per session")
    parser.add_argument(
        "--steps", type=int, default=13, help="number of steps per episode; the paper's mean is 13.2"
    )
    parser.add_argument("--step-seconds", type=float, default=3.0)
    parser.add_argument("--reply-seconds", type=float, default=7.0)
    given = parser.parse_args()
    print(
        "| sessions | max. open | max. requests | success | steps/s | client CPU per step, ms | CPU, cores",
        end="",
    )
    print(" | loop lag p50, ms | p99, ms |\n" + "|---" * 9 + "|")
    for sessions in given.sessions:
        print(asyncio.run(measure(sessions, given)), flush=True)


if __name__ == "__main__":
    main()
