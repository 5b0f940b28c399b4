"""Parts of tasks about the records of a small website: clause, evidence, answer and solution; their words.

The clauses are phrases in a TOML file per family: without a full stop, with placeholders in braces. The
docstring of a function names the placeholders of its phrases.
"""

from __future__ import annotations

import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

from webgym.core.truth import DONE, Evidence, Home, Move, Remember
from webgym.offline.data import load
from webgym.offline.engine.records import Record, Value
from webgym.offline.parts import Fact, Part, Wording
from webgym.offline.small.design import numbers, sign_data

NAME = "name"

Phrases = Mapping[str, tuple[str, ...]]
"""Alternative phrases, by kind of question."""


@lru_cache(maxsize=8)
def phrases(family: str) -> Phrases:
    """The phrases of a family's tasks."""
    return load("webgym.offline.small", f"{family}.toml", dict[str, tuple[str, ...]])


@dataclass(frozen=True)
class Location:
    """Where something can be seen.

    Attributes:
        moves: moves from the front page that bring it into view.
        path: regular expression for the path and query of the page that shows it; matches from start to end.
    """

    moves: tuple[Move, ...]
    path: str


@dataclass(frozen=True)
class ListPage:
    """One page of a list.

    Attributes:
        moves: moves from the page before it, or from the front page for the first page.
        path: as in :class:`Location`.
        records: the records on it, in order.
    """

    moves: tuple[Move, ...]
    path: str
    records: Sequence[Record]


class Guide(Protocol):
    """Where the records of a website can be seen."""

    def locate(self, record: Record) -> Location:
        """The page that shows the fields of a record."""
        ...

    def pages(self, place: str) -> Sequence[ListPage]:
        """The pages of a list."""
        ...

    def candidates(self, field: str) -> Sequence[str]:
        """All possible values of a field; of ``"name"``, all names of records."""
        ...


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
        return self.rng.choice(self.phrases[kind]).format(**values)

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
        named = self.named(f"the one with the {kind} {field} is named", winner, facts[winner.name].evidence)
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
        last = self.named(f"the one with the {kind} {field} in {place} is named", best, facts[-1].evidence)
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
        last = self.answered(
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
            facts=(self.answered(f"the {field} of the {record.name} is given", value, field, evidence),),
            moves=(*location.moves, answer_is(value.text)),
        )

    def answered(self, text: str, value: Value, field: str, evidence: tuple[Evidence, ...]) -> Fact:
        """A fact whose value the answer gives."""
        return Fact(text, evidence, answer=value.options, wrong=self.wrong_answers(field, value.text))

    def named(self, text: str, record: Record, evidence: tuple[Evidence, ...]) -> Fact:
        """A fact whose record the answer names."""
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


# --- words ------------------------------------------------------------------------------------------------


FAMILY_NAMES = ("board", "desk", "market", "signpost", "trail")

KEYS = ("sign", "page", "note")
"""Words of memory keys, in addition to names of things and numbers of parts."""


def _instruct(brand: str, asks: Sequence[str]) -> str:
    del brand
    first, *others = asks
    joined = (f", {'and' if nth == len(others) else 'then'} {ask}" for nth, ask in enumerate(others, start=1))
    return first + "".join(joined)


WORDING = Wording("small", _instruct, form="small", separator=", ", keeps_count=True)
"""Clauses in lower case; the answer is the values of the parts, separated by commas."""


@lru_cache(maxsize=1)
def small_vocabulary() -> tuple[str, ...]:
    """Every word of the small websites' instructions, answers, memory and page elements, and the comma."""
    signs = sign_data()
    words = {",", DONE, "then", "and", "from", *KEYS, *numbers()}
    words |= {*signs.colors, *signs.icons, *signs.controls, *signs.words}
    for family in FAMILY_NAMES:
        for alternatives in phrases(family).values():
            words.update(word for phrase in alternatives for word in words_of(re.sub(r"\{\w+\}", "", phrase)))
    words |= {"number", "word", "sign", "signs", "first"}  # names of fields and places
    return tuple(sorted(words))


def words_of(text: str) -> list[str]:
    """Split a text into words of the vocabulary; a comma is a word."""
    return re.findall(r"[a-z0-9]+|[^\sa-z0-9]", text)
