"""How much of collection, updates and evaluations goes on at the same time: work over wall time.

    PYTHONPATH=. python benchmarks/overlap.py             # the loop alone: every stage only sleeps
    PYTHONPATH=. python benchmarks/overlap.py --browsers  # real runs in real browsers

Work is what each part needs alone: the seconds of updates and, of attempts, their seconds in a session over
the number of sessions. So 1 is one after the other without a pause, and 2 is the most that collection and
updates of equal length can reach. Updates sleep as long as a collection needs, as they would on a GPU. The
policy demonstrates solutions, and its replies sleep: each attempt at a pace of its own, so that there are
stragglers.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

from tests.train.making import PICTURES, task, trajectory
from tests.train.worlds import MadeUp

from webgym.agent.policy import BasePolicy, Policy, PolicyInput, PolicySession
from webgym.core.task import Task
from webgym.core.trajectory import Reply, Trajectory
from webgym.results.summary import Summary
from webgym.rollout.sessions import Places
from webgym.run.choice import all_tasks
from webgym.run.config import RunConfig, Secrets, ServerChoice
from webgym.run.services import services
from webgym.store.runs import RunReader
from webgym.study.demonstrators import Demonstrators
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay, ReplaySample


class Sleeps(MadeUp):
    """Learns by sleeping, and replies so with the demonstrators' replies; ignores published weights.

    Args:
        update: seconds of an update.
        think: mean seconds of a reply.
    """

    name = "demonstrators"
    wants_elements = True

    def __init__(self, update: float, think: float) -> None:
        super().__init__()
        self.policy: Policy = self
        self._update, self._think = update, think
        self.pictures = PICTURES
        self._demonstrators = Demonstrators()

    def begin(self, task: Task, seed: int) -> PolicySession:
        pace = random.Random(seed).lognormvariate(-0.5 * 0.7**2, 0.7)  # of mean 1
        return _Player(self._demonstrators.begin(task, seed), self._think * pace)

    def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        time.sleep(self._update)
        folder.weights(number).mkdir(parents=True, exist_ok=True)
        (folder.weights(number) / "state.json").write_text("{}")
        return {"samples": len(draw.steps), "loss": 0.0, "seconds": self._update}

    def copy(self) -> Sleeps:
        return Sleeps(self._update, self._think)

    async def publish(self, weights: Path, version: str) -> None:
        pass

    async def watch(self) -> None:
        await asyncio.get_running_loop().create_future()

    def attempt(self, run: Path, task: Task, number: int, seed: int) -> Trajectory:  # noqa: ARG002
        return trajectory(0, of=task.id.removeprefix("t/"))

    async def sleep_and_make_up(
        self,
        out: Path,
        config: RunConfig,
        tasks: Sequence[Task],
        policy: Policy,
        secrets: Secrets,
        show: object,
        places: Places | None,
    ) -> Summary:
        """A run that takes as long as an update, and then leaves made-up attempts."""
        await asyncio.sleep(self._update)
        if places is not None:
            places.spare.set()
        return await self.attempts(out, config, tasks, policy, secrets, show, places)


class _Player(BasePolicy):
    def __init__(self, player: PolicySession, seconds: float) -> None:
        self._player, self._seconds = player, seconds

    async def reply(self, turn: PolicyInput) -> Reply:
        await asyncio.sleep(self._seconds)
        return await self._player.reply(turn)


def settings(options: argparse.Namespace, staleness: int, every: int, iterations: int) -> TrainConfig:
    return TrainConfig.model_validate(
        {
            "learn": {"model": "tiny", "replay": {"steps": 64, "max_uses": None}},
            "rollout": {
                "sites": {"collection": "small", "latency": 0, "per_family": 5},
                "agent": {"prompt_format": "compact", "rounds": 0, "profile": "tiny"},
                "collector": {"sessions": options.sessions},
            },
            "loop": {
                "iterations": iterations,
                "tasks": options.tasks,
                "evaluate_every": every,
                "staleness": staleness,
            },
            "evaluation": {"count": options.tasks, "budget": [15, 30, 45]},
        }
    )


async def measure(
    config: TrainConfig, options: argparse.Namespace, folder: Path, update: float
) -> tuple[float, float, float, float]:
    """Wall time, and the work of collections, updates and evaluations, in seconds."""
    world, slept = Sleeps(update, options.think), not options.browsers
    names = [f"{number}" for number in range(options.tasks)]
    tasks = [task(f"{split}{name}", split) for split in ("train", "test") for name in names]
    async with AsyncExitStack() as stack:
        where, secrets = ServerChoice(), Secrets()
        if options.browsers:
            where, secrets = await stack.enter_async_context(services(config.rollout, secrets))
        training = Training(
            config,
            TrainingFolder(folder),
            tasks if slept else all_tasks(config.rollout),
            serving=world,
            learner=world,
            replay=Replay(config.learn.replay, make_objective(config.learn.objective)),
            where=where,
            secrets=secrets,
            attempts=world.sleep_and_make_up if slept else None,
        )
        training.folder.create(config.model_dump(mode="json"))
        started = time.monotonic()
        await training.run()
        wall = time.monotonic() - started
    collected, evaluated = await asyncio.to_thread(_work, folder, options, update)
    return wall, collected, update * config.loop.iterations, evaluated


def _work(folder: Path, options: argparse.Namespace, update: float) -> list[float]:
    """The seconds that iterations and evaluations would keep all sessions busy."""
    work = [0.0, 0.0]
    for kind, pattern in enumerate(("iterations/*/run", "evaluations/*/")):
        for run in folder.glob(pattern):
            ended = RunReader(run).trajectories()
            busy = sum(each.episode.seconds for each in ended) / options.sessions
            work[kind] += busy if options.browsers else update
    return work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--browsers", action="store_true")
    parser.add_argument("--iterations", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=2.0, help="of a stage that only sleeps")
    parser.add_argument("--tasks", type=int, default=24, help="tasks of an iteration, and of an evaluation")
    parser.add_argument("--think", type=float, default=0.5, help="mean time of a reply, seconds")
    parser.add_argument("--sessions", type=int, default=8)
    parser.add_argument("--staleness", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--every", type=int, nargs="+", default=[0, 5], help="iterations per evaluation")
    options = parser.parse_args()
    update = options.seconds
    with tempfile.TemporaryDirectory() as folder:
        if options.browsers:  # how long a collection takes by itself
            alone = Path(folder, "alone")
            asyncio.run(measure(settings(options, 0, 0, 4), options, alone, 0.0))
            shutil.rmtree(alone / "iterations/0001")  # the first is longer: browsers start
            update = _work(alone, options, 0.0)[0] / 3
        print(f"{options.iterations} iterations, updates of {update:.1f} s")
        print("| staleness | evaluations | wall s | collecting s | updating s | evaluating s | work / wall |")
        print("|---|---|---|---|---|---|---|")
        for staleness in options.staleness:
            for every in options.every:
                config = settings(options, staleness, every, options.iterations)
                wall, *work = asyncio.run(
                    measure(config, options, Path(folder, f"{staleness}-{every}"), update)
                )
                row = [staleness, every, f"{wall:.1f}", *(f"{each:.1f}" for each in work)]
                print("|", *(f"{each} |" for each in [*row, f"{sum(work) / wall:.2f}"]), flush=True)


if __name__ == "__main__":
    main()
