"""Shops: things in sections, each with a number as its price and sometimes a word; and a cart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, ClassVar

from webgym.core.truth import Click, Evidence, Home, StateCheck
from webgym.offline.data import load
from webgym.offline.engine.table import Record, Value
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import pick, stream
from webgym.offline.small.catalog import Catalog
from webgym.offline.small.questions import Phrases, Questions, answer_is, field_evidence, sample
from webgym.offline.small.screen import Block, Tile, singles
from webgym.offline.small.signs import Sign, control, numbers
from webgym.offline.website import Response, State, Visit, page, redirect


@lru_cache(maxsize=1)
def phrases() -> Phrases:
    """The phrases of a shop's tasks."""
    return load("webgym.offline.small", "market.toml", Phrases)


class Market(Catalog):
    """A shop."""

    family: ClassVar[str] = "market"
    topic: ClassVar[tuple[str, str]] = ("Lifestyle & Leisure", "Shopping")

    @property
    def has_words(self) -> bool:
        """Whether the page of a thing also shows a word."""
        return pick((True, False), self.seed, "has words")

    def fields(self, thing: Sign) -> dict[str, Value]:
        """The values of a thing: a number, and a word on websites with words."""
        values = super().fields(thing)
        if self.has_words:
            values["word"] = Value(pick(self.design.stock.words, self.seed, "word", thing.name))
        return values

    def candidates(self, field: str) -> tuple[str, ...]:
        """All possible values of a field, or all names of things."""
        return self.design.stock.words if field == "word" else tuple(super().candidates(field))

    def report(self, state: State) -> dict[str, Any]:
        """The server state: the number of each thing in the cart."""
        return {"cart": contents(state)}

    def controls(self, visit: Visit) -> list[Tile]:
        """The controls of every page, with the cart."""
        return [*super().controls(visit), Tile(control("cart"), None if visit.path == "/cart" else "/cart")]

    def thing_blocks(self, record: Record) -> list[Block]:
        """The thing, its values, and the button that adds it to the cart."""
        blocks = list(super().thing_blocks(record))
        if "word" in record.fields:
            blocks += singles([Tile(Sign(text=record.fields["word"].text))])
        return [*blocks, (Tile(control("buy"), post=f"/buy/{self.token(record.name)}"),)]

    @page("/buy/{token}", method="POST")
    def buy(self, visit: Visit, token: str) -> Response:
        """Add a thing to the cart."""
        name = next((record.name for record in self.records() if self.token(record.name) == token), None)
        if name is None:
            return self.missing(visit)
        add(visit.state, name)
        return redirect("/cart")

    @page("/cart")
    def cart_page(self, visit: Visit) -> Response:
        """The things in the cart."""
        names = [name for name, count in contents(visit.state).items() for _ in range(count)]
        return self.show(visit, singles([Tile(self.signs[name]) for name in names[:8]]))

    def parts(self) -> Iterator[Part]:
        """Parts that look up, buy, compare and count."""
        rng = stream(self.seed, "parts")
        questions, things = Questions(self, phrases(), rng), self.records()
        for record in sample(rng, things, 8):
            yield questions.look_up(record, "number")
        for record in sample(rng, things, 5 if self.has_words else 0):
            yield questions.look_up(record, "word")
        for record in sample(rng, things, 6):
            yield buy(questions, record)
        for record in sample(rng, things, 4):
            yield buy_and_say(questions, record, "number")
        for record in sample(rng, things, 3):
            value = record.fields["number"].text
            yield questions.either(
                record, "number", rng.choice([other for other in numbers() if other != value])
            )
        pairs = [
            (first, second)
            for first, second in zip(sample(rng, things, 12), sample(rng, things, 12), strict=True)
            if first.rank("number") != second.rank("number")
        ]
        for nth, (first, second) in enumerate(pairs):
            if nth % 3 == 0:
                yield buy_smaller(questions, first, second, "number")
            else:
                yield questions.compare(first, second, "number", larger=nth % 3 == 1)
        for section in self.sections:
            trait = rng.choice(
                sorted({trait for record in self.sections[section] for trait in record.traits})
            )
            yield questions.count(section, "" if self.kind != "word" or rng.random() < 0.5 else trait)


BUY = Click("buy")


def add(state: State, name: str) -> None:
    """Add one of a thing to a visitor's cart."""
    cart = state.setdefault("cart", {})
    cart[name] = cart.get(name, 0) + 1


def contents(state: State) -> dict[str, Any]:
    """The number of each thing in a visitor's cart."""
    return dict(Counter(state.get("cart", {})))


def bought_fact(record: Record, path: str) -> Fact:
    """The fact that the cart contains one of this thing, and nothing that the task does not ask for."""
    return Fact(
        f"the {record.name} is put in the cart",
        (Evidence((), path),),
        (StateCheck(("cart",), {record.name: 1}),),
    )


def buy(questions: Questions, record: Record) -> Part:
    """Add a thing to the cart. Placeholders: item."""
    location = questions.guide.locate(record)
    return Part(
        ask=questions.ask("buy", item=record.full_name),
        description=f"The {record.name} in the cart",
        facts=(bought_fact(record, location.path),),
        moves=(*location.moves, BUY),
    )


def buy_and_say(questions: Questions, record: Record, field: str) -> Part:
    """Add a thing to the cart and say the value of a field. Placeholders: item."""
    location, value = questions.guide.locate(record), record.fields[field]
    value_fact = Fact(
        f"the {field} of the {record.name} is given",
        (field_evidence(location, value),),
        answer=value.options,
        wrong=questions.wrong_answers(field, value.text),
    )
    return Part(
        ask=questions.ask("buy_and_say", item=record.full_name),
        description=f"The {record.name} in the cart, and its {field}",
        facts=(value_fact, bought_fact(record, location.path)),
        moves=(*location.moves, answer_is(value.text), BUY),
    )


def buy_smaller(questions: Questions, first: Record, second: Record, field: str) -> Part:
    """Add to the cart the one of two things with the smaller value. Placeholders: item, other."""
    facts, moves, winner = questions.compared(first, second, field, larger=False)
    location = questions.guide.locate(winner)
    if winner is not second:
        moves = (*moves, Home(), *location.moves)
    return Part(
        ask=questions.ask("buy_smaller", item=first.full_name, other=second.full_name),
        description=f"The one with the smaller {field} in the cart: {first.name} or {second.name}",
        facts=(*facts.values(), bought_fact(winner, location.path)),
        moves=(*moves, BUY),
    )
