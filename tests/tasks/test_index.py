"""Finding tasks: every filter, words, families."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.tasks.strategies import task_lists

from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks.index import FACETS, TaskIndex, TaskQuery, website_key


def task(name: str, facts: int = 1, **changes: Any) -> Task:
    rubric = Rubric((FactGroup(1, "group", tuple(f"fact {number}" for number in range(facts))),))
    made = Task(name, f"Do {name}", "https://shop.example/", "Misc.", "News", rubric, "deepshop")
    return replace(made, **changes)


TASKS = [
    task("a/1", split="train", flags=("dated",)),
    task("a/2", 5, split="test", domain="Entertainment", subdomain="Music"),
    task("b/3", 8, website="www.other.example:8080/x", source="gaia-web"),
    task("b/3+1", 3, website="https://m.other.example", parent_id="b/3", flags=("dated", "garbled")),
    task("c/4", website="no website", instruction="Über alles\nelse"),
]
INDEX = TaskIndex(TASKS)


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ({}, "01234"),
        ({"split": "train"}, "0"),
        ({"level": "hard"}, "2"),
        ({"level": "Medium"}, "1"),
        ({"domain": "misc."}, "0234"),
        ({"subdomain": "Music"}, "1"),
        ({"source": "gaia-web"}, "2"),
        ({"flag": "dated"}, "03"),
        ({"flag": "dated", "split": "train"}, "0"),
        ({"flag": "undated"}, ""),
        ({"website": "other.example"}, "23"),
        ({"website": "https://www.shop.example/any"}, "01"),
        ({"website": "nowhere.example"}, ""),
        ({"website": "No Website"}, "4"),
        ({"text": "über"}, "4"),
        ({"text": "DO b/3"}, "23"),
        ({"text": "do b/3 music"}, ""),
        ({"text": "  "}, "01234"),
        ({"text": "shop.example entertainment"}, "1"),
    ],
)
def test_what_is_wanted_is_found(wanted: dict[str, str], found: str) -> None:
    assert INDEX.find(TaskQuery(**wanted)) == [int(place) for place in found]


def test_counts_and_families() -> None:
    assert INDEX.counts("domain") == {"Misc.": 4, "Entertainment": 1}
    assert INDEX.counts("split") == {"test": 1, "train": 1}  # those that have none are not counted
    assert INDEX.counts("flag") == {"dated": 2, "garbled": 1}
    assert INDEX.counts("flag", [1, 3]) == {"dated": 1, "garbled": 1}
    assert INDEX.websites == 3
    assert INDEX.get("b/3") == TASKS[2]
    assert INDEX.get("b/4") is None
    assert INDEX.children("b/3") == [TASKS[3]]
    assert INDEX.children("a/1") == []
    assert INDEX.close_ids("B/3") == ["b/3", "b/3+1"]


@settings(max_examples=30)
@given(tasks=task_lists, wanted=st.text(max_size=2))
def test_finding_agrees_with_looking_at_every_task(tasks: list[Task], wanted: str) -> None:
    index = TaskIndex(tasks)
    values: dict[str, Callable[[Task], set[str]]] = {
        "split": lambda task: {task.split or ""},
        "level": lambda task: {task.level},
        "domain": lambda task: {task.domain},
        "subdomain": lambda task: {task.subdomain},
        "source": lambda task: {task.source},
        "flag": lambda task: set(task.flags),
    }
    for facet in FACETS:
        for value in {wanted, *index.counts(facet)}:
            expected = [
                place
                for place, task in enumerate(tasks)
                if not value or value.casefold() in {each.casefold() for each in values[facet](task)}
            ]
            assert index.find(TaskQuery(**{facet: value})) == expected
    for task in tasks:
        assert tasks.index(task) in index.find(TaskQuery(website=task.website))
        assert website_key(task.website) == website_key(website_key(task.website))
