"""The presets: the paper's model with its hyper-parameters, and every row of its study (paper §5)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from tests.conftest import Calls

from webgym.agent.profiles import choose_profile
from webgym.cli import _run
from webgym.tasks.sampling import SamplerConfig
from webgym.train.loop import TrainConfig
from webgym.train.start import load_train_config

CONFIGS = Path(__file__).parents[2] / "configs"
PRESET = CONFIGS / "train/qwen3-vl-8b.yaml"
STUDY = CONFIGS / "study"
UNIFORM, HARDER = None, {"easy": 2.0, "medium": 5.0, "hard": 3.0}


class Row(NamedTuple):
    """A line of the study's table, in its columns."""

    horizon: tuple[int, int, int]
    ratio: dict[str, float] | None
    share_left_out: float
    memory: bool
    penalty: bool


ROWS = {
    "instruct-8b": Row((15, 30, 45), HARDER, 0, memory=True, penalty=True),
    "without-memory": Row((15, 30, 45), HARDER, 0, memory=False, penalty=True),
    "without-repetition-penalty": Row((15, 30, 45), HARDER, 0, memory=True, penalty=False),
    "uniform-sampling": Row((15, 30, 45), UNIFORM, 0, memory=True, penalty=True),
    "only-easy": Row((15, 30, 45), {"easy": 1, "medium": 0, "hard": 0}, 0, memory=True, penalty=True),
    "only-medium": Row((15, 30, 45), {"easy": 0, "medium": 1, "hard": 0}, 0, memory=True, penalty=True),
    "exclude-domains": Row((15, 30, 45), HARDER, 0.5, memory=True, penalty=True),
    "shorter-horizon": Row((10, 20, 30), UNIFORM, 0, memory=True, penalty=True),
}
ZERO_SHOT = {
    "instruct-8b-zero-shot": ("Qwen/Qwen3-VL-8B-Instruct", "coordinates", True),
    "without-memory-zero-shot": ("Qwen/Qwen3-VL-8B-Instruct", "coordinates", False),
    "thinking-8b-zero-shot": ("Qwen/Qwen3-VL-8B-Thinking", "coordinates", True),
    "gpt-4o-zero-shot": ("gpt-4o", "marks", True),
    "gpt-5-zero-shot": ("gpt-5", "marks", True),
}


def in_columns(config: TrainConfig) -> Row:
    attempt, sampler = config.rollout.attempt, config.sampler
    return Row(
        (attempt.budget_easy, attempt.budget_medium, attempt.budget_hard),
        {str(level): share for level, share in sampler.ratio.items()} if sampler.ratio else None,
        sampler.without_share,
        memory={"memory": True, "official": False}[config.rollout.agent.prompt_format],
        penalty=config.learn.replay.repetition_penalty,
    )


def test_the_preset_has_the_papers_hyper_parameters() -> None:
    config = load_train_config([PRESET])
    update, replay = config.learn.update, config.learn.replay
    assert config.learn.model == "Qwen/Qwen3-VL-8B-Instruct"
    assert (update.learning_rate, update.batch) == (1e-6, 192)
    assert update.micro_batch == 2, "the paper has 3: the update is the same"
    assert (update.warmup_steps, update.schedule, update.max_grad_norm) == (30, "constant", 1.0)
    assert (update.weight_decay, update.cutoff_tokens, update.precision) == (0.01, 16384, "bf16")
    assert (replay.iterations, replay.steps, replay.recency, replay.passes) == (4, 1800, 2, 2)
    assert (config.loop.tasks, config.rollout.collector.sessions, config.loop.staleness) == (1024, 80, 0)
    assert (config.learn.objective.name, update.lora, update.gradient_checkpointing) == (
        "filtered_bc",
        None,
        True,  # not the paper's, to fit: it leaves the update as it is
    )
    assert config.local is not None
    sampling = config.local.sampling.body()
    assert sampling == {"temperature": 1.0, "top_p": 0.99, "top_k": 2, "max_tokens": 3072}
    assert config.evaluation.budget == (30, 50, 70)
    assert in_columns(config) == ROWS["shorter-horizon"], "the paper's best row"
    limits = config.rollout.limits
    assert {limits.screenshot, limits.execute, limits.metadata, limits.navigate} == {256}
    assert {limits.allocate, limits.release} == {4}


@pytest.mark.parametrize("name", ROWS)
def test_a_row_of_the_study_is_an_overlay_with_its_values(name: str) -> None:
    overlay = STUDY / f"{name}.yaml"
    config = load_train_config([PRESET, overlay])
    assert in_columns(config) == ROWS[name]
    held = yaml.safe_load(overlay.read_text())
    keys = {f"{part}.{each}" for part in ("learn", "rollout") for each in held[part]} | set(held)
    assert keys == {"learn", "learn.replay", "rollout", "rollout.agent", "rollout.attempt", "sampler"}
    assert set(held["learn"]["replay"]) == {"repetition_penalty"}
    assert set(held["rollout"]["agent"]) == {"prompt_format"}
    # Says itself what it trains on: no overlay over another preset can change the split.
    assert held["sampler"]["split"] == config.sampler.split == "train"


@pytest.mark.parametrize("name", ZERO_SHOT)
def test_a_row_without_training_is_an_evaluation_of_the_test_split(name: str) -> None:
    config = _run.settings([CONFIGS / "testing.yaml", STUDY / f"{name}.yaml"], {})
    model, mode, memory = ZERO_SHOT[name]
    assert config.tasks.split == "test"
    assert config.policy.chat is not None
    assert config.policy.chat.model == model
    assert choose_profile(None, model, config.agent.mode).mode == mode
    assert (config.agent.prompt_format == "memory") is memory
    assert (config.attempt.budget_easy, config.attempt.budget_medium, config.attempt.budget_hard) == (
        30,
        50,
        70,
    )


def test_every_file_of_the_study_is_a_row_of_it() -> None:
    assert {path.stem for path in STUDY.glob("*.yaml")} == {*ROWS, *ZERO_SHOT}


def test_overlays_can_follow_each_other() -> None:
    """The last one wins whole: a ratio is laid over another one level by level, so it names all levels."""
    config = load_train_config([PRESET, STUDY / "instruct-8b.yaml", STUDY / "only-easy.yaml"])
    assert in_columns(config) == ROWS["only-easy"]
    assert isinstance(config.sampler, SamplerConfig)


def test_explain_tells_the_row_before_anything_starts(calls: Calls) -> None:
    told = {}
    for name in (
        "shorter-horizon",
        "without-memory",
        "only-easy",
        "exclude-domains",
        "without-repetition-penalty",
    ):
        code, told[name] = calls.run("train", PRESET, STUDY / f"{name}.yaml", "--explain")
        assert code == 0, told[name]
    assert "1,024 per iteration of split train, uniform" in told["shorter-horizon"]
    assert "10, 20, 30 steps in training, 30, 50, 70 in evaluation" in told["shorter-horizon"]
    assert "prompt format official" in told["without-memory"]
    assert "1 easy\n" in told["only-easy"]
    assert "2 easy, 5 medium, 3 hard, without 50% of the subdomains" in told["exclude-domains"]
    assert "steps that changed nothing are trained on" in told["without-repetition-penalty"]
    assert "GiB per GPU" in told["shorter-horizon"]
