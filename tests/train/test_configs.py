"""Settings and the presets that come with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from webgym.settings import merged
from webgym.train.config import LearnConfig
from webgym.train.loop import TrainConfig
from webgym.train.objectives import GroupIS, make_objective

CONFIGS = Path(__file__).parents[2] / "configs"


def read(name: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((CONFIGS / name).read_text())
    return found


def test_defaults_are_the_papers() -> None:
    config = LearnConfig(model="m")
    assert (config.replay.iterations, config.replay.recency, config.replay.steps) == (4, 2.0, 1800)
    assert (config.replay.passes, config.objective.name) == (2, "filtered_bc")
    update = config.update
    assert (update.learning_rate, update.batch, update.max_grad_norm) == (1e-6, 192, 1.0)
    assert (update.weight_decay, update.warmup_steps, update.schedule) == (0.01, 30, "constant")
    assert (update.cutoff_tokens, update.precision, update.gradient_checkpointing) == (16384, "bf16", False)


def test_the_preset_of_groups_is_asyncwebrls() -> None:
    whole = TrainConfig.model_validate(merged({"learn": {"model": "m"}}, read("train/group-is.yaml")))
    config = whole.learn
    assert whole.rollout.samples == 8
    assert make_objective(config.objective) == GroupIS()
    assert config.update.learning_rate == 5e-6
    assert config.replay.iterations == GroupIS().staleness + 1


@pytest.mark.parametrize("name", ["ddp", "fsdp2"])
def test_launch_settings_are_ones_that_accelerate_reads(name: str) -> None:
    from accelerate.commands.config.config_args import load_config_from_file

    config = load_config_from_file(str(CONFIGS / "accelerate" / f"{name}.yaml"))
    assert config.mixed_precision == "no"
    assert config.num_processes == 8


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"replay": {"recensy": 1}}, "recensy"),
        ({"replay": {"passes": 3, "max_uses": 2}}, "max_uses"),
        ({"update": {"schedule": "cosine"}}, "total_steps"),
        ({"update": {"learning_rate": 0}}, "learning_rate"),
        ({"frontier": {"prior": [0, 1]}}, "prior"),
    ],
)
def test_what_makes_no_sense_is_refused(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        LearnConfig.model_validate({"model": "m"} | settings)
