"""Training and test tasks share no website, whatever the tasks."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.tasks.making import rubric, task

from webgym.core.errors import TooFewWebsites
from webgym.core.task import LEVELS, Task
from webgym.core.truth import AnswerTruth, Evidence, FactTruth, Truth
from webgym.core.websites import site_of
from webgym.tasks.split import SplitConfig, balanced, leaking, split
from webgym.tasks.taxonomy import DOMAIN_OF
from webgym.taskset.decompose import decompose
from webgym.taskset.validate import validate

FORMS = (
    "https://{}/",
    "http://www.{}:8080/a/b?c=d",
    "{}",
    "https://m.{}/x",
    "WWW.{}",
    "https://user@shop.{}.",
)
SIZES = {"easy": 1, "medium": 4, "hard": 7}


def many(count: int, websites: int, seed: int = 0) -> list[Task]:
    """Tasks in the paper's shape: mostly easy, websites in every form."""
    rng = random.Random(seed)
    subdomains = sorted(DOMAIN_OF)
    return [
        task(
            f"s/{number}",
            rng.choice(FORMS).format(f"site{rng.randrange(websites)}.example"),
            SIZES[rng.choices(LEVELS, (80, 15, 5))[0]],
            subdomain=rng.choice(subdomains),
        )
        for number in range(count)
    ]


def for_testing(tasks: Sequence[Task]) -> list[Task]:
    return [each for each in tasks if each.split == "test"]


@st.composite
def task_lists(draw: st.DrawFn) -> list[Task]:
    """Any tasks: families of several generations, over several websites, with parents missing."""
    sites = st.sampled_from(["a.example", "b.example", "c.co.uk", "d.github.io", "e.example", "no website"])
    tasks: list[Task] = []
    for number in range(draw(st.integers(0, 14))):
        parent = draw(st.none() | st.sampled_from([f"t{n}" for n in range(-1, number + 1)]))
        website = draw(st.sampled_from(FORMS)).format(draw(sites))
        size = draw(st.sampled_from([1, 4, 7]))
        subdomain = draw(st.sampled_from(["News", "Music", "Shopping"]))
        tasks.append(task(f"t{number}", website, size, parent_id=parent, subdomain=subdomain))
    return draw(st.permutations(tasks))


@given(task_lists(), st.integers(0, 4), st.integers(0, 2))
def test_whatever_the_tasks_nothing_leaks(tasks: list[Task], size: int, seed: int) -> None:
    sites = {site for each in tasks if each.parent_id is None and (site := site_or_none(each)) is not None}
    config = SplitConfig(test_tasks=size, seed=seed)
    if size > len(sites):
        with pytest.raises(TooFewWebsites, match=f"there are {len(sites)}"):
            split(tasks, config)
        return
    found = split(tasks, config)
    assert len(for_testing(found.tasks)) == size == found.test.total()
    assert len({site_of(each.website) for each in for_testing(found.tasks)}) == size
    # Everything is accounted for, and nothing but the split is changed.
    assert {each.id for each in found.tasks} | {each.id for each in found.left_out} == {
        each.id for each in tasks
    }
    assert len(found.tasks) + len(found.left_out) == len(tasks)
    before = {each.id: each for each in tasks}
    assert all(msgspec.structs.replace(each, split=None) == before[each.id] for each in found.tasks)
    # Nothing leaks, and nothing is left out that would not.
    assert not [
        offender
        for offender in validate(found.tasks).offenders
        if offender.rule in ("distinct", "leak", "family", "split", "website", "id")
    ]
    for left in found.left_out:
        restored = [*found.tasks, msgspec.structs.replace(before[left.id], split="train")]
        gone = {each.id for each in found.left_out}
        offends = {each.rule for each in validate(restored).offenders} & {"leak", "family", "website"}
        assert offends or before[left.id].parent_id in gone or left.why == "test website"
    assert split(list(reversed(tasks)), config).test == found.test


def site_or_none(task: Task) -> str | None:
    try:
        return site_of(task.website)
    except ValueError:
        return None


