"""Boards: tables of things and numbers, split into pages."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import ClassVar

from webgym.core.truth import Click, Move
from webgym.offline.data import load
from webgym.offline.engine.table import ListPage, Location, Record, Value
from webgym.offline.parts import Part
from webgym.offline.seeds import stream
from webgym.offline.small.questions import NAME, Phrases, Questions, sample
from webgym.offline.small.screen import Tile, capacity, singles
from webgym.offline.small.signs import Sign, control, number_sign, numbers
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, Visit, page


@lru_cache(maxsize=1)
def phrases() -> Phrases:
    """The phrases of a board's tasks."""
    return load("webgym.offline.small", "board.toml", Phrases)


class Board(SmallWebsite):
    """A website of tables.

    Attributes:
        tables: the rows of each table, by the word that names it.
        signs: signs of the things, by name.
        size: number of rows on a page.
    """

    family: ClassVar[str] = "board"
    topic: ClassVar[tuple[str, str]] = ("Misc.", "News")
    tables: dict[str, list[Record]]
    signs: dict[str, Sign]
    size: int

    def fill(self) -> None:
        """Draw the things and numbers of every table; no number is twice in a table."""
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

    # --- where records are --------------------------------------------------------------------------------

    def locate(self, record: Record) -> Location:
        """The page of the table that shows a row."""
        number = self.tables[record.place].index(record) // self.size
        moves: tuple[Move, ...] = (Click(record.place), *(Click("next"),) * number)
        return Location(moves, re.escape(self._table(record.place, number + 1)) + "$")

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

    def candidates(self, field: str) -> Sequence[str]:
        """All numbers; for names, the names of all things."""
        return tuple(self.signs) if field == NAME else numbers()

    # --- pages ------------------------------------------------------------------------------------

    def _table(self, word: str, number: int) -> str:
        return f"/table/{self.token(word)}/{number}"

    @page("/")
    def front(self, visit: Visit) -> Response:
        """The front page: the words of the tables."""
        tiles = [Tile(Sign(text=word), self._table(word, 1)) for word in self.tables]
        return self.show(visit, singles(tiles))

    @page("/table/{token}/{number}")
    def table_page(self, visit: Visit, token: str, number: str) -> Response:
        """A page of a table: things, each with its number."""
        word = next((word for word in self.tables if self.token(word) == token), None)
        pages = self.pages(word) if word is not None else ()
        if word is None or not number.isdecimal() or not 1 <= int(number) <= len(pages):
            return self.missing(visit)
        current, controls = int(number), []
        if current > 1:
            controls.append(Tile(control("back"), self._table(word, current - 1)))
        if current < len(pages):
            controls.append(Tile(control("next"), self._table(word, current + 1)))
        rows = [
            (Tile(self.signs[row.name]), Tile(number_sign(int(row.fields["number"].text))))
            for row in pages[current - 1].records
        ]
        return self.show(visit, rows, *controls, mark=Sign(text=word))

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Parts that look up, compare, count, and find the largest and the smallest number."""
        rng = stream(self.seed, "parts")
        rows = [row for table in self.tables.values() for row in table]
        questions = Questions(self, phrases(), rng)
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
        for word, table in self.tables.items():
            yield questions.extreme(word, "number", larger=True)
            yield questions.extreme(word, "number", larger=False)
            yield questions.count(word)
            yield questions.count(word, rng.choice(sorted({trait for row in table for trait in row.traits})))
