"""A training that is killed at random ends as one that was left alone: the same attempts and weights."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file
from tests.inference.tiny import write_tiny_model
from tests.train.forking import process
from tests.train.trains_until_killed import main

from webgym.offline.small.wording import small_vocabulary
from webgym.rollout.store import RunReader
from webgym.tiny.model import TinyConfig, make_model, save_model
from webgym.train.folder import TrainingFolder
from webgym.train.weights import read_optimizer

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


@pytest.mark.parametrize(
    ("kills", "browsers"),
    [
        pytest.param(3, False, id="made-up"),
        pytest.param(10, True, id="browsers", marks=SLOW),
    ],
)
def test_a_training_that_is_killed_at_random_ends_like_one_that_was_not(
    tmp_path: Path, kills: int, browsers: bool
) -> None:
    model = tmp_path / "model"
    if browsers:
        save_model(
            make_model(small_vocabulary(), TinyConfig(width=64, text_layers=1, vision_layers=2)), model
        )
    else:
        write_tiny_model(model)
    lives = process(main, tmp_path, model, kills, 7, browsers)
    lives.start()
    lives.join()
    assert lives.exitcode == 0
    assert int((tmp_path / "kills").read_text()) == kills, "killed as often as it was to be"
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert left(killed) == left(whole)
    assert not list(killed.rglob("*.tmp")), "nothing torn is left"
    one, other = (
        load_file(TrainingFolder(path).weights(3) / "model.safetensors") for path in (whole, killed)
    )
    assert one.keys() == other.keys()
    assert all(torch.equal(value, other[name]) for name, value in one.items())
    states = [read_optimizer(TrainingFolder(path).weights(3))["state"] for path in (whole, killed)]
    for name, state in states[0].items():
        assert all(torch.equal(value, states[1][name][key]) for key, value in state.items())
