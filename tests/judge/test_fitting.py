"""A judge that cannot judge the tasks is refused before they are attempted."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from msgspec.structs import replace

from webgym.core.errors import ConfigError
from webgym.core.task import Task
from webgym.judge.config import JudgeChoice
from webgym.judge.factory import refuse_unjudgeable
from webgym.judge.offline import why_unjudgeable
from webgym.offline.web import OfflineWeb

CHAT = {"base_url": "http://127.0.0.1:1/v1", "model": "m"}


@pytest.fixture(scope="module")
def tasks() -> list[Task]:
    return list(OfflineWeb(1, per_family=1).tasks())


def test_the_offline_judge_takes_all_of_the_offline_web_and_nothing_else(tasks: Sequence[Task]) -> None:
    refuse_unjudgeable(JudgeChoice(), tasks)
    mixed = [tasks[0], replace(tasks[1], truth=None), replace(tasks[2], truth=None)]
    with pytest.raises(ConfigError) as refused:
        refuse_unjudgeable(JudgeChoice(), mixed)
    assert "cannot judge 2 of 3 tasks" in str(refused.value)
    assert tasks[1].id in str(refused.value)
    refuse_unjudgeable(JudgeChoice.model_validate({"name": "rubric", "rubric": {"chat": CHAT}}), mixed)


def test_a_truth_that_knows_too_little_is_found(tasks: Sequence[Task]) -> None:
    truth = tasks[0].truth
    assert truth is not None
    assert "without evidence for fact" in why_unjudgeable(replace(tasks[0], truth=replace(truth, facts=())))


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        (JudgeChoice(name="rubric"), "endpoint"),
        (JudgeChoice(name="oracle"), "no judge 'oracle'"),
        (JudgeChoice(name="nowhere:judge"), "cannot load"),
        (JudgeChoice(without_rubric=True), "without rubric"),
    ],
)
def test_a_judge_that_lacks_what_it_needs(choice: JudgeChoice, words: str, tasks: Sequence[Task]) -> None:
    with pytest.raises(ConfigError, match=words):
        refuse_unjudgeable(choice, tasks)
