"""What is asked about the items of a specified website.

Every function makes a part with so many facts, or none if the draw does not give a well-posed one.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, replace

import msgspec

from webgym.core.truth import Home, Move
from webgym.offline.engine.navigation import Site, fact, go, look
from webgym.offline.engine.records import written
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, Part


@dataclass(frozen=True)
class Subject:
    """An item that is asked about.

    Attributes:
        site: its website.
        record: the item.
        is_elsewhere: whether the task is about several websites, and has to say which one has the item.
    """

    site: Site
    record: Record
    is_elsewhere: bool = False

    @property
    def called(self) -> str:
        """What instructions call it."""
        return f"{self.record.name} on {self.site.brand}" if self.is_elsewhere else self.record.name

    def fact(self, of: str, *, asked: bool = True) -> Fact:
        """A field of it was seen."""
        found = fact(self.site, self.record, of, about=self.called, asked=asked)
        if not self.is_elsewhere:
            return found
        views = (msgspec.structs.replace(each, host=self.site.host) for each in found.evidence)
        return replace(found, evidence=tuple(views))

    def moves(self, of: str) -> tuple[Move, ...]:
        """Until a field of it was in view."""
        there = (Home(self.site.start),) if self.is_elsewhere else ()
        return (*there, *go(self.site, self.record), *look(self.site, self.record, [of]))


# --- single items -----------------------------------------------------------------------------------


def ranked(site: Site, *kinds: str) -> list[str]:
    """The fields that have an order."""
    return [
        of
        for of in site.items.labels
        if site.items.fields[of].kind in (kinds or ("number", "money", "year", "minutes", "day"))
    ]


def facts(site: Site, rng: random.Random, size: int) -> Part | None:
    """Some fields of an item."""
    if size > min(3, len(site.items.labels)):
        return None
    record, fields = rng.choice(site.items.records), site.items.some(rng, size)
    return Part(
        f"look up {site.items.nouns(fields)} of {record.name}",
        f"{record.name}: {site.items.nouns(fields)}",
        tuple(fact(site, record, of) for of in fields),
        (*go(site, record), *look(site, record, fields)),
        f"For {record.name}, {site.items.told(record, fields)}.",
    )


def either(site: Site, rng: random.Random, size: int) -> Part | None:
    """Which of two values a choice has."""
    choices = [of for of in site.items.labels if len(site.items.options[of]) > 1]
    if size != 1 or not choices:
        return None
    record, of = rng.choice(site.items.records), rng.choice(choices)
    value = record.fields[of].text
    other = rng.choice([each for each in site.items.options[of] if each != value])
    one, two = rng.sample([value, other], 2)
    noun = site.items.fields[of].noun
    return Part(
        f'check whether the {noun} of {record.name} is "{one}" or "{two}"',
        f"{record.name}: {noun}",
        (fact(site, record, of),),
        (*go(site, record), *look(site, record, [of])),
        f"It is {value}.",
    )


def compare(site: Site, rng: random.Random, size: int) -> Part | None:
    """Which of two items has more or less of something."""
    if size != 3:
        return None
    of, is_most = (
        rng.choice([of for of in site.items.labels if site.items.fields[of].least]),
        rng.random() < 0.5,
    )
    one, two = rng.sample(site.items.records, 2)
    return comparison(Subject(site, one), Subject(site, two), of, is_most=is_most)


def comparison(one: Subject, two: Subject, of: str, *, is_most: bool) -> Part | None:
    """Which of two has more or less of something; none if they have as much."""
    if one.record.rank(of) == two.record.rank(of):
        return None
    spec = one.site.items.fields[of]
    word = spec.most if is_most else spec.least
    best, other = sorted((one, two), key=lambda each: each.record.rank(of), reverse=is_most)
    named = Fact(
        f"The one with the {word} {spec.noun} is named",
        best.fact(of, asked=False).evidence,
        answer=(best.record.name,),
        wrong=(other.record.name,),
    )
    return Part(
        f"look up the {spec.noun} of both {one.called} and {two.called}, "
        f"and name only the one with the {word} {spec.noun}",
        f"{spec.noun}: {one.called} or {two.called}",
        (one.fact(of, asked=False), two.fact(of, asked=False), named),
        (*one.moves(of), *two.moves(of)),
        f"It is {best.record.name}.",
    )


def difference(site: Site, rng: random.Random, size: int) -> Part | None:
    """Something of two items, and by how much they differ."""
    fields = ranked(site, "money", "number", "minutes")
    if size != 3 or not fields:
        return None
    of = rng.choice(fields)
    one, two = rng.sample(site.items.records, 2)
    return gap(Subject(site, one), Subject(site, two), of)


def gap(one: Subject, two: Subject, of: str) -> Part | None:
    """By how much two differ in something; none if the difference is one of the values."""
    ranks = one.record.rank(of), two.record.rank(of)
    between = int(abs(ranks[0] - ranks[1]))
    if between in (0, *ranks):
        return None
    spec = one.site.items.fields[of]
    value = written(spec, between, one.site.currency)
    facts = one.fact(of), two.fact(of)
    views = tuple(view for each in facts for view in each.evidence)
    said = [f"{each.record.name} has {each.record.fields[of].text}" for each in (one, two)]
    return Part(
        f"report the {spec.noun} of {one.called} and of {two.called}, and the difference",
        f"{spec.noun} of {one.called} and {two.called}",
        (*facts, Fact(f"The difference in {spec.noun} is worked out", views, answer=value.options)),
        (*one.moves(of), *two.moves(of)),
        f"{said[0]} and {said[1]}, a difference of {value.text}.",
    )
