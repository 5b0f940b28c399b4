"""Algorithm 1 over tasks."""

from __future__ import annotations

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tests.tasks.making import RUBRICS, rubric, task

from webgym.core.task import Rubric
from webgym.core.truth import AnswerTruth, Truth
from webgym.tasks.published import DIFFICULTY_DIFFERS
from webgym.taskset.decompose import DecompositionLimits, decompose, derive, possible

FREELY = DecompositionLimits(per_parent=10_000)


def test_the_golden_example() -> None:
    derived = derive(task("insta-v3/17", "https://a.example/", 2, 3, 4))
    assert [(each.id, each.difficulty) for each in derived] == [
        ("insta-v3/17+2", 3),
        ("insta-v3/17+3", 4),
        ("insta-v3/17+1-2", 5),
        ("insta-v3/17+1-3", 6),
        ("insta-v3/17+2-3", 7),
    ]


def test_three_facts_and_one_give_exactly_one_task() -> None:
    (only,) = derive(task("s/1", "a.example", 3, 1))
    assert (only.id, only.difficulty, only.parent_id) == ("s/1+1", 3, "s/1")


def test_what_is_inherited_and_what_is_not() -> None:
    parent = task(
        "s/1",
        "https://a.example/x",
        3,
        1,
        subdomain="Music",
        source="deepshop",
        reference_answer="both",
        example_answer="perhaps both",
        split="train",
        website_from="derived",
        flags=("dated", DIFFICULTY_DIFFERS),
        extra={"attempt_level": 2},
        truth=Truth("a.example", (), AnswerTruth(), ()),
    )
    (child,) = derive(parent)
    changed = {"id", "rubric", "parent_id", "flags", "reference_answer", "example_answer", "extra", "truth"}
    assert {
        field for field in parent.__struct_fields__ if getattr(parent, field) != getattr(child, field)
    } == changed
    assert child.flags == ("dated",)
    assert (child.reference_answer, child.example_answer, child.extra, child.truth) == (None, None, {}, None)


@given(RUBRICS)
def test_whatever_the_rubric(whole: Rubric) -> None:
    parent = task("p", rubric=whole)
    derived = derive(parent, FREELY)
    assert len(derived) == possible(whole) == len({child.id for child in derived})
    qualifies = len(whole.groups) >= 2 and any(group.is_large for group in whole.groups)
    assert bool(derived) == qualifies
    seen = set()
    for child in derived:
        groups = set(child.rubric.groups)
        assert groups < set(whole.groups)
        assert any(len(group.facts) >= 3 for group in groups)
        assert child.difficulty == sum(len(group.facts) for group in groups) < parent.difficulty
        assert child.parent_id == "p"
        assert derive(child) == []
        seen.add(frozenset(groups))
    assert len(seen) == len(derived)
    # Nothing that may be taken is left out.
    subsets = range(1, (1 << len(whole.groups)) - 1)
    assert len(derived) == sum(
        any(group.is_large for index, group in enumerate(whole.groups) if mask >> index & 1)
        for mask in subsets
    )


@given(RUBRICS, st.randoms(use_true_random=False), st.integers(1, 20))
def test_ids_do_not_depend_on_the_order_of_the_groups(whole: Rubric, rng: object, at_most: int) -> None:
    shuffled = list(whole.groups)
    rng.shuffle(shuffled)  # type: ignore[attr-defined]
    for limits in (FREELY, DecompositionLimits(per_parent=at_most)):
        one = derive(task("p", rubric=whole), limits)
        other = derive(task("p", rubric=Rubric(tuple(shuffled))), limits)
        assert one == other


@given(RUBRICS, st.integers(0, 40))
def test_a_cap_takes_some_of_them_and_says_so(whole: Rubric, at_most: int) -> None:
    parent = task("p", rubric=whole)
    every = {child.id for child in derive(parent, FREELY)}
    found = decompose([parent], DecompositionLimits(per_parent=at_most))
    assert {child.id for child in found.derived} <= every
    assert len(found.derived) == min(at_most, len(every))
    assert possible(whole) == len(every)
    assert found.capped == (len(every) > at_most)


def test_a_huge_rubric_is_not_enumerated() -> None:
    huge = task("p", "a.example", *[3] * 60)
    assert possible(huge.rubric) == 2**60 - 2
    found = decompose([huge])
    assert len(found.derived) == len({child.id for child in found.derived}) == 1_024
    assert found.capped == 1
    assert found == decompose([huge])


def test_synthetic_sources_give_less() -> None:
    made = task("pae-webvoyager/1", "a.example", 3, 3, 3, source="pae-webvoyager")
    found = decompose([made])
    assert (len(found.derived), possible(made.rubric), found.capped) == (1, 6, 1)
    assert len(decompose([made], DecompositionLimits(synthetic=())).derived) == 6


def test_nothing_comes_of_derived_tasks() -> None:
    parent = task("p", "a.example", 3, 3, 3)
    once = decompose([parent]).derived
    assert decompose([parent, *once]).derived == once
    assert decompose([msgspec.structs.replace(parent, parent_id="elsewhere")]).derived == []
    assert possible(rubric(2, 2)) == possible(rubric(5)) == 0
