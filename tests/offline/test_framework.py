"""The offline web's frame: seeds, looks, parts and decomposition, websites, and the split."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, ClassVar, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.offline.golden import lines

from webgym.core.truth import Click, Evidence, Give, Home, See, StateCheck
from webgym.offline import app, latency
from webgym.offline.app import Visitors
from webgym.offline.config import CollectionName
from webgym.offline.engine.specified import paged
from webgym.offline.families import FAMILIES
from webgym.offline.look import FONTS, PALETTES, draw, look
from webgym.offline.parts import Assignment, Fact, Part, Place, write
from webgym.offline.seeds import number
from webgym.offline.web import MISBEHAVING, OfflineWeb
from webgym.offline.website import Behaviour, Response, Visit, Website, json_response, page, redirect, slug

SPLITS: tuple[Literal["train", "test"], ...] = ("train", "test")
PLACE = Place("fern", "Fern", "fern.webgym.test", "http://fern.webgym.test/", "Misc.", "News", "train")


# --- seeds, names, pictures ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["thing", "scene", "dish", "face", "pattern", "unheard of"])
def test_a_picture_follows_from_its_name(kind: str) -> None:
    drawn = draw(kind, "Blue Mug", look(1))
    assert drawn == draw(kind, "Blue Mug", look(1))
    assert drawn != draw(kind, "Red Mug", look(1))
    assert drawn.startswith("<svg ")
    assert drawn.endswith("</svg>")


# --- looks -----------------------------------------------------------------------------------------------


def _luminance(color: str) -> float:
    channels = [int(color[index : index + 2], 16) / 255 for index in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(share * value for share, value in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def _contrast(one: str, other: str) -> float:
    darker, lighter = sorted((_luminance(one), _luminance(other)))
    return (lighter + 0.05) / (darker + 0.05)


@pytest.mark.parametrize("palette", PALETTES, ids=lambda palette: palette[0])
def test_text_can_be_read_on_every_palette(palette: tuple[str, str, str, str, str]) -> None:
    primary, on_primary, accent, background, surface = palette
    assert _contrast(primary, on_primary) >= 4.5
    for ground in (background, surface):
        assert _contrast("#1c2128", ground) >= 4.5
        assert _contrast(accent, ground) >= 4.5  # links
    assert _contrast("#ffffff", accent) >= 4.5  # buttons


def test_looks_differ_and_every_choice_occurs() -> None:
    looks = [look(number("look", index)) for index in range(200)]
    assert look(number("look", 3)) == looks[3]
    for attribute, choices in {
        "navigation": {"top", "side"},
        "listing": {"grid", "rows", "table"},
        "filters": {"left", "top"},
        "pager": {"numbers", "steps", "more"},
        "detail": {"tabs", "accordion", "plain"},
        "consent": {"bar", "box", "none"},
        "sticky": {True, False},
        "hero": {True, False},
    }.items():
        assert {getattr(one, attribute) for one in looks} == choices
    assert len({one.primary for one in looks}) == len(PALETTES)
    assert len({one.heading_font + one.text_font for one in looks}) == len(FONTS)
    assert len({(one.variables, one.classes) for one in looks}) > 190


# --- parts and decomposition -----------------------------------------------------------------------------


def part(name: str, facts: int) -> Part:
    made = tuple(
        Fact(
            f"fact {index} of {name}",
            (Evidence((f"{name}{index}",), f"/{name}"),),
            answer=(f"{name}-answer-{index}",),
            what=f"{name}{index}",
            wrong=(f"{name}-wrong", "b-answer-0"),
        )
        for index in range(facts)
    )
    return Part(f"look {name} up", f"About {name}", made, (Click(path=f"/{name}"), See((f"{name}0",))))


def test_an_assignment_is_written_out_with_all_that_derives_from_it() -> None:
    whole, *derived = write(PLACE, Assignment("trip", (part("a", 2), part("b", 3), part("c", 4))))
    assert whole.id == "offline/fern/trip"
    assert [task.id for task in derived] == [
        f"offline/fern/trip/{which}" for which in ("2", "3", "1+2", "1+3", "2+3")
    ]
    assert [task.difficulty for task in derived] == [3, 4, 5, 6, 7]
    assert {task.parent_id for task in derived} == {whole.id}
    assert whole.parent_id is None
    assert {task.split for task in (whole, *derived)} == {"train"}
    asked, form = whole.instruction.split("Finally, look c up. ")
    assert asked == "On Fern, look a up. Also look b up. "
    assert "in this order: a0; a1; b0; b1; b2; c0; c1; c2; c3." in form
    assert derived[-1].instruction.startswith("On Fern, look b up. Also look c up. ")


def test_the_wording_of_the_form_varies_by_task_and_stays() -> None:
    def form(name: str, *parts: Part) -> str:
        return write(PLACE, Assignment(name, parts))[0].instruction.split("up. ")[1]

    names = [f"task {number}" for number in range(30)]
    once, again = ([form(name, part("a", 1)) for name in names] for _ in range(2))
    assert once == again
    assert len(set(once)) == 3
    assert all("a0" in each for each in once)
    nothing = replace(part("a", 1), facts=(replace(part("a", 1).facts[0], answer=()),))
    assert all("done" in form(name, nothing) for name in names)


def test_a_truth_holds_what_its_parts_hold() -> None:
    task = write(PLACE, Assignment("trip", (part("a", 1), part("b", 1))))[0]
    assert task.truth is not None
    assert task.truth.moves == (
        Home(), Click(path="/a"), See(("a0",)),
        Home(), Click(path="/b"), See(("b0",)),
        Give("a-answer-0\nb-answer-0"),
    )  # fmt: skip
    assert [(fact.group, fact.index) for fact in task.truth.facts] == [(1, 0), (2, 0)]
    assert task.truth.answer.required == (("a-answer-0",), ("b-answer-0",))
    assert task.reference_answer == "a-answer-0; b-answer-0"


def test_what_is_right_for_one_part_is_no_wrong_answer_of_another() -> None:
    alone, together = (
        write(PLACE, Assignment("x", parts))[0].truth
        for parts in ((part("a", 1),), (part("a", 1), part("b", 1)))
    )
    assert alone is not None
    assert alone.answer.others == ("a-wrong", "b-answer-0")
    assert together is not None
    assert together.answer.others == ("a-wrong", "b-wrong")


# --- one website -----------------------------------------------------------------------------------------


@dataclass
class Inn(Website):
    """A website of the smallest kind."""

    family: ClassVar[str] = "inn"
    words: ClassVar[dict[str, tuple[str, ...]]] = {"room": ("room", "chamber", "suite")}

    def build(self) -> None:
        self.domain, self.subdomain, self.tagline = "Misc.", "General Info.", "Sleep well"

    def report(self, state: dict[str, Any]) -> dict[str, Any]:
        return {"booked": state.get("booked")}

    def assignments(self) -> list[Assignment]:
        booked = Fact("booked", (Evidence(("x",)),), (StateCheck(("booked",), "1"),))
        return [
            Assignment("look", (part("a", 1),)),
            Assignment("book", (Part("book", "Booking", (booked,), ()),)),
        ]

    @page("/~room/best")
    def best(self, visit: Visit) -> Response:
        return json_response("best")

    @page("/~room/{name}")
    def room(self, visit: Visit, name: str) -> Response:
        return json_response(name)

    @page("/~room/{name}", method="POST")
    def book(self, visit: Visit, name: str) -> Response:
        visit.state["booked"] = name
        return redirect(self.path("/~room/{name}", name=name))


def inn(behaviour: Behaviour = "good", seed: int = 1) -> Inn:
    return Inn(seed=seed, brand="Fern Inn", label="fern-inn", look=look(seed), behaviour=behaviour)


def visit(path: str, method: str = "GET", **query: str) -> Visit:
    return Visit(method, path, query, {key: [value] for key, value in query.items()}, {}, {})


def test_words_of_addresses_belong_to_the_website() -> None:
    found = {inn(seed=seed).path("/~room/best") for seed in range(30)}
    assert found == {"/room/best", "/chamber/best", "/suite/best"}
    assert inn().path("/~room/{name}", name="a b/c?") == f"/{inn().paths['room']}/a%20b%2Fc%3F"


def test_routes_take_the_more_specific_pattern_and_pass_on_what_they_catch() -> None:
    site = inn()
    assert site.handle(visit(site.path("/~room/best"))).body == b'"best"'
    assert site.handle(visit(f"/{site.paths['room']}/old attic")).body == b'"old attic"'
    answer = site.handle(visit(f"/{site.paths['room']}/7", "POST"))
    assert (answer.status, answer.location) == (303, f"/{site.paths['room']}/7")


def test_a_page_that_is_not_there_says_so() -> None:
    site = inn()
    missing = site.handle(visit("/nowhere/<b>"))
    assert missing.status == 404
    assert b"Page not found" in missing.body
    assert b"nowhere" not in missing.body  # what was asked for would be evidence that the agent wrote
    assert site.handle(visit(site.path("/~room/best"), "POST")).status == 303
    assert site.handle(visit("/consent")).status == 405


@given(st.text())
def test_a_slug_is_fit_for_an_address(text: str) -> None:
    assert re.fullmatch(r"(?:[a-z0-9]+(?:-[a-z0-9]+)*)?", slug(text))


def test_how_attempts_end_follows_from_the_behaviour() -> None:
    ends = {
        behaviour: [(a.name, a.expects) for a in inn(behaviour).expected_assignments()]
        for behaviour in ("good", *MISBEHAVING)
    }
    assert ends["good"] == ends["slow"] == ends["nags"] == [("look", "success"), ("book", "success")]
    assert ends["blocks"] == [("look", "blocked"), ("book", "blocked")]
    assert ends["down"] == [("look", "environment_error"), ("book", "environment_error")]
    assert ends["forgets"] == [("book", "judge_error")]


# --- lists and visitors ----------------------------------------------------------------------------------


@given(st.lists(st.integers()), st.text() | st.integers().map(str), st.integers(1, 20))
def test_every_page_of_a_list_can_be_asked_for_and_none_else(items: list[int], asked: str, size: int) -> None:
    shown = paged(items, visit("/", page=asked), size)
    assert 1 <= shown.number <= shown.count
    assert shown.total == len(items)
    every = [paged(items, visit("/", page=str(n)), size) for n in range(1, shown.count + 1)]
    assert [item for one in every for item in one.items] == items
    assert shown in every
    assert all(one.items for one in every) or not items


def test_visitors_are_apart_by_cookie_and_host() -> None:
    kept = Visitors()
    kept.state("ann", "a")["x"] = 1
    assert kept.state("ann", "a") == {"x": 1}
    assert kept.state("ann", "b") == {}
    assert kept.state("bob", "a") == {}
    assert kept.known("carl", "a") is None


def test_the_longest_unused_visitor_is_forgotten_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app, "REMEMBERED", 2)
    kept = Visitors()
    for visitor in ("ann", "bob", "ann", "carl"):
        kept.state(visitor, "a")
    assert [kept.known(visitor, "a") is not None for visitor in ("ann", "bob", "carl")] == [True, False, True]
    kept.state("bob", "a", was_served=True)
    assert kept.known("bob", "a") is None


# --- latency ---------------------------------------------------------------------------------------------


def test_latency_can_be_turned_off_and_is_seeded() -> None:
    assert latency.seconds(1, "h", "/", 1, 0) == 0
    assert latency.seconds(1, "h", "/", 1, 1.0) == latency.seconds(1, "h", "/", 1, 1.0)
    asked = [(1, "h", "/", 1), (2, "h", "/", 1), (1, "i", "/", 1), (1, "h", "/a", 1), (1, "h", "/", 2)]
    drawn = {latency.seconds(*names, scale=1.0) for names in asked}
    assert len(drawn) == 5
    assert latency.seconds(1, "h", "/", 1, 2.0) == 2 * latency.seconds(1, "h", "/", 1, 1.0)


def test_latency_is_heavy_tailed_and_bounded() -> None:
    drawn = sorted(latency.seconds(1, "h", "/", nth, 1.0) for nth in range(4000))
    assert median(drawn) == pytest.approx(latency.MEDIAN_SECONDS, rel=0.1)
    assert drawn[int(len(drawn) * 0.99)] > 6 * latency.MEDIAN_SECONDS
    assert max(drawn) <= latency.LONGEST_SECONDS
    cut = [latency.seconds(1, "h", "/", nth, 2.0, longest=0.1) for nth in range(400)]
    assert max(cut) == 0.2


# --- the whole web ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def web() -> OfflineWeb:
    return OfflineWeb(11, per_family=10)


def test_hosts_and_brands_are_unique(web: OfflineWeb) -> None:
    expected = len(FAMILIES) * web.per_family + len(MISBEHAVING)
    assert len(web.specs) == expected
    assert all(re.fullmatch(r"[a-z0-9]+(?:-[a-z0-9]+)*\.webgym\.test", host) for host in web.specs)
    assert len({(spec.family, spec.brand) for spec in web.specs.values()}) == expected


def test_the_split_is_by_website_and_misbehaviour_is_for_tests_alone(web: OfflineWeb) -> None:
    good = [spec for spec in web.specs.values() if spec.behaviour == "good"]
    for family in FAMILIES:
        shares = Counter(spec.split for spec in good if spec.family is family)
        assert shares == {"test": 2, "train": 8}
    bad = [spec for spec in web.specs.values() if spec.behaviour != "good"]
    assert [spec.behaviour for spec in bad] == list(MISBEHAVING)
    assert {spec.split for spec in bad} == {"test"}


@pytest.mark.parametrize("collection", ["large", "small", "cross"])
def test_a_website_is_for_the_same_split_in_a_web_of_any_size(collection: CollectionName) -> None:
    use: dict[str, tuple[str, str]] = {}
    for size in (None, 1, 2, 3, 5, 10, 48, 51, 56, 70, 75, 144):
        web = OfflineWeb(11, per_family=size, collection=collection)
        for host, spec in web.specs.items():
            assert use.setdefault(host, (spec.split, spec.behaviour)) == (spec.split, spec.behaviour)
        for family in web.collection.families:
            good = [each for each in web.specs.values() if each.family is family and each.behaviour == "good"]
            assert len(good) == web.per_family
            tests = sum(each.split == "test" for each in good)
            assert tests == round(web.per_family * web.collection.test_share)
    whole, few = (list(OfflineWeb(11, per_family=size).specs) for size in (60, 10))
    assert set(few) <= set(whole)


def test_tasks_are_unique_follow_their_website_and_leak_nothing(web: OfflineWeb) -> None:
    small = OfflineWeb(11, per_family=2)
    tasks = {split: list(small.tasks(split)) for split in SPLITS}
    everything = [*tasks["train"], *tasks["test"]]
    assert len({task.id for task in everything}) == len(everything) == len(list(small.tasks()))
    hosts = {split: {task.truth.host for task in some if task.truth} for split, some in tasks.items()}
    assert not hosts["train"] & hosts["test"]
    parents = {task.id: task for task in everything}
    for task in everything:
        assert task.source == "offline"
        if task.parent_id is not None:
            parent = parents[task.parent_id]
            assert (parent.split, parent.website) == (task.split, task.website)
            assert task.difficulty < parent.difficulty


def test_another_seed_is_another_web(web: OfflineWeb) -> None:
    assert list(OfflineWeb(11, per_family=10).specs) == list(web.specs)
    assert len(set(OfflineWeb(12, per_family=10).specs) & set(web.specs)) < len(web.specs) / 10


def test_a_website_that_is_down_does_not_resolve(web: OfflineWeb) -> None:
    (down,) = (host for host, spec in web.specs.items() if spec.behaviour == "down")
    *nowhere, everything = web.allowed_hosts("127.0.0.1:99")
    assert nowhere == [f"{down}=nowhere"]
    assert everything == "*.webgym.test=127.0.0.1:99"


PAGES = """
import hashlib
from tests.offline.golden import pages
from webgym.offline.web import OfflineWeb
web, seen = OfflineWeb(5, per_family=1), hashlib.sha256()
for host in web.specs:
    for url, body in pages(web, host):
        seen.update(url.encode() + body)
    seen.update(repr(list(web.tasks_of(host))).encode())
found = seen.hexdigest()
print(found)
"""


def test_the_same_seed_gives_the_same_bytes_in_every_process() -> None:
    # Hashes of strings differ from process to process: what depends on the order of a set would differ.
    there = subprocess.run(
        [sys.executable, "-c", PAGES],
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONHASHSEED": "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"},
        check=True,
        timeout=60,
        text=True,
    ).stdout
    here: dict[str, Any] = {}
    exec(PAGES, here)
    assert here["found"] == there.strip()
    assert len(here["found"]) == 64


def test_a_version_keeps_its_websites_pages_and_tasks() -> None:
    """``tests/offline/golden.py`` writes the file, and says when that is right."""
    golden = (Path(__file__).parent / "golden.txt").read_text().splitlines()
    assert list(lines()) == golden
