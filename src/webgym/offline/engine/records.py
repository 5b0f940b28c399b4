"""Records of a specified website: values that are drawn, and how pages and answers write them."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from itertools import product

from webgym.offline import names
from webgym.offline.engine.spec import FieldSpec, NamingSpec
from webgym.offline.engine.spelling import BARE_FROM, count, days, listed, minutes, quantity, the, times
from webgym.offline.engine.table import Record, Value
from webgym.offline.parts import Fact, shown
from webgym.offline.seeds import pick, stream
from webgym.offline.website import TODAY


@dataclass(frozen=True)
class Sheet:
    """Records with the same fields.

    Attributes:
        fields: those that this website has, by name, in the order of the page.
        labels: what it calls them.
        options: of choices; empty for other fields.
        records: all of them.
    """

    fields: Mapping[str, FieldSpec]
    labels: Mapping[str, str]
    options: Mapping[str, tuple[str, ...]]
    records: tuple[Record, ...]

    def nouns(self, fields: Sequence[str]) -> str:
        """``"the rent and the deposit"``."""
        return the([self.fields[of].noun for of in fields])

    def view(self, record: Record, of: str) -> tuple[str, ...]:
        """What a page shows together where it shows a field: its label and value, or its sentence."""
        text, sentence = record.fields[of].text, self.fields[of].prose
        return (sentence.format(value=text),) if sentence else (self.labels[of], text)

    def told(self, record: Record, fields: Sequence[str]) -> str:
        """``"the rent is €900 and the deposit is €1,800"``."""
        return listed([f"the {self.fields[of].noun} is {record.fields[of].text}" for of in fields])

    def some(self, rng: random.Random, count: int) -> list[str]:
        """So many of its fields, in order."""
        return sorted(rng.sample(list(self.labels), count), key=list(self.labels).index)

    def fact(
        self, record: Record, of: str, path: str, *with_it: str, about: str = "", asked: bool = True
    ) -> Fact:
        """A field of a record was seen, and told where it is asked for.

        Args:
            record: the record.
            of: its field.
            path: pattern of the address that shows it.
            with_it: what else must be in view with it.
            about: whose it is, where its name would give an answer away.
            asked: whether the answer must have it.
        """
        value = record.fields[of]
        others = tuple(each for each in self.options[of] if each != value.text)
        return Fact(
            f"The {self.fields[of].noun} of {about or record.called} is found",
            (shown(path, *with_it, *self.view(record, of)),),
            answer=value.options if asked else (),
            wrong=others if asked else (),
        )


def sheet(
    fields: Mapping[str, FieldSpec],
    names: Sequence[str],
    currency: str,
    *seeds: object,
    labelled_by: tuple[object, ...] = (),
) -> Sheet:
    """Draw records with these names.

    Args:
        fields: that they may have; optional ones are drawn.
        names: of the records.
        currency: sign that stands before money.
        seeds: of this sheet.
        labelled_by: of what it shares with other sheets: labels, options, and which fields there are.
    """
    by = labelled_by or seeds
    has = {name: each for name, each in fields.items() if not each.optional or pick((1, 1, 0), *by, name)}
    labels = {name: pick(each.labels, *by, "label", name) for name, each in has.items()}
    options = {name: options_of(each, stream(*by, "options", name)) for name, each in has.items()}

    def record(name: str) -> Record:
        rng = stream(*seeds, "item", name)
        return Record(name, {of: draw(each, options[of], currency, rng) for of, each in has.items()})

    return Sheet(has, labels, options, tuple(map(record, names)))


def following(drawn: Sheet, follows: Mapping[str, Mapping[str, Sequence[str]]]) -> Sheet:
    """The same with the values that follow from a record's name: a "Ward Nurse" works in nursing."""

    def right(record: Record) -> Record:
        fields = dict(record.fields)
        for of, words in follows.items():
            for value, endings in words.items():
                if record.name.endswith(tuple(endings)):
                    fields[of] = Value(value)
        return replace(record, fields=fields)

    options = dict(drawn.options) | {of: tuple(words) for of, words in follows.items()}
    return replace(drawn, options=options, records=tuple(map(right, drawn.records))) if follows else drawn


def named(naming: NamingSpec, rng: random.Random, count: int) -> list[str]:
    """So many different names."""
    match naming.kind:
        case "words":
            pairs = product(naming.first, naming.second)
            return rng.sample([f"{one}{naming.between}{two}" for one, two in pairs], count)
        case "list":
            return rng.sample(naming.first, count)
        case "person":
            stems = names.people(rng, count)
        case "town":
            stems = names.towns(rng, count)
        case "brand":
            stems = rng.sample([a + b for a, b in product(names.FIRST, names.SECOND)], count)

    def whole(stem: str) -> str:
        before = f"{rng.choice(naming.first)} " if naming.first else ""
        behind = f" {rng.choice(naming.second)}" if naming.second else ""
        return f"{before}{stem}{behind}"

    return [whole(stem) for stem in stems]


def options_of(spec: FieldSpec, rng: random.Random) -> tuple[str, ...]:
    """The options of a choice that a website has."""
    chosen = set(rng.sample(spec.options, min(spec.take or len(spec.options), len(spec.options))))
    return tuple(option for option in spec.options if option in chosen)


def draw(spec: FieldSpec, options: Sequence[str], currency: str, rng: random.Random) -> Value:
    """A value of a field.

    Args:
        spec: the field.
        options: of a choice, that the website has.
        currency: sign that stands before money.
        rng: draws.
    """
    if spec.kind == "choice":
        return Value(rng.choice(options))
    return written(spec, rng.randrange(spec.low, spec.high + 1, spec.step), currency)


def written(spec: FieldSpec, number: int, currency: str) -> Value:
    """A number of a field, in the words of pages and of answers; its rank is the number."""
    ways: tuple[str, ...]
    match spec.kind:
        case "money":
            text = f"{currency}{number:,}"
            ways = (f"{number:,}", str(number)) if number >= BARE_FROM else ()
        case "year":
            text, ways = str(number), ()
        case "day":
            text, *others = days(TODAY + timedelta(days=number))
            ways = tuple(others)
        case "time":
            text, *others = times(number)
            ways = tuple(others)
        case "minutes":
            text, *others = minutes(number)
            ways = tuple(others)
        case _ if spec.units:
            text, *others = quantity(f"{number:,}", *spec.units)
            ways = (*others, *quantity(str(number), *spec.units))
        case _:
            text, *others = (f"{number:,}", str(number), *count(number))
            ways = tuple(others)
    return Value(text, tuple(dict.fromkeys(way for way in ways if way != text)), number)
