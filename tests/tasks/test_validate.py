"""Every rule has a task that breaks it, and is named."""

from __future__ import annotations

import pytest
from tests.tasks.making import rubric, task

from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.text import plain
from webgym.tasks.published import DIFFICULTY_DIFFERS
from webgym.taskset.decompose import derive
from webgym.taskset.validate import RULES, Rule, validate

GOOD = task("s/1", "https://good.example/", 3, 2, split="train")
TEST = task("s/2", "https://www.tested.example/", split="test")
CHILD = derive(GOOD)[0]


def test_a_good_set_has_no_offenders() -> None:
    found = validate([GOOD, TEST, CHILD])
    assert found.ok
    assert (found.tasks, found.train, found.test, found.websites, found.test_websites) == (3, 2, 1, 2, 1)
    assert set(found.counts().values()) == {0}
    assert list(found.counts()) == list(RULES)


def bad(id: str, *sizes: int, **more: object) -> Task:
    website = str(more.pop("website", "https://other.example/"))
    return task(id, website, *sizes, **{"split": "train"} | more)


@pytest.mark.parametrize(
    ("offender", "rule", "detail"),
    [
        (bad("s/1"), "id", "a second task with this id"),
        (bad(""), "id", "no id"),
        (bad("s/3", instruction=" \n"), "instruction", "it is empty"),
        (bad("s/3", website="not a website"), "website", "'not a website' does not name a website"),
        (bad("s/3", domain="Cooking"), "domain", "unknown domain 'Cooking'"),
        (bad("s/3", subdomain="Soup", domain="Misc."), "domain", "there is no subdomain 'Soup'"),
        (bad("s/3", subdomain="Music", domain="Misc."), "domain", "'Music' belongs to 'Entertainment'"),
        (bad("s/3", flags=(DIFFICULTY_DIFFERS,)), "difficulty", "it has 1 facts"),
        (bad("s/3", split=None), "split", "neither"),
        (bad("s/3", split="test", website="http://m.tested.example:80/x"), "distinct", "s/2"),
        (bad("s/3", website="TESTED.example"), "leak", "the test task s/2 is on it"),
        (bad("s/3", parent_id="s/2"), "family", "s/2"),
        (bad("s/1+9", parent_id="s/1", rubric=rubric(3, 2)), "derived", "as hard as s/1"),
        (bad("s/1+9", parent_id="s/1", rubric=rubric(4)), "derived", "group 1 is not one of s/1"),
        (
            bad("s/1+9", parent_id="s/1", rubric=Rubric((GOOD.rubric.groups[1],))),
            "derived",
            "none of its groups is large",
        ),
        (
            bad(
                "s/1+9", parent_id="s/1", rubric=Rubric((GOOD.rubric.groups[1], FactGroup(3, "", ("x",) * 3)))
            ),
            "derived",
            "group 3 is not one of s/1",
        ),
    ],
)
def test_an_offender_is_named(offender: Task, rule: Rule, detail: str) -> None:
    found = validate([GOOD, TEST, offender])
    assert not found.ok
    (named,) = (each for each in found.offenders if each.rule == rule)
    assert named.id == offender.id
    assert detail in named.detail
    assert named.website in ("good.example", "tested.example", "other.example", "not a website")
    assert str(named).startswith(plain(f"{rule}: {offender.id} ({named.website}): "))


def test_a_relative_by_a_parent_that_is_missing_is_one() -> None:
    tasks = [
        task("a", "a.example", split="test", parent_id="gone"),
        task("b", "b.example", split="train", parent_id="gone"),
        task("c", "c.example", split="train", parent_id="b"),
    ]
    found = validate(tasks)
    assert [(each.rule, each.id) for each in found.offenders if each.rule != "derived"] == [
        ("family", "b"),
        ("family", "c"),
    ]
    assert found.orphans == ["a", "b"]


def test_a_ring_of_parents_is_survived() -> None:
    tasks = [
        task("a", "a.example", parent_id="b", split="train"),
        task("b", "b.example", parent_id="a", split="test"),
    ]
    assert "family" in {each.rule for each in validate(tasks).offenders}


def test_tasks_that_are_not_split_yet_can_be_checked() -> None:
    unsplit = task("s/3", "tested.example", 1)
    found = validate([unsplit, TEST], split=False)
    assert found.ok
    assert found.unchecked == ["split", "distinct", "leak", "family"]
    assert found.counts().keys() == RULES.keys() - set(found.unchecked)
    assert validate([GOOD]).unchecked == []
    assert not validate([unsplit, TEST]).ok
