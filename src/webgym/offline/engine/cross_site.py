"""Tasks on two websites: what one says is compared with what the other says, or entered there.

The instruction names the second website's address; nothing leads there but the address.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from webgym.core.truth import Evidence, Home, Move, See
from webgym.offline.engine.composer import DRAWS
from webgym.offline.engine.form_tasks import entry, filled
from webgym.offline.engine.lookup_tasks import Subject, comparison, gap, ranked
from webgym.offline.engine.navigation import Site, go
from webgym.offline.engine.spelling import first_up
from webgym.offline.parts import Assignment, Fact, Part, exactly
from webgym.offline.seeds import stream

_KINDS = ("day", "time", "person")
"""What can be carried: instructions say ``"for that day"``."""

_TAKES_NOUN = re.compile(r"\b(at|by|for|of|on|with) \{value\}")
"""A phrase of a form in which ``"that day"`` can stand: not ``"for the patient {value}"``."""


def assignments(one: Site, twin: Site | None, others: Sequence[Site]) -> Iterator[tuple[Site, Assignment]]:
    """Tasks that begin on a website and go on on another.

    Args:
        one: where they begin.
        twin: another website of its family, to compare with, if there is one.
        others: websites of other families, with forms to fill in.

    Yields:
        The second website, and the task.
    """
    kinds: list[tuple[str, Site, Callable[[Site, Site, random.Random], Part | None]]] = [
        *([("compare", twin, compare), ("difference", twin, difference)] if twin else []),
        *((f"carry-{nth}", other, carry) for nth, other in enumerate(others, start=1)),
    ]
    for name, two, ask in kinds:
        rng = stream(one.seed, "cross-site", name, two.seed)
        drawn = (ask(one, two, rng) for _ in range(DRAWS))
        part = next((part for part in drawn if part is not None), None)
        if part is not None:
            yield two, Assignment(name, (part,))


def _shared(one: Site, two: Site, fields: Sequence[str]) -> list[str]:
    """Those of a website's fields that another has, in the same words and units."""
    has_same_money = one.currency == two.currency
    return [
        of
        for of in fields
        if of in two.items.labels
        and one.items.fields[of].noun == two.items.fields[of].noun
        and one.items.fields[of].units == two.items.fields[of].units
        and (has_same_money or one.items.fields[of].kind != "money")
    ]


def _subjects(one: Site, two: Site, rng: random.Random) -> tuple[Subject, Subject] | None:
    """An item of each, neither of which is called as the other is."""
    first, second = (Subject(site, rng.choice(site.items.records), is_elsewhere=True) for site in (one, two))
    names = [each.record.name.casefold() for each in (first, second)]
    return None if names[0] in names[1] or names[1] in names[0] else (first, second)


def compare(one: Site, two: Site, rng: random.Random) -> Part | None:
    """Which of two items, one on each website, has more or less of something."""
    fields = _shared(one, two, [of for of in one.items.labels if one.items.fields[of].least])
    found = _subjects(one, two, rng)
    if not fields or found is None:
        return None
    return comparison(*found, rng.choice(fields), is_most=rng.random() < 0.5)


def difference(one: Site, two: Site, rng: random.Random) -> Part | None:
    """By how much two items, one on each website, differ in something."""
    fields, found = _shared(one, two, ranked(one, "money", "number", "minutes")), _subjects(one, two, rng)
    return gap(*found, rng.choice(fields)) if fields and found is not None else None


@dataclass(frozen=True)
class _Found:
    """What one website says and the other asks for.

    Attributes:
        kind: of the input that takes it.
        value: as it is entered.
        noun: what it is to its item: ``"next interest day"``.
        fact, moves: of finding it.
    """

    kind: str
    value: str
    noun: str
    fact: Fact
    moves: tuple[Move, ...]


def carry(one: Site, two: Site, rng: random.Random) -> Part | None:
    """A form of one website, filled in with what the other says."""
    subject = Subject(one, rng.choice(one.items.records), is_elsewhere=True)
    found = rng.choice([*_dates(subject), *_people(subject), None])
    name = rng.choice(sorted(two.spec.forms))
    form = two.spec.forms[name]
    if found is None:
        return None
    fitting = [
        of for of, given in form.inputs.items() if given.kind == found.kind and _TAKES_NOUN.search(given.said)
    ]
    if not fitting:
        return None
    of = rng.choice(fitting)
    choices = two.choices(form.inputs[of])
    if choices and found.value not in choices:
        return None
    values = {each: entry(two, given, rng) for each, given in form.inputs.items()} | {of: found.value}
    called = values | {of: f"that {found.kind}"}
    sent = filled(two, name, rng.choice(two.items.records), values, called)
    whose = f"the {found.noun} of {subject.called}"
    return Part(
        f"find out {whose}; then, on {two.brand}, {sent.ask}",
        f"{first_up(sent.what)}, with {whose}",
        (found.fact, *sent.facts),
        (*found.moves, Home(two.start), *sent.moves),
    )


def _dates(subject: Subject) -> Iterator[_Found]:
    items = subject.site.items
    for of in items.labels:
        kind = items.fields[of].kind
        if kind in _KINDS:
            value, noun = subject.record.fields[of].text, items.fields[of].noun
            yield _Found(kind, value, noun, subject.fact(of, asked=False), subject.moves(of))


def _people(subject: Subject) -> Iterator[_Found]:
    """Whom the item leads to: its author, its agent."""
    site, record = subject.site, subject.record
    for group, person in site.owners(record):
        if site.spec.groups[group].naming.kind != "person":
            continue
        noun, view = site.spec.groups[group].noun, (site.owner_label(group), person.name)
        evidence = Evidence(view, exactly(site.href(record)), site.host)
        fact = Fact(f"The {noun} of {subject.called} is found", (evidence,))
        yield _Found("person", person.name, noun, fact, (*go(site, record), See(view)))
