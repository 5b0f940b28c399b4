"""Estimates against what can be counted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from tests.inference.tiny import tiny_model, write_tiny_model
from tests.train.forking import together
from tests.train.measuring import KEPT, RECOMPUTED, WORK, measure, shapes

from webgym.core.errors import ConfigError
from webgym.train.config import LearnConfig
from webgym.train.estimate import (
    GIB,
    KNOWN_GPUS,
    Gpus,
    Workload,
    estimate,
    model_flops,
    peak_flops,
    present_gpus,
    shapes_from,
    shapes_of,
)
from webgym.train.start import load_train_config
from webgym.train.weights import load_trainable

H100 = KNOWN_GPUS["h100"]
LORA = {"update": {"lora": {"rank": 32}, "weights": "bfloat16"}}


def settings(model: object = "Qwen/Qwen3-VL-8B-Instruct", **others: object) -> LearnConfig:
    return LearnConfig.model_validate({"model": str(model), **others})


def test_weights_are_counted_as_the_model_has_them(tmp_path: Path) -> None:
    folder = write_tiny_model(tmp_path / "model")
    config = settings(folder, update={"lora": {"rank": 4}})
    found = estimate(config, H100)
    assert found.parameters == sum(each.numel() for each in tiny_model().parameters())
    policy = load_trainable(config.update, folder, None).model
    assert found.trained == sum(each.numel() for each in policy.parameters() if each.requires_grad)


def test_the_papers_model_needs_no_download_and_has_its_size() -> None:
    found = shapes_of("Qwen/Qwen3-VL-8B-Instruct")
    assert found.parameters == pytest.approx(8.77e9, rel=0.01)
    assert found.vision.parameters == pytest.approx(0.58e9, rel=0.02)


def test_memory_and_time_follow_from_settings() -> None:
    full = estimate(settings(), H100)
    assert not full.fits  # 16 bytes a weight
    assert full.memory["optimizer"] == 2 * full.memory["gradients"] == 2 * full.memory["weights"]
    eight = estimate(settings(), replace(H100, count=8))
    assert eight.memory["weights"] == full.memory["weights"] / 8
    assert eight.seconds == pytest.approx(full.seconds / 8)

    lora = estimate(settings(**LORA), H100)
    assert lora.memory["weights"] == full.memory["weights"] / 2
    assert lora.memory["optimizer"] < GIB
    assert 0.5 * full.flops < lora.flops < 0.75 * full.flops  # no gradients of frozen weights

    short = Workload(pictures=1, text_tokens=500)
    assert estimate(settings(), H100, short).seconds < full.seconds / 3


def test_the_8b_preset_fits_eight_h100_beside_the_model_that_replies() -> None:
    preset = load_train_config([Path(__file__).parents[2] / "configs/train/qwen3-vl-8b.yaml"])
    found = estimate(preset.learn, replace(H100, count=8), local=preset.local)
    assert found.memory["local model"] == 2 * found.parameters
    assert found.fits


UNTIED = {"vocabulary": 2048, "tied": False}
TIED = {"vocabulary": 8192, "tied": True}
MEASURED = [
    pytest.param([(RECOMPUTED, UNTIED)], id="as the preset"),
    pytest.param([(KEPT, UNTIED), (RECOMPUTED, TIED)], id="others", marks=pytest.mark.slow),
]


@pytest.mark.timeout(600)  # two processes, beside others
@pytest.mark.parametrize("cases", MEASURED)
def test_memory_is_what_processes_of_fsdp_allocate(
    tmp_path: Path, cases: list[tuple[dict[str, Any], dict[str, Any]]]
) -> None:
    together(measure, 2, tmp_path / "measured.json", cases)
    for (update, kind), measured in zip(
        cases, json.loads((tmp_path / "measured.json").read_text()), strict=True
    ):
        cutoff = {"cutoff_tokens": WORK.text_tokens + WORK.pictures * 8 + WORK.reply_tokens}
        config = LearnConfig.model_validate({"model": "m", "update": update | cutoff})
        found = estimate(config, Gpus(count=2), WORK, shapes_from(shapes(**kind))).memory
        assert found["weights"] == pytest.approx(measured["weights"], rel=0.01)
        assert found["optimizer"] == pytest.approx(measured["optimizer"], rel=0.01)
        assert sum(found.values()) == pytest.approx(sum(measured.values()), rel=0.1)


def test_gpus_that_are_present_are_those_of_the_launch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert present_gpus() is None
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda _: SimpleNamespace(total_memory=80 * GIB))
    assert present_gpus() == Gpus(count=1, memory_gib=80, sharded=False)
    monkeypatch.setenv("WORLD_SIZE", "8")
    monkeypatch.setenv("ACCELERATE_USE_FSDP", "true")
    assert present_gpus() == Gpus(count=8, memory_gib=80, sharded=True)
    monkeypatch.setenv("ACCELERATE_USE_DEEPSPEED", "true")
    assert present_gpus() is None


def test_the_peak_is_that_of_a_known_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert peak_flops() is None
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "NVIDIA H200")
    monkeypatch.setenv("WORLD_SIZE", "8")
    assert peak_flops() == 8 * 989e12
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "NVIDIA GeForce RTX 3090")
    assert peak_flops() is None


def test_the_operations_of_an_update_are_six_for_each_weight_and_token() -> None:
    size, tokens, patches = shapes_of("Qwen/Qwen3-VL-8B-Instruct"), 1000, 400
    everything = model_flops(size, settings().update, tokens, tokens, patches)
    language = size.text.parameters + size.embeddings / 2
    assert everything == 6 * (language * tokens + size.vision.parameters * patches)
    adapters = model_flops(size, settings(**LORA).update, tokens, tokens, patches)
    assert adapters == 4 * language * tokens + 2 * size.vision.parameters * patches


def test_whole_trajectories_and_mini_batches_are_estimated() -> None:
    replay = {"steps": None, "trajectories": 128, "passes": 3}
    found = estimate(settings(replay=replay | {"max_uses": 3}, update={"minibatches": 2}), H100)
    assert found.optimizer_steps == 6
    assert found.tokens == 128 * 9 * 3 * (2500 + 4 * 960 + 300)


def test_what_costs_more_is_estimated_as_more() -> None:
    plain = estimate(settings(), H100)
    spared = estimate(settings(update={"gradient_checkpointing": True}), H100)
    assert spared.memory["activations"] < plain.memory["activations"] / 5
    assert spared.seconds > plain.seconds
    assert estimate(settings(objective={"name": "group_is"}), H100).seconds > plain.seconds
    assert plain.optimizer_steps == 2 * 9
    assert plain.tokens == 3600 * (2500 + 4 * 960 + 300)


def test_it_is_told_in_a_few_lines() -> None:
    said = "\n".join(estimate(settings(), Gpus(count=8)).lines())
    assert "8.77 B weights" in said
    assert "GiB per GPU, " in said
    assert "min per iteration" in said


def test_a_model_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot load the model") as error:
        estimate(settings(tmp_path / "nowhere"), H100)
    assert "\n" not in str(error.value)
