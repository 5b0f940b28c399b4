"""Websites of lists: catalogs of things with a page each, shops among them, and boards, which are tables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar, Literal

from webgym.core.truth import Click, Evidence, Home, Move, StateCheck
from webgym.offline.engine.records import Record, Value
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import pick, stream
from webgym.offline.small.design import Sign, control, number_sign, numbers
from webgym.offline.small.questions import (
    NAME,
    ListPage,
    Location,
    Questions,
    answer_is,
    field_evidence,
    phrases,
    sample,
)
from webgym.offline.small.screen import Block, Tile, capacity, singles
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, State, Visit, page, redirect

Kind = Literal["color", "icon", "word"]

SOLD_OUT = 0.12
"""Probability that a thing in a list has no page."""


class Listed(SmallWebsite):
    """Base class of websites with lists that are split into pages.

    Attributes:
        lists: the records of each list, in order, by the list's name.
        signs: signs of things and lists, by name.
        size: number of records on a page of a list.
    """

    lists: dict[str, list[Record]]
    signs: dict[str, Sign]
    size: int

    def list_path(self, place: str, number: int) -> str:
        """The address of a page of a list; the first has number 1."""
        raise NotImplementedError

    def page_of(self, place: str, record: Record) -> int:
        """The number of the page of a list that shows a record."""
        return 1 + self.lists[place].index(record) // self.size

    def go_to_page(self, place: str, record: Record) -> tuple[Move, ...]:
        """Moves from the front page to the page of a list that shows a record."""
        return Click(place), *(Click("next"),) * (self.page_of(place, record) - 1)

    def pages(self, place: str) -> Sequence[ListPage]:
        """The pages of a list."""
        records = self.lists[place]
        return [
            ListPage(
                (Click("next" if start else place),),
                re.escape(self.list_path(place, 1 + start // self.size)) + "$",
                records[start : start + self.size],
            )
            for start in range(0, len(records), self.size)
        ]

    def show_list(
        self, visit: Visit, place: str | None, number: str, block: Callable[[Record], Block]
    ) -> Response:
        """A page of a list, with the controls that turn pages.

        Args:
            visit: the request.
            place: name of the list; ``None`` if there is none at this address.
            number: of the page, as the address has it.
            block: what the page shows of a record.
        """
        pages = self.pages(place) if place is not None else ()
        if place is None or not number.isdecimal() or not 1 <= int(number) <= len(pages):
            return self.missing(visit)
        current, controls = int(number), []
        if current > 1:
            controls.append(Tile(control("back"), self.list_path(place, current - 1)))
        if current < len(pages):
            controls.append(Tile(control("next"), self.list_path(place, current + 1)))
        blocks = [block(record) for record in pages[current - 1].records]
        return self.show(visit, blocks, *controls, mark=self.signs.get(place, Sign(text=place)))


class Catalog(Listed):
    """Base class of websites with things in sections.

    Attributes:
        kinds: properties by which the family's websites may group things into sections.
        kind: property by which this website groups them.
        sold_out: names of the things without a page.
    """

    kinds: ClassVar[tuple[Kind, ...]] = ("color", "icon", "word")
    kind: Kind
    sold_out: set[str]

    def fill(self) -> None:
        """Draw the sections, their things, and the values of the things."""
        rng = stream(self.seed, "catalog")
        self.kind = rng.choice(self.kinds)
        self.size = min(rng.randint(4, 8), capacity(self.design.layout, 1))
        drawn = self._draw_sections(rng.randint(3, 5 if self.kind == "word" else 6))
        self.signs = {sign.name: sign for section, things in drawn for sign in (section, *things)}
        self.sold_out = set()
        self.lists = {}
        for section, things in drawn:
            place = section.name if self.kind == "word" else ""
            # At least three things of a section have a page.
            optional = things[3:]
            self.sold_out |= {thing.name for thing in optional if rng.random() < SOLD_OUT}
            rng.shuffle(things)
            self.lists[section.name] = [
                Record(thing.name, self.fields(thing), frozenset({thing.color, thing.icon}), place)
                for thing in things
            ]

    def _draw_sections(self, count: int) -> list[tuple[Sign, list[Sign]]]:
        rng, stock = stream(self.seed, "deal"), self.design.stock
        if self.kind == "color":
            heads = [Sign(color=color) for color in stock.colors[:count]]
            return [
                (head, [Sign(head.color, icon) for icon in rng.sample(stock.icons, rng.randint(4, 6))])
                for head in heads
            ]
        if self.kind == "icon":
            heads = [Sign(icon=icon) for icon in stock.icons[:count]]
            return [
                (head, [Sign(color, head.icon) for color in rng.sample(stock.colors, rng.randint(4, 6))])
                for head in heads
            ]
        things = [Sign(color, icon) for color in stock.colors for icon in stock.icons]
        rng.shuffle(things)
        return [
            (Sign(text=word), [things.pop() for _ in range(rng.randint(4, 10 if count < 4 else 7))])
            for word in stock.words[:count]
        ]

    def fields(self, thing: Sign) -> dict[str, Value]:
        """The values of a thing, by field."""
        value = stream(self.seed, "number", thing.name).randint(1, int(numbers()[-1]))
        return {"number": Value(str(value), rank=value)}

    # --- where records are --------------------------------------------------------------------------------

    def records(self) -> list[Record]:
        """All things with a page."""
        return [
            record
            for section in self.lists.values()
            for record in section
            if record.name not in self.sold_out
        ]

    def section_of(self, record: Record) -> str:
        """The section that lists a thing."""
        return next(name for name, things in self.lists.items() if record in things)

    def locate(self, record: Record) -> Location:
        """The page of a thing, reached through the list of its section."""
        moves = (*self.go_to_page(self.section_of(record), record), Click(record.name))
        return Location(moves, f"/{self.token(record.name)}$")

    def candidates(self, field: str) -> Sequence[str]:
        """All numbers; for names, the names of all things."""
        if field == NAME:
            return [record.name for things in self.lists.values() for record in things]
        return numbers()

    # --- pages ------------------------------------------------------------------------------------

    def list_path(self, place: str, number: int) -> str:
        """The address of a page of a section's list."""
        return f"/list/{self.token('list', place)}/{number}"

    def front_tiles(self) -> list[Tile]:
        """The tiles of the front page."""
        return [Tile(self.signs[name], self.list_path(name, 1)) for name in self.lists]

    @page("/")
    def front(self, visit: Visit) -> Response:
        """The front page: the sections."""
        return self.show(visit, singles(self.front_tiles()), mark=self.front_mark())

    def front_mark(self) -> Sign | None:
        """The sign at the end of the front page's bar."""
        return None

    @page("/list/{token}/{number}")
    def list_page(self, visit: Visit, token: str, number: str) -> Response:
        """A page of a section's list."""
        section = next((name for name in self.lists if self.token("list", name) == token), None)

        def block(record: Record) -> Block:
            is_sold_out = record.name in self.sold_out
            return (Tile(self.signs[record.name], None if is_sold_out else f"/{self.token(record.name)}"),)

        return self.show_list(visit, section, number, block)

    @page("/{token}")
    def thing_page(self, visit: Visit, token: str) -> Response:
        """A thing and its values."""
        record = next((each for each in self.records() if self.token(each.name) == token), None)
        if record is None:
            return self.missing(visit)
        section = self.section_of(record)
        back = self.list_path(section, self.page_of(section, record))
        return self.show(visit, self.thing_blocks(record), Tile(control("back"), back))

    def thing_blocks(self, record: Record) -> list[Block]:
        """What the page of a thing shows."""
        return singles([Tile(self.signs[record.name]), Tile(number_sign(int(record.fields["number"].text)))])


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
        questions, things = Questions(self, phrases(self.family), rng), self.records()
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
        for section in self.lists:
            trait = rng.choice(sorted({trait for record in self.lists[section] for trait in record.traits}))
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
    text = f"the {field} of the {record.name} is given"
    value_fact = questions.answered(text, value, field, (field_evidence(location, value),))
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


