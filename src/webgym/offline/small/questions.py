"""Parts of tasks about the records of a small website: clause, evidence, answer and solution.

The clauses are phrases in TOML files: without a full stop, with placeholders in braces. The docstring of a
function names the placeholders of its phrases; loading the phrases checks them.
"""

from __future__ import annotations

import random
import string
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import msgspec

from webgym.core.truth import Evidence, Home, Move, Remember
from webgym.offline.engine.table import Guide, ListPage, Location, Record, Value
from webgym.offline.parts import Fact, Part

NAME = "name"


class Phrases(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Alternative phrases, by kind of question.

    Raises:
        ValueError: a phrase has other placeholders than its kind.
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
    """Placeholders of the phrases, by kind of question."""

    def __post_init__(self) -> None:
        for kind in self.__struct_fields__:
            for phrase in getattr(self, kind):
                check_placeholders(kind, phrase, frozenset(self.placeholders[kind].split()))


def check_placeholders(kind: str, phrase: str, expected: frozenset[str]) -> None:
    """Check the placeholders of a phrase.

    Raises:
        ValueError: they are not the expected ones; the message names the kind and the phrase.
    """
    found = {name for _, name, _, _ in string.Formatter().parse(phrase) if name is not None}
    if found != expected:
        names = ", ".join(sorted(expected)) or "none"
        raise ValueError(f'{kind}: "{phrase}" must have exactly the placeholders {names}')


@dataclass(frozen=True)
class Questions:
    """Makes parts of tasks about the records of a website.

    Attributes:
        guide: where the records are.
        phrases: phrases of the clauses.
        rng: draws phrases.
    """

    guide: Guide
    phrases: Phrases
    rng: random.Random

    def ask(self, kind: str, **values: str) -> str:
        """A random clause of this kind."""
        phrases: tuple[str, ...] = getattr(self.phrases, kind)
        return self.rng.choice(phrases).format(**values)

    # --- kinds of questions -----------------------------------------------------------------------

    def look_up(self, record: Record, field: str) -> Part:
        """Say the value of a field of a record. Placeholders: field, item."""
        ask = self.ask("look_up", field=field, item=record.full_name)
        return self._value_part(record, field, ask, f"The {field} of the {record.name}")

    def either(self, record: Record, field: str, other: str) -> Part:
        """Say which of two values the field has. Placeholders: item, one, two."""
        one, two = self.rng.sample([record.fields[field].text, other], 2)
        ask = self.ask("either", item=record.full_name, one=one, two=two)
        return self._value_part(record, field, ask, f"Which of two is the {field} of the {record.name}")

    def compare(self, first: Record, second: Record, field: str, *, larger: bool) -> Part:
        """Name the record with the smaller or larger value of two. Placeholders: item, other."""
        facts, moves, winner = self.compared(first, second, field, larger=larger)
        kind = "larger" if larger else "smaller"
        named = self._named(f"the one with the {kind} {field} is named", winner, facts[winner.name].evidence)
        return Part(
            ask=self.ask(kind, item=first.full_name, other=second.full_name),
            description=f"Which has the {kind} {field}: {first.name} or {second.name}",
            facts=(*facts.values(), named),
            moves=(*moves, answer_is(winner.name)),
        )

    def compared(
        self, first: Record, second: Record, field: str, *, larger: bool
    ) -> tuple[dict[str, Fact], tuple[Move, ...], Record]:
        """A comparison of two records: the facts by record name, the moves, and the record to name."""
        facts, moves = {}, list[Move]()
        path = ""
        for record in (first, second):
            location, value = self.guide.locate(record), record.fields[field]
            if location.path != path:
                moves += [Home(), *location.moves] if path else location.moves
                path = location.path
            facts[record.name] = Fact(
                f"the {field} of the {record.name} is seen", (field_evidence(location, value),)
            )
            if record is first:
                moves.append(Remember(record.name, value.text))
        winner = max(first, second, key=lambda record: record.rank(field) * (1 if larger else -1))
        return facts, tuple(moves), winner

    def extreme(self, place: str, field: str, *, larger: bool) -> Part:
        """Name the record of a list with the smallest or largest value, which must be unique.

        Placeholders: place.
        """
        pages, kind = self.guide.pages(place), "largest" if larger else "smallest"
        sign = 1 if larger else -1
        best = max(
            (record for page in pages for record in page.records),
            key=lambda record: record.rank(field) * sign,
        )
        facts, moves = list[Fact](), list[Move]()
        best_so_far: Record | None = None
        for number, page in enumerate(pages, start=1):
            moves += page.moves
            best_on_page = max(page.records, key=lambda record: record.rank(field) * sign)
            is_better = (
                best_so_far is None or best_on_page.rank(field) * sign > best_so_far.rank(field) * sign
            )
            if is_better and number < len(pages):
                moves.append(Remember(best_on_page.name, best_on_page.fields[field].text))
            best_so_far = best_on_page if is_better else best_so_far
            facts.append(Fact(f"page {number} of {place} is seen", (list_evidence(page),)))
        last = self._named(f"the one with the {kind} {field} in {place} is named", best, facts[-1].evidence)
        return Part(
            ask=self.ask(kind, place=place),
            description=f"Which has the {kind} {field} in {place}",
            facts=(*facts[:-1], last),
            moves=(*moves, answer_is(best.name)),
        )

    def count(self, place: str, trait: str = "") -> Part:
        """Count the records of a list, or those with a trait. Placeholders: place; with a trait also
        trait."""
        pages = self.guide.pages(place)
        facts, moves, total = list[Fact](), list[Move](), 0
        for number, page in enumerate(pages, start=1):
            matching = sum(not trait or trait in record.traits for record in page.records)
            total += matching
            moves += page.moves
            if number < len(pages):
                moves.append(Remember(f" page {number}", str(matching)))
            facts.append(Fact(f"page {number} of {place} is seen", (list_evidence(page),)))
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
        )

    # --- helpers ----------------------------------------------------------------------------------

    def _value_part(self, record: Record, field: str, ask: str, description: str) -> Part:
        value, location = record.fields[field], self.guide.locate(record)
        evidence = (field_evidence(location, value),)
        return Part(
            ask=ask,
            description=description,
            facts=(self._answered(f"the {field} of the {record.name} is given", value, field, evidence),),
            moves=(*location.moves, answer_is(value.text)),
        )

    def _answered(self, text: str, value: Value, field: str, evidence: tuple[Evidence, ...]) -> Fact:
        return Fact(text, evidence, answer=value.options, wrong=self.wrong_answers(field, value.text))

    def _named(self, text: str, record: Record, evidence: tuple[Evidence, ...]) -> Fact:
        return Fact(text, evidence, answer=(record.name,), wrong=self.wrong_answers(NAME, record.name))

    def wrong_answers(self, field: str, correct: str) -> tuple[str, ...]:
        """All possible answers except the correct one."""
        return tuple(other for other in self.guide.candidates(field) if other != correct)


def answer_is(text: str) -> Remember:
    """The move that notes a part's answer; the key of the note becomes the number of the part."""
    return Remember("", text)


def field_evidence(location: Location, *values: Value) -> Evidence:
    """Evidence: the page that shows these values; those shown as text must be in view."""
    return Evidence(tuple(value.text for value in values if value.is_text), location.path)


def list_evidence(page: ListPage) -> Evidence:
    """Evidence: a page of a list."""
    return Evidence((), page.path)


def sample(rng: random.Random, items: Sequence[Record], count: int) -> list[Record]:
    """``count`` random records, or all if there are fewer, in random order."""
    return rng.sample(list(items), min(count, len(items)))
