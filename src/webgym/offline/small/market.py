"""Shops: things in sections, each with a number as its price and sometimes a word; and a cart."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, ClassVar

from webgym.offline.data import load
from webgym.offline.engine.table import Record, Value
from webgym.offline.parts import Part
from webgym.offline.seeds import pick, stream
from webgym.offline.small import cart
from webgym.offline.small.catalog import Catalog
from webgym.offline.small.questions import Phrases, Questions, sample
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
        return {"cart": cart.contents(state)}

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
        cart.add(visit.state, name)
        return redirect("/cart")

    @page("/cart")
    def cart_page(self, visit: Visit) -> Response:
        """The things in the cart."""
        names = [name for name, count in cart.contents(visit.state).items() for _ in range(count)]
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
            yield cart.buy(questions, record)
        for record in sample(rng, things, 4):
            yield cart.buy_and_say(questions, record, "number")
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
                yield cart.buy_smaller(questions, first, second, "number")
            else:
                yield questions.compare(first, second, "number", larger=nth % 3 == 1)
        for section in self.sections:
            trait = rng.choice(
                sorted({trait for record in self.sections[section] for trait in record.traits})
            )
            yield questions.count(section, "" if self.kind != "word" or rng.random() < 0.5 else trait)
