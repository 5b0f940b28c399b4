"""Settings and the presets that come with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from webgym.agent.profiles import choose_profile
from webgym.core.settings import merged
from webgym.inference.vllm import VllmConfig
from webgym.llm.config import altering
from webgym.study import demo
from webgym.train.config import LearnConfig
from webgym.train.engine_serving import EngineServing
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.objectives import GroupIS, make_objective
from webgym.train.serving import LocalServing
from webgym.train.start import _with_sessions_of_evaluations, load_train_config, make_serving

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
    whole = load_train_config([CONFIGS / "train/qwen3-vl-8b.yaml", CONFIGS / "train/group-is.yaml"])
    config = whole.learn
    assert whole.rollout.samples == 8
    assert make_objective(config.objective) == GroupIS()
    assert (config.replay.trajectories, config.replay.steps, config.replay.passes) == (128, None, 3)
    assert (config.replay.max_uses, config.replay.repetition_penalty) == (3, False)
    assert config.replay.iterations == (GroupIS().staleness or 0) + 1
    update = config.update
    assert (update.learning_rate, update.final_rate, update.minibatches) == (5e-6, 0.1, 2)
    steps = config.replay.passes * 2
    assert (update.schedule, update.total_steps, update.warmup_steps) == ("cosine", 300 * steps, 5 * steps)
    assert whole.rollout.agent.rounds == 1


def test_the_preset_of_cloning_is_the_papers_whatever_it_is_laid_over() -> None:
    preset = CONFIGS / "train/qwen3-vl-8b.yaml"
    over = [preset, CONFIGS / "train/group-is.yaml", CONFIGS / "train/filtered-bc.yaml"]
    assert load_train_config(over) == load_train_config([preset])


def test_the_preset_of_the_tiny_policy_is_the_demo() -> None:
    assert (demo.WEIGHTS / "config.json").exists()
    expected = demo.settings(demo.WEIGHTS, seed=0, tasks=200, iterations=None, sessions=8)
    assert load_train_config([CONFIGS / "train/tiny.yaml"]) == expected


@pytest.mark.parametrize("server", [["group-is"], ["group-is", "vllm", "group-is-vllm"]])
def test_the_presets_of_groups_sample_from_the_full_distribution(server: list[str]) -> None:
    whole = load_train_config([CONFIGS / f"train/{name}.yaml" for name in ["qwen3-vl-8b", *server]])
    served = whole.vllm or whole.local
    assert served is not None
    assert (whole.vllm is None) is (server == ["group-is"])
    sampling = choose_profile(None, "Qwen3-VL-8B-Instruct").sampling_of(served.sampling).body()
    assert altering(sampling) == []
    assert (sampling["temperature"], sampling["max_tokens"]) == (1.0, 3072)


def test_a_vllm_server_is_laid_over_a_preset_and_replies_in_place_of_the_model_in_this_process() -> None:
    preset = read("train/qwen3-vl-8b.yaml")
    whole = TrainConfig.model_validate(merged(preset, read("train/vllm.yaml")))
    assert whole.local is None
    assert whole.vllm is not None
    assert whole.vllm.sampling.extra_body == preset["local"]["sampling"]["extra_body"] == {"top_k": 2}
    assert isinstance(make_serving(whole, TrainingFolder(Path("nowhere"))), EngineServing)
    assert isinstance(
        make_serving(TrainConfig.model_validate(preset), TrainingFolder(Path("x"))), LocalServing
    )
    with pytest.raises(ValidationError, match="set either local or vllm, not both"):
        TrainConfig.model_validate(merged(preset, {"vllm": {}}))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"base_url": "gpu-host:8000"}, "must start with http"),
        ({"extra_args": ["--port=1"]}, "extra_args must not set --port"),
        ({"tensor_parallel": 2}, "tensor_parallel"),
    ],
)
def test_a_vllm_setting_that_cannot_hold_is_named(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        VllmConfig.model_validate(settings)


@pytest.mark.parametrize("name", ["ddp", "fsdp2", "zero2", "zero3"])
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
        ({"update": {"schedule": "cosine", "total_steps": 30, "warmup_steps": 30}}, "total_steps"),
        ({"update": {"learning_rate": 0}}, "learning_rate"),
        ({"update": {"learning_rate": float("inf")}}, "learning_rate"),
        ({"update": {"weight_decay": float("inf")}}, "weight_decay"),
        ({"update": {"max_grad_norm": float("inf")}}, "max_grad_norm"),
        ({"update": {"lora": {"alpha": float("inf")}}}, "alpha"),
        ({"update": {"lora": {"targets": "("}}}, "is no regular expression"),
        ({"update": {"betas": [0.9, 1.0]}}, "betas"),
        ({"update": {"betas": [-0.1, 0.9]}}, "betas"),
        ({"update": {"seed": -1}}, "seed"),
        ({"update": {"seed": 2**32}}, "seed"),
        ({"frontier": {"prior": [0, 1]}}, "prior"),
    ],
)
def test_what_makes_no_sense_is_refused(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        LearnConfig.model_validate({"model": "m"} | settings)


def test_a_seed_that_no_draw_takes_is_refused() -> None:
    with pytest.raises(ValidationError, match="seed"):
        TrainConfig.model_validate({"learn": {"model": "m"}, "seed": -1})


def test_an_evaluation_beside_collection_may_have_sessions_of_its_own() -> None:
    given: dict[str, Any] = {"learn": {"model": "m"}, "evaluation": {"sessions": 3}}
    for staleness, sessions in ((0, 16), (1, 16 + 3)):
        config = TrainConfig.model_validate(given | {"loop": {"staleness": staleness}})
        assert _with_sessions_of_evaluations(config).collector.sessions == sessions


@pytest.mark.parametrize(
    ("collector", "told"),
    [({"schedule": "episode_barrier"}, "nothing to overlap"), ({"metrics_port": 9100}, "metrics_port each")],
)
def test_what_cannot_overlap_is_refused(collector: dict[str, Any], told: str) -> None:
    given: dict[str, Any] = {"learn": {"model": "m"}, "rollout": {"collector": collector}}
    TrainConfig.model_validate(given)
    with pytest.raises(ValidationError, match=told):
        TrainConfig.model_validate(given | {"loop": {"staleness": 1}})
