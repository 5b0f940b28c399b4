"""Near-duplicate control, within a source and across sources."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.tasks.making import task

from webgym.core.task import Task
from webgym.tasks.sources.base import SourceTask
from webgym.taskset.duplicates import DuplicateLimits, drop_duplicates, fold, names, number

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


def asking(id: str, instruction: str, website: str = "https://www.shop.example/", **more: object) -> Task:
    return task(id, website, instruction=instruction, **more)


def verdicts(*tasks: Task, limits: DuplicateLimits | None = None) -> list[tuple[str, str, str]]:
    found = drop_duplicates(tasks, limits)
    assert [each.id for each in found.kept] == [
        each.id for each in tasks if each.id not in {dropped.id for dropped in found.dropped}
    ]
    return [(dropped.id, dropped.why, dropped.of) for dropped in found.dropped]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Find a Lasagna recipe.", "find a lasagna recipe"),
        ("Find   a “lasagna” recipe…", 'Find a "lasagna" recipe...'),
        ("Women’s shoes, size 7", "womens shoes size 7"),
        ("Scores on Fox Sports!", "scores on foxsports"),
        ("a café, ﬁrst floor", "A CAFE\u0301, first floor"),
        ("more than 1,000 reviews", "more than 1000 reviews"),
        ("Straße", "STRASSE"),
    ],
)
def test_what_is_the_same(one: str, other: str) -> None:
    assert verdicts(asking("s/1", one), asking("s/2", other)) == [("s/2", "same", "s/1")]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Find a course on C++.", "Find a course on C."),
        ("Find a course on C#.", "Find a course on C."),
        ("rated 4.5 stars", "rated 45 stars"),
        ("under $100", "under €100"),
        ("1 11 apples", "11 1 apples"),
        ("कि", "का"),
        ("???", "!!!"),
    ],
)
def test_what_is_not(one: str, other: str) -> None:
    assert verdicts(asking("s/1", one), asking("s/2", other)) == []


LONG = (
    "Show me the options for a round trip that leaves from Las Vegas on flexible dates in May, for 2 adults "
    "and 1 child, under 500 dollars each, with one checked bag included and at most one stop on the way"
)


@pytest.mark.parametrize(
    ("other", "near"),
    [
        (LONG.replace("Show me the options", "Please show the options"), True),
        (LONG.replace("included", "included as well"), True),
        (LONG.replace("on flexible dates", "with flexible dates").replace("Las Vegas", "las vegas"), True),
        (LONG + " on Shop", True),
        (LONG.replace("500", "600"), False),
        (LONG.replace("at most one stop", "at most two stops"), False),
        (LONG.replace("Las Vegas", "Los Angeles"), False),
        (LONG.replace("in May", "in June"), False),
        (LONG.replace("2 adults and 1 child", "1 adult and 2 children"), False),
        ("Find something else altogether", False),
    ],
)
def test_what_is_near(other: str, near: bool) -> None:
    expected = [("s/2", "near", "s/1")] if near else []
    assert verdicts(asking("s/1", LONG), asking("s/2", other)) == expected


def test_names_that_change_places_make_another_task() -> None:
    there = "Find the cheapest direct train from Paris to Rome that leaves in the morning and takes a bicycle"
    back = there.replace("Paris", "?").replace("Rome", "Paris").replace("?", "Rome")
    assert verdicts(asking("s/1", there), asking("s/2", back)) == []
    assert verdicts(asking("s/1", there.lower()), asking("s/2", back.lower())) == []


def test_only_one_website_can_have_a_task_twice() -> None:
    text = "Find the latest news."
    assert verdicts(asking("s/1", text, "a.example"), asking("s/2", text, "b.example")) == []
    assert verdicts(asking("s/1", text, "https://www.a.example/x?y"), asking("s/2", text, "m.a.example")) == [
        ("s/2", "same", "s/1")
    ]


def test_tasks_whose_website_is_not_known_yet_are_compared() -> None:
    tasks = [
        SourceTask("mind2web-2/b", "mind2web-2", "Who was it?"),
        SourceTask("browsecomp/a", "browsecomp", "who was it"),
        SourceTask("gaia-web/c", "gaia-web", "Who was it?", "https://www.google.com/"),
        SourceTask("gaia-web/d", "gaia-web", "Who was it?", "not a website"),
    ]
    found = drop_duplicates(tasks)
    assert [(dropped.id, dropped.source, dropped.of) for dropped in found.dropped] == [
        ("browsecomp/a", "browsecomp", "mind2web-2/b")
    ]


def test_people_go_before_models_and_then_the_smaller_id() -> None:
    tasks = [
        asking("pae-webvoyager/1", "Buy milk.", source="pae-webvoyager"),
        asking("deepshop/2", "Buy milk", source="deepshop"),
        asking("deepshop/1", "buy milk", source="deepshop"),
        asking("mine/9", "BUY MILK", source="mine"),
    ]
    assert verdicts(*tasks) == [(each.id, "same", "mine/9") for each in tasks[:3]]
    assert [each[2] for each in verdicts(*tasks[:3])] == ["deepshop/1", "deepshop/1"]


def test_a_test_task_goes_before_any_other() -> None:
    tasks = [asking("a/1", "Buy milk.", source="mine"), asking("b/1", "Buy milk", split="test")]
    assert verdicts(*tasks) == [("a/1", "same", "b/1")]


def test_children_of_a_source_go_with_their_parents() -> None:
    tasks = [
        SourceTask(id=id, source="webgym", instruction=text, website="https://a.example/", parent_id=parent)
        for id, text, parent in (
            ("w/1", "Buy milk.", None),
            ("w/2", "buy milk", None),
            ("w/2+1", "Buy.", "w/2"),
        )
    ]
    assert [(each.id, each.why) for each in drop_duplicates(tasks).dropped] == [
        ("w/2", "same"),
        ("w/2+1", "parent"),
    ]


def test_children_go_with_their_parents() -> None:
    tasks = [
        asking("b/1", "Buy milk and bread.", source="deepshop"),
        asking("b/1+2", "Buy bread.", source="deepshop", parent_id="b/1"),
        asking("b/1+2+1", "Buy any bread.", "https://other.example/", source="deepshop", parent_id="b/1+2"),
        asking("a/1", "buy milk and bread", source="deepshop"),
        asking("a/1+2", "buy bread", source="deepshop", parent_id="a/1"),
    ]
    assert verdicts(*tasks) == [
        ("b/1", "same", "a/1"),
        ("b/1+2", "parent", "b/1"),
        ("b/1+2+1", "parent", "b/1+2"),
    ]


def test_a_derived_task_never_takes_the_place_of_a_source_s() -> None:
    tasks = [
        asking("a/1", "Buy milk and bread.", source="online-mind2web"),
        asking("a/1+2", "Buy bread.", source="online-mind2web", parent_id="a/1"),
        asking("z/1", "buy bread", source="pae-webvoyager"),
    ]
    assert verdicts(*tasks) == [("a/1+2", "same", "z/1")]


def test_a_family_s_members_may_be_near_but_not_the_same() -> None:
    shorter = LONG.replace("checked bag included and", "checked bag and")
    family = [
        asking("s/1", LONG),
        asking("s/1+1", shorter, parent_id="s/1"),
        asking("s/1+2", shorter.upper(), parent_id="s/1"),
    ]
    assert verdicts(*family) == [("s/1+2", "same", "s/1+1")]
    assert verdicts(asking("s/1", LONG), asking("s/2", shorter)) == [("s/2", "near", "s/1")]


def test_a_template_is_capped_in_synthetic_sources_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.taskset.duplicates.PER_TEMPLATE", 4)
    texts = [f"Find a hotel with {number} stars." for number in range(10)]
    made = [asking(f"p/{n}", text, source="pae-webvoyager") for n, text in enumerate(texts)]
    limits = DuplicateLimits()
    dropped = verdicts(*made, limits=limits)
    kept = {each.id for each in made} - {id for id, _, _ in dropped}
    assert (len(kept), {why for _, why, _ in dropped}) == (4, {"template"})
    assert {of for _, _, of in dropped} < kept
    other = drop_duplicates(made, limits.model_copy(update={"seed": 1})).kept
    assert {each.id for each in other} != kept
    assert (
        verdicts(*(asking(f"d/{n}", text, source="deepshop") for n, text in enumerate(texts)), limits=limits)
        == []
    )


def test_a_website_is_capped_in_synthetic_sources_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.taskset.duplicates.PER_WEBSITE", 3)
    words = "alpha beta gamma delta epsilon zeta".split()
    made = [asking(f"p/{word}", f"Find {word}.", source="agentsynth-web") for word in words]
    child = asking("p/alpha+1", "Find only alpha.", source="agentsynth-web", parent_id="p/alpha")
    dropped = verdicts(*made, child)
    gone = {id for id, why, _ in dropped if why == "website"}
    assert len(gone) == 3
    assert ("p/alpha" in gone) == (("p/alpha+1", "parent", "p/alpha") in dropped)


WORDS = st.lists(st.sampled_from("find the a red blue Paris Rome 3 4 hotel near cheap".split()), max_size=14)


@given(st.lists(st.tuples(WORDS, st.sampled_from("ab")), max_size=12), st.randoms(use_true_random=False))
def test_the_order_of_the_tasks_does_not_matter(
    texts: list[tuple[list[str], str]], rng: random.Random
) -> None:
    tasks = [asking(f"s/{n}", " ".join(words), f"{host}.example") for n, (words, host) in enumerate(texts)]
    found = drop_duplicates(tasks)
    shuffled = rng.sample(tasks, len(tasks))
    again = drop_duplicates(shuffled)
    assert {each.id for each in found.kept} == {each.id for each in again.kept}
    assert set(found.dropped) == set(again.dropped)
    assert len(found.kept) + len(found.dropped) == len(tasks)
    assert drop_duplicates(found.kept).dropped == []
    kept = {each.id for each in found.kept}
    assert all(dropped.of in kept for dropped in found.dropped)
    # No two kept tasks of a website have the same folded text.
    assert len({(each.website, fold(each.instruction)) for each in found.kept}) == len(kept)


def test_the_words_that_count() -> None:
    assert names("Find IT jobs in New York. They pay. I am O'Brien, from São Paulo: Go") == {
        "it",
        "new",
        "york",
        "obrien",
        "são",
        "paulo",
    }
    assert [number(word) for word in ("four", "4", "4th", "fourth", "b2b", "x")] == [
        "4",
        "4",
        "4th",
        None,
        "b2b",
        None,
    ]


def test_online_mind2web_against_mind2web_live() -> None:
    live, online = DATA / "mind2web-live/mind2web-live_test_20241024.json", DATA / "online-mind2web"
    if not live.exists():
        pytest.skip(f"no real files in {DATA}")
    tasks = [
        SourceTask(
            f"mind2web-live/{row['index']}",
            "mind2web-live",
            row["task"],
            row["evaluation"][0]["content"]["url"],
        )
        for row in json.loads(live.read_text())
    ] + [
        SourceTask(
            f"online-mind2web/{row['task_id']}", "online-mind2web", row["confirmed_task"], row["website"]
        )
        for row in json.loads((online / "Online_Mind2Web_06042025.json").read_text())
    ]
    dropped = drop_duplicates(tasks).dropped
    assert sum(each.why == "same" for each in dropped) == 18
    assert all(each.source == "mind2web-live" and each.of.startswith("online-") for each in dropped)


def test_webvoyager_and_deepshop_share_ids_and_tasks() -> None:
    shop, voyager = DATA / "deepshop/deepshop_test.jsonl", DATA / "webvoyager/WebVoyager_data.jsonl"
    if not shop.exists():
        pytest.skip(f"no real files in {DATA}")
    rows = [("deepshop", line) for line in shop.read_text().splitlines()]
    rows += [("pae-webvoyager", line) for line in voyager.read_text().splitlines()]
    tasks = [
        SourceTask(f"{source}/{row['id']}", source, row["ques"], row["web"])
        for source, line in rows
        for row in (json.loads(line),)
    ]
    clashing = {each.id.partition("/")[2] for each in tasks if each.source == "deepshop"} & {
        each.id.partition("/")[2] for each in tasks if each.source != "deepshop"
    }
    assert "Amazon--31" in clashing
    dropped = drop_duplicates(tasks).dropped
    assert ("pae-webvoyager/Amazon--31", "deepshop/Amazon--31") in [(each.id, each.of) for each in dropped]
    assert {each.source for each in dropped} == {"pae-webvoyager"}
