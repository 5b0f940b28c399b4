"""Settings are merged key by key, wherever they come from: who sets one key of a section keeps the rest."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel

import webgym
from webgym.agent.profiles import profile_of
from webgym.cli import _run
from webgym.cli._judge_options import judge_choice, own_choice
from webgym.core.errors import ConfigError
from webgym.core.settings import Section, merged, without_none
from webgym.judge.config import JudgeConfig, StageConfig
from webgym.judge.rubric import RubricJudge
from webgym.llm.config import ChatConfig, Sampling
from webgym.run.config import RunConfig, TaskChoice, resolved
from webgym.taskset.construction.config import BuildConfig

CHAT = {"base_url": "http://127.0.0.1:1/v1", "model": "Qwen/Qwen3-VL-8B-Instruct"}


def written(path: Path, settings: Mapping[str, Any]) -> Path:
    path.write_text(yaml.safe_dump(settings))
    return path


def test_one_key_of_the_policys_sampling_keeps_what_its_model_is_best_sampled_with(tmp_path: Path) -> None:
    chat = CHAT | {"sampling": {"temperature": 0.7}}
    file = written(tmp_path / "run.yaml", {"policy": {"name": "openai", "chat": chat}})
    config = resolved(_run.settings([file], {}), None, None)
    assert config.policy.chat is not None
    assert config.policy.chat.sampling.body() == {
        "temperature": 0.7,
        "top_p": 0.99,
        "max_tokens": 3072,
        "top_k": 2,
    }
    held = config.model_dump(mode="json")  # as config.yaml holds it, from which the run is resumed
    assert resolved(_run.settings([written(tmp_path / "config.yaml", held)], {}), None, None) == config


def test_what_is_set_to_nothing_is_not_sent() -> None:
    qwen = profile_of(CHAT["model"])
    assert qwen is not None
    given = Sampling.model_validate({"top_p": None, "extra_body": {"top_k": None, "min_p": 0.1}})
    assert qwen.sampling_of(given).body() == {"temperature": 1.0, "max_tokens": 3072, "min_p": 0.1}


@pytest.mark.parametrize("stage", ["keypoint", "fact", "response", "blocking", "reference"])
def test_one_key_of_a_stages_sampling_keeps_the_others(stage: str) -> None:
    usual: StageConfig = getattr(JudgeConfig(chat=ChatConfig.model_validate(CHAT)), stage)
    changes = {"sampling": {"temperature": 0.7, "extra_body": {"seed": 3}}}
    found = getattr(JudgeConfig.model_validate({"chat": CHAT, stage: changes}), stage)
    assert found.sampling.body() == {"temperature": 0.7, "max_tokens": 1024, "seed": 3}
    assert found.images_per_call == usual.images_per_call
    built = JudgeConfig.model_validate({"chat": CHAT, stage: StageConfig(sampling=Sampling(temperature=0.7))})
    assert getattr(built, stage).sampling.max_tokens == 1024


def test_one_key_of_a_purposes_sampling_keeps_the_builds() -> None:
    sampling = {"temperature": 0, "max_tokens": 4000, "extra_body": {"top_k": 5}}
    small = {"sampling": {"max_tokens": 400, "extra_body": {"seed": 1}}}
    config = BuildConfig.model_validate(
        {
            "sources": {"deepshop": "a"},
            "model": CHAT | {"sampling": sampling},
            "models": {"website": small},
            "assumptions": {"reply_tokens": {"website": 50}},
        }
    )
    website = config.chat("website")
    assert website is not None
    assert website.sampling.body() == {"temperature": 0, "max_tokens": 400, "top_k": 5, "seed": 1}
    assert config.assumptions.reply_tokens == {"website": 50, "rubric": 250, "rewriting": 80, "critic": 40}


def test_an_option_keeps_what_files_say_of_the_policy(tmp_path: Path) -> None:
    chat = CHAT | {"concurrency": 80, "sampling": {"temperature": 0.5}}
    base = written(tmp_path / "a.yaml", {"policy": {"name": "openai", "chat": chat}, "samples": 2})
    more = written(tmp_path / "b.yaml", {"policy": {"chat": {"sampling": {"top_p": 0.9}}}})
    given = {"samples": None, "policy": {"chat": {"base_url": "http://127.0.0.1:2/v1"}}}
    found = _run.settings([base, more], given)
    assert found.policy.chat == ChatConfig.model_validate(
        chat | {"base_url": "http://127.0.0.1:2/v1", "sampling": {"temperature": 0.5, "top_p": 0.9}}
    )
    assert found.samples == 2
    assert _run.settings([base], {"policy": {"name": "scripted", "mistakes": 0.1}}).policy.chat is None
    with pytest.raises(ConfigError, match="endpoint and a model"):
        _run.settings([], {"policy": {"chat": {"model": "a-model"}}})


def test_an_option_keeps_what_a_file_says_of_the_judge(tmp_path: Path) -> None:
    rubric = {"chat": CHAT | {"concurrency": 7}, "fact": {"sampling": {"max_tokens": 2048}}}
    file = written(tmp_path / "judge.yaml", {"name": "rubric", "rubric": rubric})
    found = judge_choice({"rubric": {"chat": {"model": "another"}}}, file=file).rubric
    assert found is not None
    assert (found.chat.model, found.chat.concurrency) == ("another", 7)
    assert found.fact.sampling.body() == {"temperature": 0.0, "max_tokens": 2048}


@pytest.mark.parametrize("collected_with", ["", "a-key"])
@pytest.mark.parametrize("now", ["", "a-key"])
def test_the_judges_key_is_chosen_by_what_is_set_now(
    collected_with: str, now: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("WEBGYM_API_KEY", "the policy's")
    monkeypatch.setenv("WEBGYM_JUDGE_API_KEY", collected_with)
    stages = {"fact": {"chat": CHAT}, "response": {"chat": CHAT | {"api_key_env": "OTHER_KEY"}}}
    given = {"name": "rubric", "rubric": {"chat": dict(CHAT), **stages}}
    stored = {"judge": judge_choice(given).model_dump(mode="json")}
    assert given["rubric"] == {"chat": CHAT, **stages}
    monkeypatch.setenv("WEBGYM_JUDGE_API_KEY", now)
    key = "WEBGYM_JUDGE_API_KEY" if now else "WEBGYM_API_KEY"
    file = written(tmp_path / "judge.yaml", given)
    for choice in (judge_choice({}, default=own_choice(stored)), judge_choice({}, file=file)):
        assert choice.rubric is not None
        names = [choice.rubric.chat_of(stage).api_key_env for stage in ("keypoint", "fact", "response")]
        assert names == [key, key, "OTHER_KEY"]
    chosen = written(tmp_path / "chosen.yaml", {"rubric": {"chat": CHAT | {"api_key_env": "WEBGYM_API_KEY"}}})
    found = judge_choice({"name": "rubric"}, file=chosen).rubric
    assert found is not None
    assert found.chat.api_key_env == "WEBGYM_API_KEY"


def test_no_section_of_ours_has_a_default_that_one_key_would_replace() -> None:
    """Whatever section has a default of its own merges with it."""
    for module in pkgutil.walk_packages(webgym.__path__, "webgym."):
        if module.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as error:  # the lock does not hold every framework
            if not module.name.startswith("webgym.integrations.") or f"{error.name}.".startswith("webgym."):
                raise
    sections = _below(BaseModel)
    assert JudgeConfig in sections
    for section in sections:
        for name, field in section.model_fields.items():
            default = field.get_default(call_default_factory=True, validated_data={})
            sets_something = isinstance(default, BaseModel) and default.model_fields_set
            if sets_something or (isinstance(default, Mapping) and default):
                assert issubclass(section, Section), f"{section.__name__}.{name}"


def _below(of: type[BaseModel]) -> set[type[BaseModel]]:
    found = {one for one in of.__subclasses__() if one.__module__.startswith("webgym")}
    return found.union(*map(_below, of.__subclasses__()))


@pytest.mark.parametrize("of_python", [False, True])
def test_tasks_are_named_where_a_file_is(
    of_python: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tasks = {"file": Path("offline-small-v2"), "split": "test"}
    config = (
        RunConfig(tasks=TaskChoice.model_validate(tasks))
        if of_python
        else _run.settings([], {"tasks": tasks, "sites": {"latency": 0}})
    )
    assert (config.sites.collection, config.tasks.file, config.tasks.split) == ("small", None, "test")
    with pytest.raises(ConfigError, match=r"offline-small-v2 have their own websites: leave out sites\.seed"):
        _run.settings([], {"tasks": tasks, "sites": {"seed": 3}})
    (tmp_path / "offline-small-v2").touch()
    assert _run.settings([], {"tasks": tasks}).tasks.file == Path("offline-small-v2")


def test_merging_changes_neither_side() -> None:
    held, over = {"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": None}, "e": {"f": 4}}
    assert merged(held, over) == {"a": {"b": None, "c": 2}, "d": 3, "e": {"f": 4}}
    assert (held["a"], over["a"]) == ({"b": 1, "c": 2}, {"b": None})
    assert without_none({"a": {"b": None}, "c": {"d": 0}, "e": None}) == {"c": {"d": 0}}


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"attempt": {"budget_esy": 10}}, "did you mean attempt.budget_easy?"),
        ({"polcy": {"name": "random"}}, "polcy: there is no such setting; did you mean policy?"),
        ({"tasks": {"budget_easy": 10}}, "did you mean attempt.budget_easy?"),
        ({"sesions": 2}, "did you mean collector.sessions?"),
        ({"tasks": {"zzz": 1}}, "tasks.zzz: there is no such setting; tasks has benchmark, count, domains, "),
        ({"policy": {"chat": {"base_url": "http://127.0.0.1:1", "modle": "m"}}}, "mean policy.chat.model?"),
        ({"samples": 0}, "samples: Input should be greater than or equal to 1"),
        ({"split": "test"}, "did you mean tasks.split?"),
        ({"agent": 3}, "agent: Input should be a section of settings"),
    ],
)
def test_a_misspelt_key_is_told_with_the_nearest_right_one(
    tmp_path: Path, settings: dict[str, Any], told: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(told)):
        _run.settings([written(tmp_path / "run.yaml", settings)], {})


def test_stored_sampling_still_leaves_the_rest_to_the_defaults() -> None:
    family = Sampling(temperature=0.7, top_p=0.9, max_tokens=64, extra_body={"top_k": 2})
    for given in (Sampling(), Sampling(temperature=1), Sampling(top_p=None)):
        stored = Sampling.model_validate(given.model_dump(mode="json"))
        assert stored.over(family).body() == given.over(family).body()
    chat = ChatConfig(base_url="http://127.0.0.1:1/v1", model="m", sampling=family)
    judge = JudgeConfig(chat=chat)
    assert RubricJudge(JudgeConfig.model_validate(judge.model_dump(mode="json")), {}).name == (
        RubricJudge(judge, {}).name
    )
