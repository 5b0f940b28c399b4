"""Records with values: of small websites, and drawn and spelled for pages and answers of specified ones."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from itertools import product

from webgym.offline import names
from webgym.offline.engine.spec import FieldSpec, NamingSpec
from webgym.offline.engine.spelling import count, days, minutes, money, quantity, the, times
from webgym.offline.parts import Fact, shown
from webgym.offline.seeds import pick, stream
from webgym.offline.website import TODAY


@dataclass(frozen=True)
class Value:
    """The value of a field.

    Attributes:
        text: its text on the page.
        spellings: other texts that an answer may use for it.
        rank: number by which values of the field are ordered; ``None`` if they have no order.
        is_text: whether the page shows it as text; if not, it is a picture, and evidence is the page's
            address alone.
    """

    text: str
    spellings: tuple[str, ...] = ()
    rank: float | None = None
    is_text: bool = True

    @property
    def options(self) -> tuple[str, ...]:
        """All accepted spellings."""
        return (self.text, *self.spellings)


@dataclass(frozen=True)
class Record:
    """A record.

    Attributes:
        name: its name on pages and in instructions.
        fields: its values, by field.
        traits: words by which instructions can select it for counting.
        place: name of the list that has it, where instructions must give it; empty if the name is enough.
    """

    name: str
    fields: Mapping[str, Value]
    traits: frozenset[str] = frozenset()
    place: str = ""

    @property
    def full_name(self) -> str:
        """The name in instructions, with the place if there is one."""
        return f"{self.name} from {self.place}" if self.place else self.name

    def rank(self, field_name: str) -> float:
        """The rank of a field's value.

        Raises:
            ValueError: the field has no order.
        """
        rank = self.fields[field_name].rank
        if rank is None:
            raise ValueError(f"the {field_name} of {self.name} has no rank")
        return rank


@dataclass(frozen=True)
class Sheet:
    """A table of records with the same fields.

    Attributes:
        fields: specifications of the fields that this website has, by name, in page order.
        labels: the text that pages show beside each value, by field.
        options: possible values of each choice field; empty for other fields.
        records: all of them.
    """

    fields: Mapping[str, FieldSpec]
    labels: Mapping[str, str]
    options: Mapping[str, tuple[str, ...]]
    records: tuple[Record, ...]

    def nouns(self, fields: Sequence[str]) -> str:
        """The nouns of fields: ``"the rent and the deposit"``."""
        return the([self.fields[field].noun for field in fields])

    def view(self, record: Record, field: str) -> tuple[str, ...]:
        """The texts by which a page shows a field: its label and value, or its sentence."""
        text, sentence = record.fields[field].text, self.fields[field].prose
        return (sentence.format(value=text),) if sentence else (self.labels[field], text)

    def draw_fields(self, rng: random.Random, count: int) -> list[str]:
        """``count`` random fields, in page order."""
        return sorted(rng.sample(list(self.labels), count), key=list(self.labels).index)

    def fact(
        self, record: Record, field: str, path: str, *texts: str, about: str = "", in_answer: bool = True
    ) -> Fact:
        """The fact that a field of a record was found.

        Args:
            record: the record.
            field: name of the field.
            path: regular expression for the address of the page that shows it.
            texts: other texts that must be in view at the same time.
            about: what the fact's text calls the record, where its name would reveal an answer.
            in_answer: whether the answer must contain the value.
        """
        value = record.fields[field]
        others = tuple(option for option in self.options[field] if option != value.text)
        return Fact(
            f"The {self.fields[field].noun} of {about or record.full_name} is found",
            (shown(path, *texts, *self.view(record, field)),),
            answer=value.options if in_answer else (),
            what=f"the {self.fields[field].noun} of {about or record.full_name}",
            wrong=others if in_answer else (),
        )


def draw_sheet(
    fields: Mapping[str, FieldSpec],
    names: Sequence[str],
    currency: str,
    *seeds: object,
    labelled_by: tuple[object, ...] = (),
) -> Sheet:
    """Draw records with these names.

    Args:
        fields: specifications of the possible fields; an optional field is on two of three websites.
        names: names of the records.
        currency: sign before amounts of money.
        seeds: seed of the values.
        labelled_by: seed of the labels, the options and the presence of fields, where several sheets
            share them; ``seeds`` if empty.
    """
    label_seeds = labelled_by or seeds
    present = {
        name: spec
        for name, spec in fields.items()
        if not spec.optional or pick((1, 1, 0), *label_seeds, name)
    }
    labels = {name: pick(spec.labels, *label_seeds, "label", name) for name, spec in present.items()}
    options = {
        name: options_of(spec, stream(*label_seeds, "options", name)) for name, spec in present.items()
    }

    def record(name: str) -> Record:
        rng = stream(*seeds, "item", name)
        values = {field: draw_value(spec, options[field], currency, rng) for field, spec in present.items()}
        return Record(name, values)

    return Sheet(present, labels, options, tuple(map(record, names)))


def with_implied_values(drawn: Sheet, follows: Mapping[str, Mapping[str, Sequence[str]]]) -> Sheet:
    """The sheet with the values that a record's name implies: a "Ward Nurse" works in nursing."""

    def corrected(record: Record) -> Record:
        fields = dict(record.fields)
        for field, words in follows.items():
            for value, endings in words.items():
                if record.name.endswith(tuple(endings)):
                    fields[field] = Value(value)
        return replace(record, fields=fields)

    options = dict(drawn.options) | {field: tuple(words) for field, words in follows.items()}
    return replace(drawn, options=options, records=tuple(map(corrected, drawn.records))) if follows else drawn


