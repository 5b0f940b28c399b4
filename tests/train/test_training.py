"""A training with everything real but the size: websites, browsers, collector, judge, replay, update."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pytest
from pydantic import SecretStr
from safetensors.torch import load_file

from webgym.agent.policy import Player, Policy, Turn
from webgym.collection import Secrets, all_tasks, services
from webgym.core.errors import PolicyError
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.offline.small.wording import small_vocabulary
from webgym.rollout.store import RunReader
from webgym.tiny.demonstrators import Demonstrators
from webgym.tiny.model import TinyConfig, make_model, save_model
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.learner import Learner
from webgym.train.loop import TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay

pytestmark = pytest.mark.browser


class Faulty:
    """The demonstrators behind an endpoint that fails at three of ten attempts, once each."""

    wants_elements = True

    def __init__(self, share: float) -> None:
        self._policy = Demonstrators()
        self._share = share
        self._failed: set[str] = set()
        self.name = self._policy.name

    def begin(self, task: Task, seed: int) -> Player:
        name = f"{task.id}/{seed}"
        chance = int(hashlib.sha256(name.encode()).hexdigest()[:4], 16) / 0xFFFF
        if chance < self._share and name not in self._failed:
            self._failed.add(name)
            return _Fails()
        return self._policy.begin(task, seed)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        return None


class _Fails:
    async def reply(self, turn: Turn) -> Reply:
        raise PolicyError("injected")


class Serving:
    """Takes weights and replies with the demonstrators all the same."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.published: list[str] = []

    async def publish(self, weights: Path, version: str) -> None:
        assert (weights / "model.safetensors").exists()
        self.published.append(version)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        return None


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tiny") / "tiny"
    save_model(make_model(small_vocabulary(), TinyConfig(width=64, text_layers=1, vision_layers=2)), path)
    return path


def settings(model: Path) -> TrainConfig:
    return TrainConfig.model_validate(
        {
            "learn": {
                "model": str(model),
                "update": {"precision": "fp32", "learning_rate": 1e-3, "batch": 16, "micro_batch": 16},
                "replay": {"steps": 24, "passes": 1},
            },
            "rollout": {
                "sites": {"collection": "small", "latency": 0, "per_family": 5},
                "agent": {"prompt_format": "compact", "rounds": 0, "profile": "tiny"},
                "collector": {"sessions": 3},
            },
            "loop": {"iterations": 1, "tasks": 12, "evaluate_every": 1},
            "evaluation": {"count": 2, "budget": [8, 16, 24]},
        }
    )


async def train(out: Path, config: TrainConfig, policy: Policy) -> tuple[list[dict[str, Any]], Serving]:
    objective, serving, folder = make_objective(config.learn.objective), Serving(policy), TrainingFolder(out)
    async with services(config.rollout, Secrets()) as (where, secrets):
        assert isinstance(secrets.server_token, SecretStr)
        folder.create(config.model_dump(mode="json"))
        training = Training(
            config,
            folder,
            all_tasks(config.rollout),
            serving=serving,
            learner=Learner(config.learn, objective),
            replay=Replay(config.learn.replay, objective),
            where=where,
            secrets=secrets,
        )
        return await training.run(), serving


def rewards(run: Path) -> Mapping[tuple[str, int], str]:
    """How every sample ended, whatever went wrong on the way."""
    trajectories = RunReader(run).trajectories()
    return {
        (each.episode.task_id, each.episode.sample): str(each.outcome)
        for each in trajectories
        if each.outcome.is_rewarded
    }


def test_an_iteration_learns_from_successes_alone_and_faults_change_no_reward(
    tmp_path: Path, model: Path
) -> None:
    config = settings(model)
    rows, serving = asyncio.run(train(tmp_path / "clean", config, Demonstrators()))
    folder = TrainingFolder(tmp_path / "clean")
    (row,) = rows
    assert row["update"]["samples"] == row["replay"]["drawn"] > 0
    assert row["update"]["dropped"] == {}
    assert serving.published == ["1"]
    assert row["evaluation"]["attempts"] == 2
    outcomes = {each.episode.attempt_id: each.outcome for each in RunReader(folder.run(1)).trajectories()}
    assert {outcomes[ref.attempt_id] for ref in folder.batch(1)} == {"success"}
    assert all(task.split == "train" for task in folder.tasks(1))
    before, after = (load_file(path / "model.safetensors") for path in (model, folder.weights(1)))
    assert any((before[name] != after[name]).any() for name in before)

    faulty_rows, _ = asyncio.run(train(tmp_path / "faulty", config, Faulty(0.3)))
    faulty = TrainingFolder(tmp_path / "faulty")
    collected = faulty.figures(1, Stage.COLLECT)
    assert collected["outcomes"]["policy_error"] > 0
    assert rewards(faulty.run(1)) == rewards(folder.run(1))
    assert faulty_rows[0]["collect"]["success_rate"] == row["collect"]["success_rate"]
