"""What a training talks to in tests: made-up attempts in real runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from webgym.agent.policy import BasePolicy, Policy
from webgym.agent.scripted import RandomPolicy
from webgym.core.task import Task
from webgym.core.trajectory import Trajectory
from webgym.results.summary import Summary, summarise
from webgym.rollout.sessions import Places
from webgym.run.config import RunConfig, Secrets, ServerChoice
from webgym.store.runs import RunReader, RunWriter
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay
from webgym.train.serving import Serving
from webgym.train.stopping import Stop


class Copy(BasePolicy):
    """A copy of the model, with weights of its own; it is known by them."""

    def __init__(self) -> None:
        self.policy: Policy = self
        self.name = "0"

    def copy(self) -> None:
        raise AssertionError("nobody copies a copy")

    async def publish(self, weights: Path, version: str) -> None:
        assert (weights / "state.json").exists(), "weights that are evaluated stay"
        self.name = version

    async def watch(self) -> None:
        raise AssertionError("nobody watches a copy")


class MadeUp(BasePolicy):
    """Makes attempts; whoever inherits says which, serves and learns.

    Attributes:
        policy: by name alone.
        pictures: that the attempts show, by name.
    """

    def __init__(self) -> None:
        self.policy: Policy = RandomPolicy()
        self.pictures: Mapping[str, bytes] = {}

    def attempt(self, run: Path, task: Task, number: int, seed: int) -> Trajectory:
        """An attempt of a run of this seed, at its task of this number."""
        raise NotImplementedError

    async def before(self, run: Path, number: int, tasks: int, places: Places | None) -> None:
        """Called before each attempt of a run."""

    def copy(self) -> Serving | None:
        """Evaluations have a policy of their own."""
        return Copy()

    async def attempts(
        self,
        out: Path,
        config: RunConfig,
        tasks: Sequence[Task],
        policy: Policy,
        secrets: Secrets,
        show: object,
        places: Places | None,
    ) -> Summary:
        is_there = (out / "config.yaml").exists()
        made_with = config.model_dump(mode="json")
        writer = await (RunWriter.reopen(out) if is_there else RunWriter.create(out, made_with, list(tasks)))
        async with writer:
            for number, each in enumerate(tasks):
                if f"{each.id}#0.0" in writer.attempts:
                    continue
                await self.before(out, number, len(tasks), places)
                made = self.attempt(out, each, number, config.seed)
                for name, data in self.pictures.items():
                    await writer.put_image(name, data)
                for sample in range(config.samples):  # all alike
                    id = f"{each.id}#{sample}.0"
                    episode = msgspec.structs.replace(made.episode, attempt_id=id, sample=sample)
                    await writer.append(msgspec.structs.replace(made, episode=episode))
            found = summarise(RunReader(out).trajectories(), list(tasks), config.samples, seed=config.seed)
            await writer.write_summary(found)
        return found


def training_of(
    path: Path, world: Any, settings: TrainConfig, tasks: Sequence[Task], stop: Stop | None = None
) -> Training:
    """A training that talks to this world alone."""
    return Training(
        settings,
        TrainingFolder(path),
        tasks,
        serving=world,
        learner=world,
        replay=Replay(settings.learn.replay, make_objective(settings.learn.objective), seed=settings.seed),
        where=ServerChoice(),
        secrets=Secrets(),
        stop=stop,
        attempts=world.attempts,
    )
