"""Judge or policy go away while a training collects: what they cost is made up for, never trained without."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest
from benchmarks.stand_ins import TOKEN
from pydantic import SecretStr
from tests.rollout.running import World, a_world, books
from tests.rollout.stand_in_judge import ADDRESS
from tests.train import test_loop
from tests.train.making import task
from tests.train.test_stops import only
from tests.train.worlds import training_of

from webgym.agent.openai_policy import OpenAIPolicy
from webgym.core.errors import TrainingError
from webgym.core.outcome import Outcome
from webgym.run.config import Secrets
from webgym.train.config import LearnConfig
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.loop import LoopConfig, TrainConfig, make_run

TASKS = [task(f"a{number}") for number in range(6)]


class Served(test_loop.World):
    """Real runs whose policy is an endpoint."""

    def __init__(self, policy: OpenAIPolicy) -> None:
        super().__init__()
        self.policy = policy
        self.attempts: Any = make_run


async def train(world: World, path: Path) -> Served:
    given = world.config(path, 1)
    assert given.policy.chat is not None
    chat = given.policy.chat
    retry = chat.retry.model_copy(update={"tries": 1, "patience_seconds": 0})
    served = Served(OpenAIPolicy(chat.model_copy(update={"retry": retry})))
    settings = TrainConfig(
        learn=LearnConfig(model="m"), rollout=given, loop=LoopConfig(iterations=1, tasks=6, evaluate_every=0)
    )
    training = training_of(path / "out", served, settings, TASKS)
    secrets = Secrets(server_token=SecretStr(TOKEN))
    training.use(given.server, secrets, lambda _row: None)
    async with asyncio.timeout(60):
        await training.run()
    return served


@pytest.mark.parametrize(("away", "lost"), [("judge", Outcome.JUDGE_ERROR), ("model", Outcome.POLICY_ERROR)])
async def test_an_iteration_whose_judge_or_policy_is_away_is_not_learned_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, away: str, lost: Outcome
) -> None:
    folder = TrainingFolder(tmp_path / "out")
    async with a_world() as world:
        monkeypatch.setenv(ADDRESS, world.url("judge"))
        await world.stop(away)
        with pytest.raises(BaseExceptionGroup) as caught:
            await train(world, tmp_path)
        error = only(caught.value)
        assert isinstance(error, TrainingError)
        assert "6 of 6 samples of iterations/0001/run were lost to errors: " in str(error)
        assert "\n" not in str(error)
        assert {each.outcome for each in books(folder.run(1))} == {lost}
        assert folder.stage(1) is Stage.COLLECT

        opened = world.browsers.opened
        await world.start(away)
        served = await train(world, tmp_path)
    assert served.log == ["learn 1 from 18", "publish 1"]
    found = [each for each in books(folder.run(1)) if each.outcome.is_rewarded]
    assert sorted(each.episode.task_id for each in found) == [each.id for each in TASKS]
    assert away == "model" or world.browsers.opened == opened, "what was collected was judged, not made again"
