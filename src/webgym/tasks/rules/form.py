"""Rules about the rubric as a whole: its shape, its counts, its repetitions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from webgym.tasks.missing_values import is_no_fact
from webgym.tasks.rules.reading import STOP_WORDS
from webgym.tasks.rules.rule import Case, Fact, at

MOST_FACTS: Final = 60
"""More facts than this are a reply that has run wild; the longest tasks of the sources ask for some 40."""

MANY_GROUPS: Final = 10
"""From here on the subsets of groups, and so the tasks derived from one, are counted in thousands."""

_SAYING: Final = re.compile(
    r"\b(?:is|are|was|were|be|been|has|have|correctly|successfully|found|given|reported|stated|provided|shown"
    r"|identified|returned|listed|named|the|a|an)\b|[^\w\s.,%$€£+-]|(?<!\d)[.,]|[.,](?!\d)"
)


def no_groups(case: Case) -> Iterator[str]:
    """A rubric has at least one group, and every group a fact."""
    if not case.draft.fact_groups:
        yield "there is no fact group"
    for group in case.draft.fact_groups:
        if not group.facts:
            yield f"group {group.id} has no facts"


def empty_facts(case: Case) -> Iterator[str]:
    """A fact says something: a blank, ``None`` or ``N/A`` stands for nothing (SOURCES.md, DeepShop)."""
    for group in case.draft.fact_groups:
        for number, fact in enumerate(group.facts, start=1):
            if is_no_fact(fact):
                yield f"fact {number} of group {group.id} is empty: {fact!r}; leave it out"


def no_description(case: Case) -> Iterator[str]:
    """Every group is described."""
    for group in case.draft.fact_groups:
        if is_no_fact(group.description):
            yield f"group {group.id} has no description"


def difficulty(case: Case) -> Iterator[str]:
    """The difficulty is the number of facts (SYSTEM.md 1.1)."""
    count = sum(len(group.facts) for group in case.draft.fact_groups)
    if case.draft.difficulty != count:
        yield f"difficulty is {case.draft.difficulty}, but there are {count} facts"


def ids(case: Case) -> Iterator[str]:
    """Groups are numbered 1 to n, in order: derived tasks are named after the numbers."""
    found = [group.id for group in case.draft.fact_groups]
    if case.asked.derived and found == sorted(set(found)):
        return
    if found != list(range(1, len(found) + 1)):
        yield f"the groups have the ids {', '.join(map(str, found))} instead of 1 to {len(found)}"


def duplicates(case: Case) -> Iterator[str]:
    """No fact stands twice in a group, whatever words of reporting it is dressed in."""
    seen: set[tuple[int, str]] = set()
    for fact in case.facts:
        said = (fact.group, _what_it_says(fact))
        if said in seen:
            yield at(fact, "repeats another fact")
        seen.add(said)


def repetitions(case: Case) -> Iterator[str]:
    """A fact that stands in several groups says which of them it is about."""
    seen: dict[str, int] = {}
    for fact in case.facts:
        if seen.setdefault(_what_it_says(fact), fact.group) != fact.group:
            yield at(fact, "stands in another group in the same words")


def _what_it_says(fact: Fact) -> str:
    return " ".join(_SAYING.sub(" ", fact.text.folded).split()) or fact.text.folded


def restated_task(case: Case) -> Iterator[str]:
    """Among several facts, none is the whole task once more.

    Facts that repeat a long context, each for a part of its own ("the address of ..."), are not.
    """
    wanted = case.task.content
    if len(case.facts) < 2 or len(wanted) < 6:
        return
    for fact in case.facts:
        if len(wanted & fact.text.content) < 0.9 * len(wanted):
            continue
        others = (other for other in case.facts if other is not fact)
        if all(other.text.content & wanted <= fact.text.content for other in others):
            yield at(fact, "restates the whole task beside facts that are parts of it")


def too_many(case: Case) -> Iterator[str]:
    """A rubric stays within what tasks ask for."""
    if len(case.facts) > MOST_FACTS:
        yield f"there are {len(case.facts)} facts; {MOST_FACTS} is the limit"


def many_groups(case: Case) -> Iterator[str]:
    """Few groups: what belongs together stands together."""
    if len(case.draft.fact_groups) > MANY_GROUPS:
        yield f"there are {len(case.draft.fact_groups)} fact groups; put together what belongs together"


def off_task(case: Case) -> Iterator[str]:
    """A fact shares at least a word with the task."""
    known = case.task.stems
    for fact in case.facts:
        content = [word for word in fact.text.words if word not in STOP_WORDS]
        if len(content) >= 3 and not fact.text.content & known:
            yield at(fact, "has no word in common with the task")
