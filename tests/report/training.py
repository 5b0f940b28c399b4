"""A training folder that looks like one: the real loop and store, made-up attempts that get better."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from tests.report.conftest import Maker, Scene
from tests.report.conftest import task as made_task

from webgym.agent.policy import OpensNothing, Policy
from webgym.agent.random_policy import RandomPolicy
from webgym.collection import RunConfig, Secrets, ServerChoice
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.rollout.store import RunReader, RunWriter
from webgym.rollout.summary import Summary, summarise
from webgym.train.config import LearnConfig, ReplayConfig
from webgym.train.folder import TrainingFolder
from webgym.train.loop import EvaluationConfig, LoopConfig, TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Draw, Replay


def tasks(count: int) -> list[Task]:
    """So many training tasks and half as many test tasks, of all levels, no website of both."""
    found = []
    for number in range(count + count // 2):
        split = "train" if number < count else "test"
        plain = made_task(number, (2, 2, 5, 3, 2, 8)[number % 6])
        website = f"http://{split}-{number}.webgym.test/"
        found.append(msgspec.structs.replace(plain, split=split, website=website))
    return found


class World(OpensNothing):
    """Makes the attempts of a policy that each update makes better, and the updates."""

    def __init__(self, distinct: int) -> None:
        self.policy: Policy = RandomPolicy()
        self._served = 0
        self._maker = Maker(distinct)
        self._pictures: dict[str, bytes] = {}

    async def attempts(
        self,
        out: Path,
        config: RunConfig,
        tasks: Sequence[Task],
        policy: Policy,
        secrets: Secrets,
        show: object,
    ) -> Summary:
        async with await RunWriter.create(out, {"seed": config.seed}, list(tasks)) as writer:
            made = [self._attempt(task, f"{config.seed}/{task.id}") for task in tasks]
            self._pictures |= self._maker.pictures
            for name, data in self._pictures.items():
                await writer.put_image(name, data)
            for each in made:
                await writer.append(each)
            found = summarise(RunReader(out).trajectories(), list(tasks), seed=config.seed)
            await writer.write_summary(found)
        return found

    def _attempt(self, task: Task, seed: str) -> Any:
        rng = random.Random(seed)
        chance = {"easy": 0.4, "medium": 0.2, "hard": 0.05}[task.level] + 0.09 * self._served
        outcome = (
            Outcome.SUCCESS if rng.random() < chance else rng.choice((Outcome.FAILURE, Outcome.TRUNCATED))
        )
        if rng.random() < 0.06:
            outcome = rng.choice((Outcome.BLOCKED, Outcome.ENVIRONMENT_ERROR))
        number = int(task.id.rpartition("-")[2])
        drawn = made_task(number, task.difficulty)
        made = self._maker.make(Scene(drawn, outcome, number, length=max(3, 8 - self._served)))
        episode = msgspec.structs.replace(
            made.episode, attempt_id=f"{task.id}#0.0", task_id=task.id, sample=0
        )
        return msgspec.structs.replace(made, episode=episode)

    def learn(self, number: int, draw: Draw, folder: TrainingFolder) -> Mapping[str, Any]:
        folder.weights(number).mkdir(parents=True)
        dropped = {"request too long": 2} if number == 2 else {}
        return {
            "samples": len(draw.steps) - sum(dropped.values()),
            "loss": 1.4 / number,
            "grad_norm": 0.9 / number,
            "dropped": dropped,
        }

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
    world, folder = World(distinct), TrainingFolder(path)
    folder.create(config.model_dump(mode="json"))
    training = Training(
        config,
        folder,
        tasks(count),
        serving=world,
        learner=world,
        replay=Replay(config.learn.replay, make_objective(config.learn.objective)),
        where=ServerChoice(),
        secrets=Secrets(),
        attempts=world.attempts,
    )
    asyncio.run(training.run())
    return path
