"""Wall time of training with and without overlap of collection and update.

    python benchmarks/overlap.py --iterations 4 --tasks 12 --think 0.5 --passes 6

Real browsers, websites, judge, store and updates of a tiny model on the processors of this machine. The
policy demonstrates solutions, and its replies take --think seconds, as those of a remote model would. Both
loops run one after the other, with the same browsers and tasks, and train on at most the same number of
steps.
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from pathlib import Path
from typing import Any

import torch

from webgym.agent.policy import BasePolicy, Policy, PolicyInput, PolicySession
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.offline.small import small_vocabulary
from webgym.run.choice import all_tasks
from webgym.run.config import Secrets
from webgym.run.services import services
from webgym.study.demonstrators import Demonstrators
from webgym.study.model import TinyConfig, make_model, save_model
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay
from webgym.train.update import Learner


class Thinks(BasePolicy):
    """A policy that demonstrates solutions with a delay, and ignores published weights."""

    wants_elements = True
    name = "demonstrators"

    def __init__(self, seconds: float) -> None:
        self.policy: Policy = self
        self._seconds = seconds
        self._demonstrators = Demonstrators()

    def begin(self, task: Task, seed: int) -> PolicySession:
        return _Player(self._demonstrators.begin(task, seed), self._seconds)

    async def publish(self, weights: Path, version: str) -> None:  # noqa: ARG002
        return None

    async def watch(self) -> None:
        await asyncio.get_running_loop().create_future()


class _Player:
    def __init__(self, player: PolicySession, seconds: float) -> None:
        self._player, self._seconds = player, seconds

    async def reply(self, turn: PolicyInput) -> Reply:
        await asyncio.sleep(self._seconds)
        return await self._player.reply(turn)


def settings(options: argparse.Namespace, model: Path) -> TrainConfig:
    update = {"precision": "fp32", "learning_rate": 1e-4, "batch": 16, "micro_batch": 16}
    replay = {"steps": 4 * options.tasks, "passes": options.passes, "max_uses": None}
    return TrainConfig.model_validate(
        {
            "learn": {"model": str(model), "update": update, "replay": replay},
            "rollout": {
                "sites": {"collection": "small", "latency": 0, "per_family": 5},
                "agent": {"prompt_format": "compact", "rounds": 0, "profile": "tiny"},
                "collector": {"sessions": options.sessions, "straggler_share": 1.0},
            },
            "loop": {"iterations": options.iterations, "tasks": options.tasks, "evaluate_every": 0},
        }
    )


async def measure(options: argparse.Namespace, folder: Path) -> list[tuple[int, float, list[dict[str, Any]]]]:
    model = folder / "model"
    save_model(make_model(small_vocabulary(), TinyConfig()), model)
    config = settings(options, model)
    results = []
    async with services(config.rollout, Secrets()) as (where, secrets):
        tasks = all_tasks(config.rollout)
        for staleness in options.staleness:
            loop = config.loop.model_copy(update={"staleness": staleness})
            objective = make_objective(config.learn.objective)
            training = Training(
                config.model_copy(update={"loop": loop}),
                TrainingFolder(folder / str(staleness)),
                tasks,
                serving=Thinks(options.think),
                learner=Learner(config.learn, objective),
                replay=Replay(config.learn.replay, objective),
                where=where,
                secrets=secrets,
            )
            training.folder.create(config.model_dump(mode="json"))
            started = time.monotonic()
            rows = await training.run()
            results.append((staleness, time.monotonic() - started, rows))
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--iterations", type=int, default=4)
    parser.add_argument("--tasks", type=int, default=12, help="number of tasks per iteration")
    parser.add_argument("--think", type=float, default=0.5, help="time of a reply, seconds")
    parser.add_argument("--passes", type=int, default=6, help="number of passes of an update over its steps")
    parser.add_argument("--sessions", type=int, default=6)
    parser.add_argument("--staleness", type=int, nargs="+", default=[0, 1])
    options = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        results = asyncio.run(measure(options, Path(folder)))
    print("| staleness | wall s | collecting s | updating s | steps trained on |")
    print("|---|---|---|---|---|")
    for staleness, wall, rows in results:
        collecting, updating = (sum(row["seconds"][stage] for row in rows) for stage in ("collect", "update"))
        steps = sum(row["update"].get("samples", 0) for row in rows)
        print(f"| {staleness} | {wall:.1f} | {collecting:.1f} | {updating:.1f} | {steps} |")


if __name__ == "__main__":
    main()
