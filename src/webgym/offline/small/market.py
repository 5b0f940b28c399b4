"""Shops: things in sections, with a number for a price, some with a word, and a cart."""

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
from webgym.offline.small.questions import Phrases, Questions, some
from webgym.offline.small.screen import Block, Tile, singles
from webgym.offline.small.signs import Sign, control, numbers
from webgym.offline.website import Response, State, Visit, page, redirect


@lru_cache(maxsize=1)
def phrases() -> Phrases:
    """How a shop's tasks are asked."""
    return load("webgym.offline.small", "market.toml", Phrases)


class Market(Catalog):
    """A shop."""

    family: ClassVar[str] = "market"
    topic: ClassVar[tuple[str, str]] = ("Lifestyle & Leisure", "Shopping")

    @property
    def has_words(self) -> bool:
        """Whether the page of a thing shows a word, too."""
        return pick((True, False), self.seed, "has words")

    def fields(self, thing: Sign) -> dict[str, Value]:
        """A number, and a word where there are words."""
        values = super().fields(thing)
        if self.has_words:
            values["word"] = Value(pick(self.design.stock.words, self.seed, "word", thing.name))
        return values

    def candidates(self, of: str) -> tuple[str, ...]:
        """All words, where a word is asked for."""
        return self.design.stock.words if of == "word" else tuple(super().candidates(of))

    def report(self, state: State) -> dict[str, Any]:
        """The cart."""
        return {"cart": cart.held(state)}

    def controls(self, visit: Visit) -> list[Tile]:
        """The cart is at hand everywhere."""
        return [*super().controls(visit), Tile(control("cart"), None if visit.path == "/cart" else "/cart")]

    def thing_blocks(self, record: Record) -> list[Block]:
        """The thing, its values, and the button that buys it."""
        blocks = list(super().thing_blocks(record))
        if "word" in record.fields:
            blocks += singles([Tile(Sign(text=record.fields["word"].text))])
        return [*blocks, (Tile(control("buy"), post=f"/buy/{self.token(record.name)}"),)]

    @page("/buy/{token}", method="POST")
    def buy(self, visit: Visit, token: str) -> Response:
        """Put a thing in the cart."""
        name = next((each.name for each in self.records() if self.token(each.name) == token), None)
        if name is None:
            return self.missing(visit)
        cart.put(visit.state, name)
        return redirect("/cart")

    @page("/cart")
    def cart_page(self, visit: Visit) -> Response:
        """What is in the cart."""
        held = [name for name, count in cart.held(visit.state).items() for _ in range(count)]
        return self.show(visit, singles([Tile(self.signs[name]) for name in held[:8]]))

    def parts(self) -> Iterator[Part]:
        """Look up, count, compare, buy."""
        rng = stream(self.seed, "parts")
        ask, things = Questions(self, phrases(), rng), self.records()
        for record in some(rng, things, 8):
            yield ask.look_up(record, "number")
        for record in some(rng, things, 5 if self.has_words else 0):
            yield ask.look_up(record, "word")
        for record in some(rng, things, 6):
            yield cart.buy(ask, record)
        for record in some(rng, things, 4):
            yield cart.buy_and_say(ask, record, "number")
        for record in some(rng, things, 3):
            value = record.fields["number"].text
            yield ask.either(record, "number", rng.choice([each for each in numbers() if each != value]))
        pairs = [
            (one, two)
            for one, two in zip(some(rng, things, 12), some(rng, things, 12), strict=True)
            if one.rank("number") != two.rank("number")
        ]
        for nth, (one, two) in enumerate(pairs):
            if nth % 3 == 0:
                yield cart.buy_smaller(ask, one, two, "number")
            else:
                yield ask.compare(one, two, "number", larger=nth % 3 == 1)
        for section in self.sections:
            trait = rng.choice(sorted({trait for each in self.sections[section] for trait in each.traits}))
            yield ask.count(section, "" if self.kind != "word" or rng.random() < 0.5 else trait)
