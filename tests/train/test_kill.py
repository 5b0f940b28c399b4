"""A training that is killed at random ends as one that was left alone: the same attempts and weights."""

from __future__ import annotations

import copy
import json
import signal
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from safetensors.torch import load_file
from tests.conftest import wait_until
from tests.inference.tiny import write_tiny_model
from tests.train.forking import process
from tests.train.trains_until_killed import main

from webgym.cli import main as webgym
from webgym.offline.small import small_vocabulary
from webgym.run.config import read_config
from webgym.store.runs import RunReader
from webgym.study.model import TinyConfig, make_model, save_model
from webgym.train.folder import TRAINING, TrainingFolder

GIVEN: dict[str, Any] = {
    "learn": {
        "replay": {"steps": 8, "passes": 1},
        "update": {"precision": "fp32", "learning_rate": 1e-3, "batch": 4, "micro_batch": 4},
    },
    "rollout": {
        "sites": {"collection": "small", "per_family": 4},
        "server": {"static": True},
        "agent": {"profile": "tiny", "prompt_format": "compact", "rounds": 0},
        "attempt": {"budget_easy": 4},
    },
    "sampler": {"ratio": {"easy": 1}},
    "loop": {"iterations": 2, "tasks": 4, "evaluate_every": 1},
    "evaluation": {"count": 2, "budget": [2, 2, 2]},
}
"""Settings of a training as small as it can be."""

SLOW = [pytest.mark.slow, pytest.mark.browser, pytest.mark.timeout(1800)]


def left(path: Path) -> dict[str, Any]:
    """What a training left, but for what the clock says."""
    folder = TrainingFolder(path)
    found: dict[str, Any] = {}
    for run in sorted(path.glob("iterations/*/run")) + sorted(path.glob("evaluations/*/")):
        reader = RunReader(run)
        found[str(run.relative_to(path))] = sorted(
            (each.episode.attempt_id, str(each.outcome), [step.reply.text for step in each.episode.steps])
            for each in reader.trajectories()
        )
    for number in (1, 2, 3):
        found[f"batch {number}"] = folder.batch(number)
    rows = [json.loads(line) for line in (path / "metrics.jsonl").read_bytes().splitlines()]
    found["rows"] = [
        (row["trajectories"], row["collect"]["outcomes"], row["update"]["loss"], row["update"]["samples"])
        for row in rows
    ]
    return found


def command(words: list[str], log: Path) -> None:
    """``webgym`` in a process of its own, which prints to a file."""
    with log.open("w") as sys.stdout:
        webgym(words)


def trained(log: Path, *words: object, until: Path | None = None) -> str:
    """What ``webgym train`` printed until it ended, or was killed when this file was there."""
    life = process(command, ["train", *map(str, words)], log)
    life.start()
    if until is not None:
        wait_until(lambda: until.exists() or not life.is_alive(), 100)
        life.kill()
    life.join()
    assert life.exitcode == (0 if until is None else -signal.SIGKILL), log.read_text()
    return log.read_text()


def conditions(run: Path) -> dict[str, Any]:
    """How the attempts of a run were made, but for their seed."""
    reader = RunReader(run)
    steps = [step for each in reader.trajectories() for step in each.episode.steps]
    (sampling,) = {json.dumps(step.reply.sampling, sort_keys=True) for step in steps}
    return read_config(reader)[0].model_dump(exclude={"seed": True}) | {"sampling": sampling}


@pytest.mark.browser
@pytest.mark.timeout(240)  # three commands that load torch and a model, beside others that do
def test_the_command_goes_on_with_the_training_that_it_began(tmp_path: Path) -> None:
    """``webgym train`` with its own model, as its settings file has it; only pages need no browser."""
    given, out, log = tmp_path / "train.yaml", tmp_path / "training", tmp_path / "log"
    settings = copy.deepcopy(GIVEN)
    settings["learn"]["model"] = str(files("webgym.study") / "weights")
    settings["rollout"]["server"]["pictures"] = str(tmp_path / "pictures")
    given.write_text(yaml.safe_dump(settings))
    folder = TrainingFolder(out)

    trained(log, given, "--out", out, until=folder.iteration(1) / "collected.json")

    stored = (out / "config.yaml").read_bytes()
    before = [RunReader(run).attempts for run in (folder.evaluation(0), folder.run(1))]
    assert folder.stage(1) is not None
    assert not folder.is_evaluated(1)

    trained(log, "--resume", out)

    assert (out / "config.yaml").read_bytes() == stored
    assert [RunReader(run).attempts for run in (folder.evaluation(0), folder.run(1))] == before
    collected = [conditions(folder.run(number)) for number in (1, 2)]
    evaluated = [conditions(folder.evaluation(number)) for number in (0, 1, 2)]
    assert collected[0] == collected[1]
    assert evaluated[0] == evaluated[1] == evaluated[2]
    assert evaluated[0]["sampling"] == collected[0]["sampling"]
    tasks = [RunReader(folder.evaluation(number)).drawn for number in (0, 1, 2)]
    assert tasks[0] == tasks[1] == tasks[2] != []
    rows = [json.loads(line) for line in (out / "metrics.jsonl").read_bytes().splitlines()]
    assert [(row["iteration"], row["evaluation"]["attempts"]) for row in rows] == [(1, 2), (2, 2)]

    printed = trained(log, "--resume", out).splitlines()

    assert printed == [
        f"the training is complete: all iterations (2); for more, raise loop.iterations in {out}/config.yaml",
        f"report   {out}/report.html",
    ]


@pytest.mark.parametrize(
    ("kills", "browsers", "staleness"),
    [
        pytest.param(3, False, 0, id="made-up"),
        pytest.param(4, False, 2, id="made-up, side by side"),
        pytest.param(10, True, 0, id="browsers", marks=SLOW),
    ],
)
def test_a_training_that_is_killed_at_random_ends_like_one_that_was_not(
    tmp_path: Path, kills: int, browsers: bool, staleness: int
) -> None:
    model = tmp_path / "model"
    if browsers:
        save_model(
            make_model(small_vocabulary(), TinyConfig(width=64, text_layers=1, vision_layers=2)), model
        )
    else:
        write_tiny_model(model)
    lives = process(main, tmp_path, model, kills, 7, browsers, staleness)
    lives.start()
    lives.join()
    assert lives.exitcode == 0
    assert int((tmp_path / "kills").read_text()) == kills, "killed as often as it was to be"
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert left(killed) == left(whole)
    assert not list(killed.rglob("*.tmp")), "nothing torn is left"
    for name in ("model.safetensors", f"{TRAINING}/shard-00001-model-00001-of-00001.safetensors"):
        one, other = (load_file(TrainingFolder(path).weights(3) / name) for path in (whole, killed))
        assert one.keys() == other.keys()
        assert all(torch.equal(value, other[key]) for key, value in one.items())
