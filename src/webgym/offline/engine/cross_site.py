"""Tasks on two websites: compare an item of each, or enter a value of the first in a form of the second.

The instruction gives the address of the second website; no page links to it.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from webgym.core.truth import Evidence, Home, Move, See
from webgym.offline.engine.item_tasks import (
    Site,
    Subject,
    comparison,
    draw_value,
    fill_form,
    go_to_item,
    numeric_difference,
    ranked,
)
from webgym.offline.engine.spelling import first_up
from webgym.offline.engine.tasks import DRAWS
from webgym.offline.parts import Assignment, Fact, Part, exactly
from webgym.offline.seeds import stream

_CARRIED_KINDS = ("day", "time", "person")
"""Kinds of values that a task takes from one website to a form of the other: ``"for that day"``."""

_TAKES_NOUN = re.compile(r"\b(at|by|for|of|on|with) \{value\}")
"""Matches a form's phrase in which ``"that day"`` can replace the value; not ``"for the patient
{value}"``."""


def assignments(first: Site, twin: Site | None, others: Sequence[Site]) -> Iterator[tuple[Site, Assignment]]:
    """The tasks that start on a website and continue on another.

    Args:
        first: the website on which they start.
        twin: another website of its family to compare with, if there is one.
        others: websites of other families, whose forms are filled in.

    Yields:
        The second website, and the task.
    """
    kinds: list[tuple[str, Site, Callable[[Site, Site, random.Random], Part | None]]] = [
        *([("compare", twin, compare), ("difference", twin, difference)] if twin else []),
        *((f"carry-{nth}", other, carry) for nth, other in enumerate(others, start=1)),
    ]
    for name, second, ask in kinds:
        rng = stream(first.seed, "cross-site", name, second.seed)
        drawn = (ask(first, second, rng) for _ in range(DRAWS))
        part = next((part for part in drawn if part is not None), None)
        if part is not None:
            yield second, Assignment(name, (part,))


def _shared(first: Site, second: Site, fields: Sequence[str]) -> list[str]:
    """Those of ``fields`` that both websites have, with the same noun and units."""
    has_same_money = first.currency == second.currency
    return [
        field
        for field in fields
        if field in second.items.labels
        and first.items.fields[field].noun == second.items.fields[field].noun
        and first.items.fields[field].units == second.items.fields[field].units
        and (has_same_money or first.items.fields[field].kind != "money")
    ]


def _subjects(first: Site, second: Site, rng: random.Random) -> tuple[Subject, Subject] | None:
    """An item of each website; ``None`` if the name of one contains the name of the other."""
    subjects = [Subject(site, rng.choice(site.items.records), names_website=True) for site in (first, second)]
    names = [subject.record.name.casefold() for subject in subjects]
    return None if names[0] in names[1] or names[1] in names[0] else (subjects[0], subjects[1])


def compare(first: Site, second: Site, rng: random.Random) -> Part | None:
    """Compare a field of two items, one on each website."""
    fields = _shared(
        first, second, [field for field in first.items.labels if first.items.fields[field].least]
    )
    subjects = _subjects(first, second, rng)
    if not fields or subjects is None:
        return None
    return comparison(*subjects, rng.choice(fields), is_most=rng.random() < 0.5)


def difference(first: Site, second: Site, rng: random.Random) -> Part | None:
    """Report a field of two items, one on each website, and the difference."""
    fields, subjects = (
        _shared(first, second, ranked(first, "money", "number", "minutes")),
        _subjects(first, second, rng),
    )
    return numeric_difference(*subjects, rng.choice(fields)) if fields and subjects is not None else None


@dataclass(frozen=True)
class _Finding:
    """A value of one website that is entered in a form of another.

    Attributes:
        kind: kind of the input that takes it.
        value: its text as it is entered.
        noun: the noun of its field: ``"next interest day"``.
        fact, moves: the fact that it was found, and the moves that find it.
    """

    kind: str
    value: str
    noun: str
    fact: Fact
    moves: tuple[Move, ...]


def carry(first: Site, second: Site, rng: random.Random) -> Part | None:
    """Fill in a form of the second website with a value of the first."""
    subject = Subject(first, rng.choice(first.items.records), names_website=True)
    finding = rng.choice([*_dates(subject), *_people(subject), None])
    name = rng.choice(sorted(second.spec.forms))
    form = second.spec.forms[name]
    if finding is None:
        return None
    fitting = [
        input_name
        for input_name, spec in form.inputs.items()
        if spec.kind == finding.kind and _TAKES_NOUN.search(spec.said)
    ]
    if not fitting:
        return None
    input_name = rng.choice(fitting)
    choices = second.choices(form.inputs[input_name])
    if choices and finding.value not in choices:
        return None
    values = {key: draw_value(second, spec, rng) for key, spec in form.inputs.items()} | {
        input_name: finding.value
    }
    wording = values | {input_name: f"that {finding.kind}"}
    form_task = fill_form(second, name, rng.choice(second.items.records), values, wording)
    phrase = f"the {finding.noun} of {subject.full_name}"
    return Part(
        f"find out {phrase}; then, on {second.brand}, {form_task.ask}",
        f"{first_up(form_task.what)}, with {phrase}",
        (finding.fact, *form_task.facts),
        (*finding.moves, Home(second.start), *form_task.moves),
    )


def _dates(subject: Subject) -> Iterator[_Finding]:
    items = subject.site.items
    for field in items.labels:
        kind = items.fields[field].kind
        if kind in _CARRIED_KINDS:
            value, noun = subject.record.fields[field].text, items.fields[field].noun
            yield _Finding(kind, value, noun, subject.fact(field, in_answer=False), subject.moves(field))


def _people(subject: Subject) -> Iterator[_Finding]:
    """The people that the item links to, such as its author or agent."""
    site, record = subject.site, subject.record
    for group, person in site.related_records(record):
        if site.spec.groups[group].naming.kind != "person":
            continue
        noun, view = site.spec.groups[group].noun, (site.relation_label(group), person.name)
        evidence = Evidence(view, exactly(site.href(record)), site.host)
        fact = Fact(f"The {noun} of {subject.full_name} is found", (evidence,))
        yield _Finding("person", person.name, noun, fact, (*go_to_item(site, record), See(view)))
