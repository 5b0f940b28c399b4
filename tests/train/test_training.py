"""A training with everything real but the size: websites, browsers, collector, judge, replay, update."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from contextvars import ContextVar
from itertools import cycle, zip_longest
from pathlib import Path
from typing import Any, cast

import pytest
from safetensors.torch import load_file

from webgym.agent.policy import BasePolicy, Policy, PolicyInput, PolicySession
from webgym.core.errors import BrowserCrashed, JudgeError, PolicyError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Reply
from webgym.judge.offline import OfflineJudge
from webgym.offline.small import small_vocabulary
from webgym.rollout.attempt import Attempt
from webgym.rollout.trackers import numbers_in
from webgym.run.choice import all_tasks
from webgym.run.config import Secrets, ServerChoice
from webgym.run.services import services
from webgym.server.client import Session
from webgym.store.runs import RunReader
from webgym.study.demonstrators import Demonstrators
from webgym.study.model import TinyConfig, make_model, save_model
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay
from webgym.train.update import Learner

pytestmark = pytest.mark.browser


FAULT: ContextVar[str] = ContextVar("fault", default="")
"""What goes wrong in the attempt that is being made."""

RECORDED = """
    trajectories collect/attempts collect/outcomes/success collect/success_rate/overall
    collect/success_rate_of_planned/overall collect/success_interval/overall/low
    collect/success_interval_of_planned/overall/high collect/steps collect/steps_per_trajectory
    collect/unchanged_share collect/unreadable_share collect/steps_of_successes collect/steps_of_failures
    collect/reply_characters collect/reply_tokens collect/blocked_share
    replay/drawn replay/counts/unrewarded replay/counts/left_out replay/counts/unchanged replay/used_up
    replay/stale update/samples update/optimizer_steps update/loss update/grad_norm update/learning_rate
    update/tokens_per_second update/extra/entropy update/extra/logprob update/extra/kl_start
    replay/earlier_uses replay/advantages/mean_size
    seconds/collect seconds/replay seconds/update seconds/publish seconds/evaluate
    evaluation/success_rate/overall evaluation/success_interval/overall/high
""".split()
"""Numbers that every iteration leaves in metrics.jsonl."""

OUTCOMES = {
    "policy": Outcome.POLICY_ERROR,
    "browser": Outcome.ENVIRONMENT_ERROR,
    "judge": Outcome.JUDGE_ERROR,
}


class Breakable(BasePolicy):
    """The demonstrators behind an endpoint that fails where it is to."""

    wants_elements = True

    def __init__(self) -> None:
        self._policy = Demonstrators()
        self.name = self._policy.name

    def begin(self, task: Task, seed: int) -> PolicySession:
        return _Player(self._policy.begin(task, seed))


class _Player:
    def __init__(self, player: PolicySession) -> None:
        self._player = player

    async def reply(self, turn: PolicyInput) -> Reply:
        if FAULT.get() == "policy" and turn.index:
            raise PolicyError("injected")
        return await self._player.reply(turn)


class _Breaks:
    """A browser session that is gone after its first step."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._steps = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    async def step(self, action: Any) -> Any:
        self._steps += 1
        if self._steps > 1:
            raise BrowserCrashed("injected")
        return await self._session.step(action)


def inject(faults: Mapping[str, str], patch: pytest.MonkeyPatch) -> None:
    """Let these attempts go wrong, each in its way."""
    run, judge = Attempt.run, OfflineJudge.judge

    async def broken_run(self: Attempt, session: Session) -> None:
        fault = faults.get(self.planned.attempt_id, "")
        before = FAULT.set(fault)
        try:
            await run(self, cast(Session, _Breaks(session)) if fault == "browser" else session)
        finally:
            FAULT.reset(before)

    async def broken_judge(self: OfflineJudge, task: Task, episode: Episode, pictures: Any) -> Any:
        if faults.get(episode.attempt_id) == "judge":
            raise JudgeError("injected")
        return await judge(self, task, episode, pictures)

    patch.setattr(Attempt, "run", broken_run)
    patch.setattr(OfflineJudge, "judge", broken_judge)


