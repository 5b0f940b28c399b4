"""Rules about the rubric as a whole: its shape, its counts, its repetitions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from webgym.tasks.missing_values import is_no_fact
from webgym.tasks.rules.reading import STOP_WORDS
from webgym.tasks.rules.rule import Case, Fact, message

MOST_FACTS: Final = 60
"""Most facts of a rubric; the longest tasks of the sources ask for about 40."""

MANY_GROUPS: Final = 10
"""Most fact groups; with more, the subsets of groups, and so the derived tasks, are thousands."""

_REPORTING_WORDS: Final = re.compile(
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
    """A fact has content: it is not blank, ``None`` or ``N/A`` (SOURCES.md, DeepShop)."""
    for group in case.draft.fact_groups:
        for number, fact in enumerate(group.facts, start=1):
            if is_no_fact(fact):
                yield f"fact {number} of group {group.id} is empty: {fact!r}; leave it out"


def no_description(case: Case) -> Iterator[str]:
    """Every group has a description."""
    for group in case.draft.fact_groups:
        if is_no_fact(group.description):
            yield f"group {group.id} has no description"


def difficulty(case: Case) -> Iterator[str]:
    """The difficulty is the number of facts (SYSTEM.md 1.1)."""
    count = sum(len(group.facts) for group in case.draft.fact_groups)
    if case.draft.difficulty != count:
        yield f"difficulty is {case.draft.difficulty}, but there are {count} facts"


def ids(case: Case) -> Iterator[str]:
    """Groups are numbered 1 to n, in order: the ids of derived tasks contain the numbers."""
    numbers = [group.id for group in case.draft.fact_groups]
    if case.context.derived and numbers == sorted(set(numbers)):
        return
    if numbers != list(range(1, len(numbers) + 1)):
        yield f"the groups have the ids {', '.join(map(str, numbers))} instead of 1 to {len(numbers)}"


def duplicates(case: Case) -> Iterator[str]:
    """No fact occurs twice in a group, ignoring words such as "is found" and "is reported"."""
    seen: set[tuple[int, str]] = set()
    for fact in case.facts:
        content = (fact.group, _without_reporting_words(fact))
        if content in seen:
            yield message(fact, "repeats another fact")
        seen.add(content)


def repetitions(case: Case) -> Iterator[str]:
    """Facts of different groups are worded differently: each says which group it is about."""
    seen: dict[str, int] = {}
    for fact in case.facts:
        if seen.setdefault(_without_reporting_words(fact), fact.group) != fact.group:
            yield message(fact, "stands in another group in the same words")


def _without_reporting_words(fact: Fact) -> str:
    return " ".join(_REPORTING_WORDS.sub(" ", fact.text.folded).split()) or fact.text.folded


def restated_task(case: Case) -> Iterator[str]:
    """No fact restates the whole task in addition to facts about its parts.

    Facts that each repeat a long context ("the address of ...") do not break this rule.
    """
    wanted = case.task.content
    if len(case.facts) < 2 or len(wanted) < 6:
        return
    for fact in case.facts:
        if len(wanted & fact.text.content) < 0.9 * len(wanted):
            continue
        others = (other for other in case.facts if other is not fact)
        if all(other.text.content & wanted <= fact.text.content for other in others):
            yield message(fact, "restates the whole task beside facts that are parts of it")


def too_many(case: Case) -> Iterator[str]:
    """A rubric has at most :data:`MOST_FACTS` facts."""
    if len(case.facts) > MOST_FACTS:
        yield f"there are {len(case.facts)} facts; {MOST_FACTS} is the limit"


def many_groups(case: Case) -> Iterator[str]:
    """A rubric has few groups."""
    if len(case.draft.fact_groups) > MANY_GROUPS:
        yield f"there are {len(case.draft.fact_groups)} fact groups; put together what belongs together"


def off_task(case: Case) -> Iterator[str]:
    """A fact shares at least one word with the task."""
    known = case.task.stems
    for fact in case.facts:
        content = [word for word in fact.text.words if word not in STOP_WORDS]
        if len(content) >= 3 and not fact.text.content & known:
            yield message(fact, "has no word in common with the task")