def draw_names(naming: NamingSpec, rng: random.Random, count: int) -> list[str]:
    """``count`` different names."""
    match naming.kind:
        case "words":
            pairs = product(naming.first, naming.second)
            return rng.sample([f"{first}{naming.between}{second}" for first, second in pairs], count)
        case "list":
            return rng.sample(naming.first, count)
        case "person":
            stems = names.people(rng, count)
        case "town":
            stems = names.towns(rng, count)
        case "brand":
            stems = rng.sample([a + b for a, b in product(names.FIRST, names.SECOND)], count)

    def full_name(stem: str) -> str:
        prefix = f"{rng.choice(naming.first)} " if naming.first else ""
        suffix = f" {rng.choice(naming.second)}" if naming.second else ""
        return f"{prefix}{stem}{suffix}"

    return [full_name(stem) for stem in stems]


def options_of(spec: FieldSpec, rng: random.Random) -> tuple[str, ...]:
    """The options of a choice field on one website, in the order of the specification."""
    chosen = set(rng.sample(spec.options, min(spec.take or len(spec.options), len(spec.options))))
    return tuple(option for option in spec.options if option in chosen)


def draw_value(spec: FieldSpec, options: Sequence[str], currency: str, rng: random.Random) -> Value:
    """Draw a value of a field.

    Args:
        spec: the field.
        options: of a choice field, on this website.
        currency: sign before amounts of money.
        rng: source of randomness.
    """
    if spec.kind == "choice":
        return Value(rng.choice(options))
    return numeric_value(spec, rng.randrange(spec.low, spec.high + 1, spec.step), currency)


def numeric_value(spec: FieldSpec, number: int, currency: str) -> Value:
    """The value of a numeric field: the text on pages, other spellings in answers, and the number as rank."""
    match spec.kind:
        case "money":
            text, *spellings = money(number, currency)
        case "year":
            text, *spellings = (str(number),)
        case "day":
            text, *spellings = days(TODAY + timedelta(days=number))
        case "time":
            text, *spellings = times(number)
        case "minutes":
            text, *spellings = minutes(number)
        case _ if spec.units:
            text, *spellings = quantity(number, *spec.units)
        case _:
            text, *spellings = (f"{number:,}", str(number), *count(number))
    different = dict.fromkeys(spellings)
    different.pop(text, None)
    return Value(text, tuple(different), number)