class Serving(BasePolicy):
    """Takes weights and replies with the demonstrators all the same."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.published: list[str] = []

    def copy(self) -> None:
        return None

    async def publish(self, weights: Path, version: str) -> None:
        assert (weights / "model.safetensors").exists()
        self.published.append(version)

    async def watch(self) -> None:
        await asyncio.get_running_loop().create_future()


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
            "loop": {"iterations": 1, "tasks": 8, "evaluate_every": 1},
            "evaluation": {"count": 2, "budget": [8, 16, 24]},
        }
    )


async def train(
    out: Path, config: TrainConfig, where: ServerChoice, secrets: Secrets
) -> tuple[list[dict[str, Any]], Serving]:
    objective, serving = make_objective(config.learn.objective), Serving(Breakable())
    folder = TrainingFolder(out)
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


def outcomes(folder: TrainingFolder) -> dict[str, Outcome]:
    """How every attempt of the first iteration ended."""
    return {each.episode.attempt_id: each.outcome for each in RunReader(folder.run(1)).trajectories()}


def rewards(found: Mapping[str, Outcome]) -> dict[str, Outcome]:
    """How every sample was rewarded, whatever went wrong on the way."""
    return {name.rpartition(".")[0]: each for name, each in found.items() if each.is_rewarded}


def to_break(folder: TrainingFolder) -> dict[str, str]:
    """30 % of the attempts, successes and failures by turns, and the three faults by turns.

    None is over before its browser breaks.
    """
    found = outcomes(folder)
    runs = RunReader(folder.run(1)).trajectories()
    long = sorted(each.episode.attempt_id for each in runs if len(each.episode.steps) > 2)
    won = [name for name in long if found[name] is Outcome.SUCCESS]
    lost = [name for name in long if found[name] is not Outcome.SUCCESS]
    by_turns = [name for pair in zip_longest(won, lost) for name in pair if name]
    count = math.ceil(0.3 * len(found))
    return dict(zip(by_turns[:count], cycle(OUTCOMES), strict=False))


def test_an_iteration_learns_from_successes_alone_and_faults_never_become_gradients(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = settings(model)
    clean, faulty = TrainingFolder(tmp_path / "clean"), TrainingFolder(tmp_path / "faulty")
    faults: dict[str, str] = {}

    async def both() -> Any:
        async with services(config.rollout, Secrets()) as reached:
            first = await train(clean.path, config, *reached)
            faults.update(to_break(clean))
            inject(faults, monkeypatch)
            loop = config.loop.model_copy(update={"evaluate_every": 0})
            again = config.model_copy(update={"loop": loop})
            return *first, *await train(faulty.path, again, *reached)

    (row,), serving, (faulty_row,), _ = asyncio.run(both())

    assert set(RECORDED) <= dict(numbers_in(row)).keys()
    assert set(row["collect"]["success_rate"]) == {"overall", "easy", "medium", "hard"}
    assert row["update"]["samples"] == row["replay"]["drawn"] > 0
    assert row["update"]["dropped"] == {}
    assert serving.published == ["1"]
    assert row["evaluation"]["attempts"] == 2
    found = outcomes(clean)
    assert {found[ref.attempt_id] for ref in clean.batch(1)} == {Outcome.SUCCESS}
    assert all(task.split == "train" for task in clean.tasks(1))
    before, after = (load_file(path / "model.safetensors") for path in (model, clean.weights(1)))
    assert any((before[name] != after[name]).any() for name in before)

    with_faults = outcomes(faulty)
    assert set(faults.values()) == set(OUTCOMES)
    assert {found[name] is Outcome.SUCCESS for name in faults} == {True, False}
    # What went wrong has no reward, neither 0 nor 1; browser and policy get another try.
    assert {name: with_faults[name] for name in faults} == {n: OUTCOMES[kind] for n, kind in faults.items()}
    unjudged = {name.rpartition(".")[0] for name, kind in faults.items() if kind == "judge"}
    expected = {name: each for name, each in rewards(found).items() if name not in unjudged}
    assert rewards(with_faults) == expected
    won = sum(each is Outcome.SUCCESS for each in expected.values())
    assert faulty_row["collect"]["success_rate"]["overall"] == won / len(expected)
    # No step of a faulty attempt is trained on, and all others that would have been are.
    trained = {ref.attempt_id for ref in faulty.batch(1)}
    assert trained.isdisjoint(faults)
    assert {with_faults[name] for name in trained} == {Outcome.SUCCESS}
    counts = faulty_row["replay"]["counts"]
    assert (counts["unrewarded"], counts["kept"]) == (len(faults), won)
