"""A warm start from stored runs."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tests.inference.tiny import tiny_renderer, write_tiny_model
from tests.train.making import Made, sample, stored, task, trajectory
from tests.train.updating import learning

from webgym.core.errors import ConfigError, TrainingError
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Reply
from webgym.inference.model import load_model
from webgym.train.logprobs import ReplyLogProbs, collate
from webgym.train.loop import TrainConfig
from webgym.train.start import warm_start

TESTED = task("tested", split="test")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_model(tmp_path_factory.mktemp("model"))


@pytest.fixture(autouse=True)
def short_self_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.train.update.REPLY_TOKENS", 2)


def training(model: Path) -> TrainConfig:
    given = learning(model).model_dump() | {"replay": {"passes": 8, "max_uses": None}}
    return TrainConfig.model_validate({"learn": given})


def likelihood(folder: str | Path, reply: str) -> float:
    loaded = load_model(folder)
    batch = collate([sample(loaded.renderer, reply)], loaded.renderer, off_policy=False)
    with torch.no_grad():
        return float(ReplyLogProbs(loaded.model, 100)(batch).mean())


def test_the_successes_of_runs_are_learned_and_the_training_starts_from_there(
    model: Path, tmp_path: Path
) -> None:
    foreign = stored(tiny_renderer(), "click there", prompt_ids=[1, 2, 3])  # tokens of another model
    first = Made([trajectory(0, reply=Reply("the way", "p"))]).write(tmp_path / "first")
    failure = trajectory(1, outcome=Outcome.FAILURE, reply=Reply("no", "p"))
    second = Made([trajectory(0, reply=foreign), failure]).write(tmp_path / "second")
    told: list[str] = []
    config, folder = training(model), tmp_path / "out-start"

    new = warm_start(config, [first.path, second.path], [TESTED], folder, told.append)

    assert new.learn.model == str(folder)
    assert new.local is not None
    assert new.local.path == str(folder)
    assert "6 steps x 8" in told[0]
    for reply in ("the way", "click there"):
        assert likelihood(folder, reply) > likelihood(model, reply) + 0.3
    again = warm_start(config, [tmp_path / "nowhere"], [TESTED], folder, told.append)
    assert (again, len(told)) == (new, 1), "what an earlier start made is used"


def test_a_run_with_test_tasks_or_without_successes_starts_nothing(model: Path, tmp_path: Path) -> None:
    config, folder = training(model), tmp_path / "out-start"
    tested = Made([trajectory(of="tested")], [TESTED]).write(tmp_path / "tested")
    with pytest.raises(ConfigError, match="t/tested is a test task"):
        warm_start(config, [tested.path], [], folder, print)
    unsplit = Made([trajectory(of="tested")], [task("tested", split=None)]).write(tmp_path / "unsplit")
    with pytest.raises(ConfigError, match="must not be trained on"):
        warm_start(config, [unsplit.path], [TESTED], folder, print)
    failed = Made([trajectory(outcome=Outcome.FAILURE)]).write(tmp_path / "failed")
    with pytest.raises(TrainingError, match="nothing to start from"):
        warm_start(config, [failed.path], [TESTED], folder, print)
    assert not folder.exists()
