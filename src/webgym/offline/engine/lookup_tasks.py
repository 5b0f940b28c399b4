"""Tasks on the items of a specified website: look up and compare fields.

Most functions take the website, a random generator and a number of facts, and return a part with that many
facts, or ``None`` if the draw gives no well-posed part.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, replace

import msgspec

from webgym.core.truth import Home, Move
from webgym.offline.engine.navigation import Site, field_fact, go_to_item, view_fields
from webgym.offline.engine.records import numeric_value
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, Part


@dataclass(frozen=True)
class Subject:
    """An item that a task is about.

    Attributes:
        site: its website.
        record: the item.
        names_website: whether instructions name the website too, as tasks on several websites must.
    """

    site: Site
    record: Record
    names_website: bool = False

    @property
    def full_name(self) -> str:
        """Its name in instructions."""
        return f"{self.record.name} on {self.site.brand}" if self.names_website else self.record.name

    def fact(self, field: str, *, in_answer: bool = True) -> Fact:
        """The fact that a field of it was found; ``in_answer`` if the answer must contain the value."""
        fact = field_fact(self.site, self.record, field, about=self.full_name, in_answer=in_answer)
        if not self.names_website:
            return fact
        views = (msgspec.structs.replace(view, host=self.site.host) for view in fact.evidence)
        return replace(fact, evidence=tuple(views))

    def moves(self, field: str) -> tuple[Move, ...]:
        """The moves that bring a field of it into view."""
        there = (Home(self.site.start),) if self.names_website else ()
        return (*there, *go_to_item(self.site, self.record), *view_fields(self.site, self.record, [field]))


# --- single items -----------------------------------------------------------------------------------


def ranked(site: Site, *kinds: str) -> list[str]:
    """The fields of these kinds; without kinds, all whose values can be ordered."""
    return [
        field
        for field in site.items.labels
        if site.items.fields[field].kind in (kinds or ("number", "money", "year", "minutes", "day"))
    ]


def facts(site: Site, rng: random.Random, size: int) -> Part | None:
    """Look up fields of an item."""
    if size > min(3, len(site.items.labels)):
        return None
    record, fields = rng.choice(site.items.records), site.items.draw_fields(rng, size)
    return Part(
        f"look up {site.items.nouns(fields)} of {record.name}",
        f"{record.name}: {site.items.nouns(fields)}",
        tuple(field_fact(site, record, field) for field in fields),
        (*go_to_item(site, record), *view_fields(site, record, fields)),
    )


def either(site: Site, rng: random.Random, size: int) -> Part | None:
    """Decide which of two values a choice field of an item has."""
    choices = [field for field in site.items.labels if len(site.items.options[field]) > 1]
    if size != 1 or not choices:
        return None
    record, field = rng.choice(site.items.records), rng.choice(choices)
    value = record.fields[field].text
    other = rng.choice([option for option in site.items.options[field] if option != value])
    one, two = rng.sample([value, other], 2)
    noun = site.items.fields[field].noun
    return Part(
        f'check whether the {noun} of {record.name} is "{one}" or "{two}"',
        f"{record.name}: {noun}",
        (field_fact(site, record, field),),
        (*go_to_item(site, record), *view_fields(site, record, [field])),
    )


def compare(site: Site, rng: random.Random, size: int) -> Part | None:
    """Compare a field of two items."""
    if size != 3:
        return None
    comparable = [field for field in site.items.labels if site.items.fields[field].least]
    field, is_most = rng.choice(comparable), rng.random() < 0.5
    first, second = rng.sample(site.items.records, 2)
    return comparison(Subject(site, first), Subject(site, second), field, is_most=is_most)


def comparison(first: Subject, second: Subject, field: str, *, is_most: bool) -> Part | None:
    """A part that compares a field of two items; ``None`` if the values are equal."""
    if first.record.rank(field) == second.record.rank(field):
        return None
    spec = first.site.items.fields[field]
    word = spec.most if is_most else spec.least
    best, other = sorted((first, second), key=lambda subject: subject.record.rank(field), reverse=is_most)
    named = Fact(
        f"The one with the {word} {spec.noun} is named",
        best.fact(field, in_answer=False).evidence,
        answer=(best.record.name,),
        what=f"the name of the one with the {word} {spec.noun}",
        wrong=(other.record.name,),
    )
    return Part(
        f"look up the {spec.noun} of both {first.full_name} and {second.full_name}, "
        f"and name only the one with the {word} {spec.noun}",
        f"{spec.noun}: {first.full_name} or {second.full_name}",
        (first.fact(field, in_answer=False), second.fact(field, in_answer=False), named),
        (*first.moves(field), *second.moves(field)),
    )


def difference(site: Site, rng: random.Random, size: int) -> Part | None:
    """Report a field of two items, and the difference."""
    fields = ranked(site, "money", "number", "minutes")
    if size != 3 or not fields:
        return None
    field = rng.choice(fields)
    first, second = rng.sample(site.items.records, 2)
    return numeric_difference(Subject(site, first), Subject(site, second), field)


def numeric_difference(first: Subject, second: Subject, field: str) -> Part | None:
    """A part on the difference of a field of two items; ``None`` if it is 0 or equals one of the values."""
    ranks = first.record.rank(field), second.record.rank(field)
    distance = int(abs(ranks[0] - ranks[1]))
    if distance in (0, *ranks):
        return None
    spec = first.site.items.fields[field]
    value = numeric_value(spec, distance, first.site.currency)
    facts = first.fact(field), second.fact(field)
    views = tuple(view for fact in facts for view in fact.evidence)
    return Part(
        f"report the {spec.noun} of {first.full_name} and of {second.full_name}, and the difference",
        f"{spec.noun} of {first.full_name} and {second.full_name}",
        (
            *facts,
            Fact(
                f"The difference in {spec.noun} is worked out",
                views,
                answer=value.options,
                what="the difference",
            ),
        ),
        (*first.moves(field), *second.moves(field)),
    )