class Board(Listed):
    """A website of tables of things and numbers, whose names are words."""

    family: ClassVar[str] = "board"
    topic: ClassVar[tuple[str, str]] = ("Misc.", "News")

    def fill(self) -> None:
        """Draw the things and numbers of every table; no number is twice in a table."""
        rng, stock = stream(self.seed, "board"), self.design.stock
        self.size = min(rng.randint(4, 7), capacity(self.design.layout, 2))
        things = [Sign(color, icon) for color in stock.colors for icon in stock.icons]
        rng.shuffle(things)
        self.signs = {thing.name: thing for thing in things}
        self.lists = {}
        count = rng.randint(3, 5)
        for word in stock.words[:count]:
            rows = [things.pop() for _ in range(rng.randint(4, 36 // count))]
            values = rng.sample(range(int(numbers()[-1]) + 1), len(rows))
            self.lists[word] = [
                Record(
                    row.name,
                    {"number": Value(str(value), rank=value)},
                    frozenset({row.color, row.icon}),
                    word,
                )
                for row, value in zip(rows, values, strict=True)
            ]

    # --- where records are --------------------------------------------------------------------------------

    def locate(self, record: Record) -> Location:
        """The page of the table that shows a row."""
        path = self.list_path(record.place, self.page_of(record.place, record))
        return Location(self.go_to_page(record.place, record), re.escape(path) + "$")

    def candidates(self, field: str) -> Sequence[str]:
        """All numbers; for names, the names of all things."""
        return tuple(self.signs) if field == NAME else numbers()

    # --- pages ------------------------------------------------------------------------------------

    def list_path(self, place: str, number: int) -> str:
        """The address of a page of a table."""
        return f"/table/{self.token(place)}/{number}"

    @page("/")
    def front(self, visit: Visit) -> Response:
        """The front page: the words of the tables."""
        tiles = [Tile(Sign(text=word), self.list_path(word, 1)) for word in self.lists]
        return self.show(visit, singles(tiles))

    @page("/table/{token}/{number}")
    def table_page(self, visit: Visit, token: str, number: str) -> Response:
        """A page of a table: things, each with its number."""
        word = next((word for word in self.lists if self.token(word) == token), None)

        def block(row: Record) -> Block:
            return Tile(self.signs[row.name]), Tile(number_sign(int(row.fields["number"].text)))

        return self.show_list(visit, word, number, block)

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Parts that look up, compare, count, and find the largest and the smallest number."""
        rng = stream(self.seed, "parts")
        rows = [row for table in self.lists.values() for row in table]
        questions = Questions(self, phrases(self.family), rng)
        for row in sample(rng, rows, 12):
            yield questions.look_up(row, "number")
        for row in sample(rng, rows, 3):
            value = row.fields["number"].text
            yield questions.either(
                row, "number", rng.choice([other for other in numbers() if other != value])
            )
        for first, second in zip(sample(rng, rows, 6), sample(rng, rows, 6), strict=True):
            if first.rank("number") != second.rank("number"):
                yield questions.compare(first, second, "number", larger=rng.random() < 0.5)
        for word, table in self.lists.items():
            yield questions.extreme(word, "number", larger=True)
            yield questions.extreme(word, "number", larger=False)
            yield questions.count(word)
            yield questions.count(word, rng.choice(sorted({trait for row in table for trait in row.traits})))
