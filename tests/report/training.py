"""A training folder that looks like one: the real loop and store, made-up attempts that get better."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from tests.report.conftest import Maker, Scene
from tests.report.conftest import task as made_task
from tests.train.worlds import MadeUp, training_of

from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Trajectory
from webgym.train.config import LearnConfig, ReplayConfig
from webgym.train.folder import TrainingFolder
from webgym.train.loop import EvaluationConfig, LoopConfig, TrainConfig
from webgym.train.replay import ReplaySample


def tasks(count: int) -> list[Task]:
    """So many training tasks and half as many test tasks, of all levels, no website of both."""
    found = []
    for number in range(count + count // 2):
        split = "train" if number < count else "test"
        plain = made_task(number, (2, 2, 5, 3, 2, 8)[number % 6])
        website = f"http://{split}-{number}.webgym.test/"
        found.append(msgspec.structs.replace(plain, split=split, website=website))
    return found


class World(MadeUp):
    """Makes the attempts of a policy that each update makes better, and the updates."""

    def __init__(self, distinct: int) -> None:
        super().__init__()
        self._served = 0
        self._maker = Maker(distinct)
        self.pictures = self._maker.pictures

    def attempt(self, run: Path, task: Task, number: int, seed: int) -> Trajectory:
        rng = random.Random(f"{seed}/{task.id}")
        chance = {"easy": 0.4, "medium": 0.2, "hard": 0.05}[task.level] + 0.09 * self._served
        outcome = (
            Outcome.SUCCESS if rng.random() < chance else rng.choice((Outcome.FAILURE, Outcome.TRUNCATED))
        )
        if rng.random() < 0.06:
            outcome = rng.choice((Outcome.BLOCKED, Outcome.ENVIRONMENT_ERROR))
        drawn_as = int(task.id.rpartition("-")[2])
        drawn = made_task(drawn_as, task.difficulty)
        made = self._maker.make(Scene(drawn, outcome, drawn_as, length=max(3, 8 - self._served)))
        episode = msgspec.structs.replace(
            made.episode, attempt_id=f"{task.id}#0.0", task_id=task.id, sample=0
        )
        return msgspec.structs.replace(made, episode=episode)

    def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        folder.weights(number).mkdir(parents=True)
        dropped = {"request too long": 2} if number == 2 else {}
        return {
            "samples": len(draw.steps) - sum(dropped.values()),
            "loss": 1.4 / number,
            "grad_norm": 0.9 / number,
            "dropped": dropped,
        }

    def copy(self) -> None:
        return None

    async def publish(self, weights: Path, version: str) -> None:
        self._served = int(version)

    async def watch(self) -> None:
        return None


def build_training(path: Path, *, iterations: int = 3, count: int = 12, distinct: int = 3) -> Path:
    """Run a whole training, with ``count`` tasks in each iteration."""
    config = TrainConfig(
        learn=LearnConfig(model="Qwen/Qwen3-VL-8B-Instruct", replay=ReplayConfig(steps=4 * count)),
        loop=LoopConfig(iterations=iterations, tasks=count, evaluate_every=max(1, iterations // 2)),
        evaluation=EvaluationConfig(),
    )
    TrainingFolder(path).create(config.model_dump(mode="json"))
    asyncio.run(training_of(path, World(distinct), config, tasks(count)).run())
    return path
