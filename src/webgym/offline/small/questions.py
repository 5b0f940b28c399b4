"""From a table to parts of tasks: what is asked, what proves it, what answers it, and how it is solved.

Phrases are data. A phrase is a clause without a full stop with placeholders in braces; which ones a kind of
question has is said at its function and checked when the phrases are read.
"""

from __future__ import annotations

import random
import string
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import msgspec

from webgym.core.truth import Evidence, Home, Move, Remember
from webgym.offline.engine.table import Guide, ListPage, Record, Shown, Value
from webgym.offline.parts import Fact, Part

NAME = "name"


class Phrases(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Ways to ask, by kind of question.

    Raises:
        ValueError: a phrase lacks a placeholder of its kind or has another.
    """

    look_up: tuple[str, ...] = ()
    smaller: tuple[str, ...] = ()
    larger: tuple[str, ...] = ()
    smallest: tuple[str, ...] = ()
    largest: tuple[str, ...] = ()
    count_all: tuple[str, ...] = ()
    count: tuple[str, ...] = ()
    either: tuple[str, ...] = ()
    buy: tuple[str, ...] = ()
    buy_and_say: tuple[str, ...] = ()
    buy_smaller: tuple[str, ...] = ()

    placeholders: ClassVar[dict[str, str]] = {
        "look_up": "field item",
        "smaller": "item other",
        "larger": "item other",
        "smallest": "place",
        "largest": "place",
        "count_all": "place",
        "count": "trait place",
        "either": "item one two",
        "buy": "item",
        "buy_and_say": "item",
        "buy_smaller": "item other",
    }
    """Of every kind of question; each of its phrases has all of them."""

    def __post_init__(self) -> None:
        for kind in self.__struct_fields__:
            for phrase in getattr(self, kind):
                check_placeholders(kind, phrase, frozenset(self.placeholders[kind].split()))


def check_placeholders(kind: str, phrase: str, wanted: frozenset[str]) -> None:
    """Refuse a phrase whose placeholders are not ``wanted``.

    Raises:
        ValueError: they are not; the message names the kind and the phrase.
    """
    found = {name for _, name, _, _ in string.Formatter().parse(phrase) if name is not None}
    if found != wanted:
        told = ", ".join(sorted(wanted)) or "none"
        raise ValueError(f'{kind}: "{phrase}" must have the placeholders {told}')


@dataclass(frozen=True)
class Questions:
    """Makes parts of tasks from a website's table.

    Attributes:
        guide: the way to what is asked for.
        phrases: how to ask.
        rng: chooses among phrases.
    """

    guide: Guide
    phrases: Phrases
    rng: random.Random

    def ask(self, kind: str, **values: str) -> str:
        """A clause of this kind."""
        phrases: tuple[str, ...] = getattr(self.phrases, kind)
        return self.rng.choice(phrases).format(**values)

    # --- kinds of questions -----------------------------------------------------------------------

    def look_up(self, record: Record, of: str) -> Part:
        """The value of a field of a record. Placeholders: field, item."""
        value, shown = record.fields[of], self.guide.way(record)
        fact = self._answered(f"the {of} of the {record.name} is given", value, of, (seen(shown, value),))
        return Part(
            ask=self.ask("look_up", field=of, item=record.called),
            description=f"The {of} of the {record.name}",
            facts=(fact,),
            moves=(*shown.moves, answer_is(value.text)),
            says=value.text,
        )

    def either(self, record: Record, of: str, other: str) -> Part:
        """Which of two values the field has. Placeholders: item, one, two."""
        value, shown = record.fields[of], self.guide.way(record)
        one, two = self.rng.sample([value.text, other], 2)
        fact = self._answered(f"the {of} of the {record.name} is given", value, of, (seen(shown, value),))
        return Part(
            ask=self.ask("either", item=record.called, one=one, two=two),
            description=f"Which of two is the {of} of the {record.name}",
            facts=(fact,),
            moves=(*shown.moves, answer_is(value.text)),
            says=value.text,
        )

    def compare(self, first: Record, second: Record, of: str, *, larger: bool) -> Part:
        """Which of two records has the smaller or larger value. Placeholders: item, other."""
        looked, moves, winner = self.compared(first, second, of, larger=larger)
        kind = "larger" if larger else "smaller"
        named = self._named(f"the one with the {kind} {of} is named", winner, looked[winner.name].evidence)
        return Part(
            ask=self.ask(kind, item=first.called, other=second.called),
            description=f"Which has the {kind} {of}: {first.name} or {second.name}",
            facts=(*looked.values(), named),
            moves=(*moves, answer_is(winner.name)),
            says=winner.name,
        )

    def compared(
        self, first: Record, second: Record, of: str, *, larger: bool
    ) -> tuple[dict[str, Fact], tuple[Move, ...], Record]:
        """What a comparison takes: the facts of both records by name, the moves, and which one it is."""
        facts, moves = {}, list[Move]()
        path = ""
        for record in (first, second):
            shown, value = self.guide.way(record), record.fields[of]
            if shown.path != path:
                moves += [Home(), *shown.moves] if path else shown.moves
                path = shown.path
            facts[record.name] = Fact(f"the {of} of the {record.name} is seen", (seen(shown, value),))
            if record is first:
                moves.append(Remember(record.name, value.text))
        winner = max(first, second, key=lambda record: record.rank(of) * (1 if larger else -1))
        return facts, tuple(moves), winner

    def extreme(self, place: str, of: str, *, larger: bool) -> Part:
        """Which record of a list has the smallest or largest value, which must be one alone.

        Placeholders: place.
        """
        pages, kind = self.guide.pages(place), "largest" if larger else "smallest"
        sign = 1 if larger else -1
        best = max((each for page in pages for each in page.records), key=lambda each: each.rank(of) * sign)
        facts, moves = list[Fact](), list[Move]()
        so_far: Record | None = None
        for number, page in enumerate(pages, start=1):
            moves += page.moves
            top = max(page.records, key=lambda each: each.rank(of) * sign)
            is_better = so_far is None or top.rank(of) * sign > so_far.rank(of) * sign
            if is_better and number < len(pages):
                moves.append(Remember(top.name, top.fields[of].text))
            so_far = top if is_better else so_far
            facts.append(Fact(f"page {number} of {place} is seen", (on(page),)))
        last = self._named(f"the one with the {kind} {of} in {place} is named", best, facts[-1].evidence)
        return Part(
            ask=self.ask(kind, place=place),
            description=f"Which has the {kind} {of} in {place}",
            facts=(*facts[:-1], last),
            moves=(*moves, answer_is(best.name)),
            says=best.name,
        )

    def count(self, place: str, trait: str = "") -> Part:
        """How many records a list has, or how many with a trait. Placeholders: place; trait."""
        pages = self.guide.pages(place)
        facts, moves, total = list[Fact](), list[Move](), 0
        for number, page in enumerate(pages, start=1):
            found = sum(not trait or trait in record.traits for record in page.records)
            total += found
            moves += page.moves
            if number < len(pages):
                moves.append(Remember(f" page {number}", str(found)))
            facts.append(Fact(f"page {number} of {place} is seen", (on(page),)))
        value = Value(str(total))
        last = self._answered(
            f"the {trait or 'things'} in {place} are counted", value, "number", facts[-1].evidence
        )
        ask = self.ask("count", trait=trait, place=place) if trait else self.ask("count_all", place=place)
        return Part(
            ask=ask,
            description=f"How many {trait} things are in {place}".replace("  ", " "),
            facts=(*facts[:-1], last),
            moves=(*moves, answer_is(value.text)),
            says=value.text,
        )

    # --- what they have in common -----------------------------------------------------------------

    def _answered(self, text: str, value: Value, of: str, evidence: tuple[Evidence, ...]) -> Fact:
        return Fact(text, evidence, answer=value.options, wrong=self.others(of, value.text))

    def _named(self, text: str, record: Record, evidence: tuple[Evidence, ...]) -> Fact:
        return Fact(text, evidence, answer=(record.name,), wrong=self.others(NAME, record.name))

    def others(self, of: str, right: str) -> tuple[str, ...]:
        """What an answer could name, but must not."""
        return tuple(other for other in self.guide.candidates(of) if other != right)


def answer_is(text: str) -> Remember:
    """Remember what a part is answered by; the entry is named after the part."""
    return Remember("", text)


def seen(shown: Shown, *values: Value) -> Evidence:
    """The page that shows these values, with those of them that are text in view."""
    return Evidence(tuple(value.text for value in values if value.is_text), shown.path)


def on(page: ListPage) -> Evidence:
    """The page of a list."""
    return Evidence((), page.path)


def some(rng: random.Random, items: Sequence[Record], count: int) -> list[Record]:
    """At most ``count`` of the records, in a random order."""
    return rng.sample(list(items), min(count, len(items)))
