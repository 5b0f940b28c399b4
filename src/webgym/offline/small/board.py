"""Boards: pages of rows, a thing and its number in each."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import ClassVar

from webgym.core.truth import Click, Move
from webgym.offline.data import load
from webgym.offline.engine.table import ListPage, Record, Shown, Value
from webgym.offline.parts import Part
from webgym.offline.seeds import stream
from webgym.offline.small.questions import NAME, Phrases, Questions, some
from webgym.offline.small.screen import Tile, capacity, singles
from webgym.offline.small.signs import Sign, control, number_sign, numbers
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, Visit, page


@lru_cache(maxsize=1)
def phrases() -> Phrases:
    """How a board's tasks are asked."""
    return load("webgym.offline.small", "board.toml", Phrases)


class Board(SmallWebsite):
    """A website of tables.

    Attributes:
        tables: the rows of every table, by its word.
        signs: of the things, by name.
        size: rows on a page.
    """

    family: ClassVar[str] = "board"
    topic: ClassVar[tuple[str, str]] = ("Misc.", "News")
    tables: dict[str, list[Record]]
    signs: dict[str, Sign]
    size: int

    def fill(self) -> None:
        """Deal things and numbers. In a table, no number stands twice."""
        rng, stock = stream(self.seed, "board"), self.design.stock
        self.size = min(rng.randint(4, 7), capacity(self.design.layout, 2))
        things = [Sign(color, icon) for color in stock.colors for icon in stock.icons]
        rng.shuffle(things)
        self.signs = {thing.name: thing for thing in things}
        self.tables = {}
        count = rng.randint(3, 5)
        for word in stock.words[:count]:
            rows = [things.pop() for _ in range(rng.randint(4, 36 // count))]
            values = rng.sample(range(int(numbers()[-1]) + 1), len(rows))
            self.tables[word] = [
                Record(
                    row.name,
                    {"number": Value(str(value), rank=value)},
                    frozenset({row.color, row.icon}),
                    word,
                )
                for row, value in zip(rows, values, strict=True)
            ]

    # --- the guide --------------------------------------------------------------------------------

    def way(self, record: Record) -> Shown:
        """Through the table's pages."""
        number = self.tables[record.place].index(record) // self.size
        moves: tuple[Move, ...] = (Click(record.place), *(Click("next"),) * number)
        return Shown(moves, re.escape(self._table(record.place, number + 1)) + "$")

    def pages(self, place: str) -> Sequence[ListPage]:
        """The pages of a table."""
        rows = self.tables[place]
        return [
            ListPage(
                (Click("next" if start else place),),
                re.escape(self._table(place, 1 + start // self.size)) + "$",
                rows[start : start + self.size],
            )
            for start in range(0, len(rows), self.size)
        ]

    def candidates(self, of: str) -> Sequence[str]:
        """All numbers, or the names of all things."""
        return tuple(self.signs) if of == NAME else numbers()

    # --- pages ------------------------------------------------------------------------------------

    def _table(self, word: str, number: int) -> str:
        return f"/table/{self.token(word)}/{number}"

    @page("/")
    def front(self, visit: Visit) -> Response:
        """The tables' words."""
        tiles = [Tile(Sign(text=word), self._table(word, 1)) for word in self.tables]
        return self.show(visit, singles(tiles))

    @page("/table/{token}/{number}")
    def table_page(self, visit: Visit, token: str, number: str) -> Response:
        """A page of a table: pairs of a thing and its number."""
        word = next((word for word in self.tables if self.token(word) == token), None)
        pages = self.pages(word) if word is not None else ()
        if word is None or not number.isdecimal() or not 1 <= int(number) <= len(pages):
            return self.missing(visit)
        at, controls = int(number), []
        if at > 1:
            controls.append(Tile(control("back"), self._table(word, at - 1)))
        if at < len(pages):
            controls.append(Tile(control("next"), self._table(word, at + 1)))
        rows = [
            (Tile(self.signs[row.name]), Tile(number_sign(int(row.fields["number"].text))))
            for row in pages[at - 1].records
        ]
        return self.show(visit, rows, *controls, mark=Sign(text=word))

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Look up, compare, count, find the largest and the smallest."""
        rng = stream(self.seed, "parts")
        rows = [row for table in self.tables.values() for row in table]
        ask = Questions(self, phrases(), rng)
        for row in some(rng, rows, 12):
            yield ask.look_up(row, "number")
        for row in some(rng, rows, 3):
            value = row.fields["number"].text
            yield ask.either(row, "number", rng.choice([each for each in numbers() if each != value]))
        for one, two in zip(some(rng, rows, 6), some(rng, rows, 6), strict=True):
            if one.rank("number") != two.rank("number"):
                yield ask.compare(one, two, "number", larger=rng.random() < 0.5)
        for word, table in self.tables.items():
            yield ask.extreme(word, "number", larger=True)
            yield ask.extreme(word, "number", larger=False)
            yield ask.count(word)
            yield ask.count(word, rng.choice(sorted({trait for row in table for trait in row.traits})))