def test_the_usual_size() -> None:
    found = split(many(6_000, 3_000))
    assert len(for_testing(found.tasks)) == 1_167
    assert all(left.why == "test website" for left in found.left_out)


def test_too_few_websites_is_an_error_that_says_how_many() -> None:
    with pytest.raises(TooFewWebsites, match="1,167 test tasks need as many websites, and there are 40"):
        split(many(500, 40))


@pytest.mark.parametrize("seed", range(3))
def test_levels_and_domains_are_even(seed: int) -> None:
    found = split(many(20_000, 8_000), SplitConfig(test_tasks=360, seed=seed))
    levels = Counter[str]()
    domains = Counter[str]()
    for (level, domain), count in found.test.items():
        levels[level] += count
        domains[domain] += count
    assert set(levels.values()) == {120}
    assert set(domains.values()) == {60}
    assert set(found.test.values()) == {20}


def test_a_level_that_is_rare_gives_all_it_has_and_the_rest_is_even() -> None:
    easy = [task(f"e{n}", f"e{n}.example", 1) for n in range(100)]
    medium = [task(f"m{n}", f"m{n}.example", 4) for n in range(100)]
    hard = [task(f"h{n}", f"h{n}.example", 7) for n in range(5)]
    found = split([*easy, *medium, *hard], SplitConfig(test_tasks=45))
    assert found.test == {("easy", "Misc."): 20, ("medium", "Misc."): 20, ("hard", "Misc."): 5}


def test_a_website_that_could_stand_for_several_pairs_stands_where_it_is_needed() -> None:
    tasks = [task(f"{site}{size}", f"{site}.example", size) for site in "abc" for size in (1, 4, 7)]
    tasks += [task("only", "d.example", 1)]
    found = split(tasks, SplitConfig(test_tasks=4))
    assert sorted(found.test.values()) == [1, 1, 2]


def test_it_is_deterministic_and_the_seed_decides() -> None:
    tasks = many(2_000, 800)
    one, other = (
        split(each, SplitConfig(test_tasks=90)) for each in (tasks, random.Random(3).sample(tasks, 2_000))
    )
    assert {each.id for each in for_testing(one.tasks)} == {each.id for each in for_testing(other.tasks)}
    third = split(tasks, SplitConfig(test_tasks=90, seed=1))
    assert {each.id for each in for_testing(one.tasks)} != {each.id for each in for_testing(third.tasks)}


def test_a_task_more_moves_few_test_tasks() -> None:
    tasks = many(3_000, 1_500)
    config = SplitConfig(test_tasks=180)
    before = {each.id for each in for_testing(split(tasks, config).tasks)}
    moved = 0
    for number in range(20):
        more = [*tasks, task(f"new/{number}", f"new{number}.example", 1, subdomain="Music")]
        moved += len(before - {each.id for each in for_testing(split(more, config).tasks)})
    assert moved <= 20
    many_more = [*tasks, *(task(f"new/{n}", f"new{n}.example", 1) for n in range(300))]
    assert len(before & {each.id for each in for_testing(split(many_more, config).tasks)}) > 150


def test_large_websites_are_not_for_testing_unless_they_must_be() -> None:
    crowd = [task(f"c{n}", "https://crowd.example/", 7) for n in range(50)]
    others = [task(f"o{n}", f"o{n}.example", 1) for n in range(10)]
    config = SplitConfig(test_tasks=10, largest_website=20)
    found = split([*crowd, *others], config)
    assert {each.id for each in for_testing(found.tasks)} == {each.id for each in others}
    assert (
        len(for_testing(split([*crowd, *others], SplitConfig(test_tasks=11, largest_website=20)).tasks)) == 11
    )


def test_children_go_where_their_parents_are() -> None:
    parents = [task(f"p{n}", f"p{n}.example", 3, 3) for n in range(20)]
    children = decompose(parents).derived
    abroad = task("p0+9", "abroad.example", 3, parent_id="p0", rubric=rubric(3))
    found = split([*parents, *children, abroad], SplitConfig(test_tasks=19))
    tests = {each.id for each in for_testing(found.tasks)}
    assert tests <= {each.id for each in parents}
    trained = {each.id for each in found.tasks if each.split == "train"}
    (left,) = {each.id for each in parents} - tests
    assert trained == {left, f"{left}+1", f"{left}+2"} | ({"p0+9"} if left == "p0" else set())


def test_a_task_of_several_websites_is_on_all_of_them() -> None:
    def across(name: str, first: str, second: str) -> Task:
        there = FactTruth(1, 1, evidence=(Evidence(("7",), ".*", second),))
        return task(name, first, truth=Truth(first, (there,), AnswerTruth(), ()))

    shops = [task("a", "alder.example"), across("b", "birch.example", "cedar.example")]
    others = [
        across("into", "elm.example", "www.alder.example"),
        across("out", "fir.example", "cedar.example"),
        task("there", "cedar.example"),
        across("apart", "elm.example", "fir.example"),
    ]
    found = split([*shops, *others], SplitConfig(test_tasks=2), shops)
    assert {each.id: each.split for each in found.tasks} == {"a": "test", "b": "test", "apart": "train"}
    marked = [msgspec.structs.replace(each, split="train") for each in others]
    assert leaking([*found.tasks, *marked]).keys() - {"a", "b"} == {"into", "out", "there"}


@pytest.mark.parametrize("size", [0, 1, 4])
def test_what_was_for_testing_is_never_trained_on(size: int) -> None:
    held = [
        task("t1", "https://a.example/"),
        task("t2", "https://www.a.example/"),
        task("t3+1", "https://b.example/", 3, parent_id="t3"),
        task("dropped", "https://c.example/"),
        task("odd", "nowhere at all"),
    ]
    others = [
        task("t3", "https://d.example/", 3, 1),
        task("dropped+1", "https://e.example/", 3, parent_id="dropped"),
        *(task(f"p{n}", f"https://{site}.example/") for n, site in enumerate("abcfghij")),
    ]
    found = split([*held[:3], held[4], *others], SplitConfig(test_tasks=size), held)
    tests = {each.id for each in for_testing(found.tasks)}
    assert len(tests & {"t1", "t2"}) == 1
    assert "t3+1" in tests
    assert len(tests) == max(size, 2)
    assert {each.id for each in found.tasks} - tests == {f"p{n}" for n in range(3, 8)} - tests


def test_every_website_may_be_for_testing() -> None:
    found = split(many(50, 1), SplitConfig(test_tasks=1))
    assert len(found.tasks) == 1
    assert split([], SplitConfig(test_tasks=0)).tasks == []


PAIRS = st.tuples(st.sampled_from("emh"), st.sampled_from("AB"))


def unevenness(pairs: Sequence[tuple[str, str]]) -> list[int]:
    parts = Counter(pair[0] for pair in pairs), Counter(pair[1] for pair in pairs), Counter(pairs)
    return [sum(count * count for count in part.values()) for part in parts]


@given(st.lists(PAIRS, min_size=1, max_size=8), st.data())
def test_one_pair_per_website_is_made_as_even_as_can_be(
    pairs: list[tuple[str, str]], data: st.DataObject
) -> None:
    from itertools import combinations

    count = data.draw(st.integers(0, len(pairs)))
    chosen = balanced([[pair] for pair in pairs], count)
    assert all(pairs[index] == pair for index, pair in chosen.items())
    levels = min(unevenness(choice)[0] for choice in combinations(pairs, count))
    assert unevenness(list(chosen.values()))[0] == levels


@given(st.lists(st.lists(PAIRS, min_size=1, max_size=3, unique=True), min_size=1, max_size=8), st.data())
def test_no_single_exchange_makes_it_more_even(
    offers: list[list[tuple[str, str]]], data: st.DataObject
) -> None:
    count = data.draw(st.integers(0, len(offers)))
    chosen = balanced(offers, count)
    assert len(chosen) == count
    assert all(pair in offers[index] for index, pair in chosen.items())
    now = unevenness(list(chosen.values()))
    for index in chosen:
        rest = [pair for other, pair in chosen.items() if other != index]
        spare = [index, *(free for free in range(len(offers)) if free not in chosen)]
        assert all(unevenness([*rest, pair]) >= now for free in spare for pair in offers[free])
