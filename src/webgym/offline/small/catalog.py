"""Catalogs: a front page of sections, lists of things split into pages, and a page per thing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import ClassVar, Literal

from webgym.core.truth import Click, Move
from webgym.offline.engine.table import ListPage, Location, Record, Value
from webgym.offline.seeds import stream
from webgym.offline.small.questions import NAME
from webgym.offline.small.screen import Block, Tile, capacity, singles
from webgym.offline.small.signs import Sign, control, number_sign, numbers
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, Visit, page

Kind = Literal["color", "icon", "word"]

SOLD_OUT = 0.12
"""Probability that a thing in a list has no page."""


class Catalog(SmallWebsite):
    """Base class of websites with things in sections.

    Attributes:
        kinds: properties by which the family's websites may group things into sections.
        kind: property by which this website groups them.
        sections: the things of each section, by the section's name, in the order of its list.
        signs: signs of things and sections, by name.
        size: number of things on a page of a list.
        sold_out: names of the things without a page.
    """

    kinds: ClassVar[tuple[Kind, ...]] = ("color", "icon", "word")
    kind: Kind
    sections: dict[str, list[Record]]
    signs: dict[str, Sign]
    size: int
    sold_out: set[str]

    def fill(self) -> None:
        """Draw the sections, their things, and the values of the things."""
        rng = stream(self.seed, "catalog")
        self.kind = rng.choice(self.kinds)
        self.size = min(rng.randint(4, 8), capacity(self.design.layout, 1))
        drawn = self._draw_sections(rng.randint(3, 5 if self.kind == "word" else 6))
        self.signs = {sign.name: sign for section, things in drawn for sign in (section, *things)}
        self.sold_out = set()
        self.sections = {}
        for section, things in drawn:
            place = section.name if self.kind == "word" else ""
            # At least three things of a section have a page.
            optional = things[3:]
            self.sold_out |= {thing.name for thing in optional if rng.random() < SOLD_OUT}
            rng.shuffle(things)
            self.sections[section.name] = [
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
            for section in self.sections.values()
            for record in section
            if record.name not in self.sold_out
        ]

    def section_of(self, record: Record) -> str:
        """The section that lists a thing."""
        return next(name for name, things in self.sections.items() if record in things)

    def locate(self, record: Record) -> Location:
        """The page of a thing, reached through the list of its section."""
        section = self.section_of(record)
        number = self.sections[section].index(record) // self.size
        moves: tuple[Move, ...] = (Click(section), *(Click("next"),) * number, Click(record.name))
        return Location(moves, f"/{self.token(record.name)}$")

    def pages(self, place: str) -> Sequence[ListPage]:
        """The pages of a section's list."""
        things = self.sections[place]
        return [
            ListPage(
                (Click("next" if start else place),),
                re.escape(self._list(place, 1 + start // self.size)) + "$",
                things[start : start + self.size],
            )
            for start in range(0, len(things), self.size)
        ]

    def candidates(self, field: str) -> Sequence[str]:
        """All numbers; for names, the names of all things."""
        if field == NAME:
            return [record.name for things in self.sections.values() for record in things]
        return numbers()

    # --- pages ------------------------------------------------------------------------------------

    def _list(self, section: str, number: int) -> str:
        return f"/list/{self.token('list', section)}/{number}"

    def front_tiles(self) -> list[Tile]:
        """The tiles of the front page."""
        return [Tile(self.signs[name], self._list(name, 1)) for name in self.sections]

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
        section = next((name for name in self.sections if self.token("list", name) == token), None)
        if section is None or not number.isdecimal() or not 1 <= int(number) <= len(self.pages(section)):
            return self.missing(visit)
        current, pages = int(number), self.pages(section)
        controls = []
        if current > 1:
            controls.append(Tile(control("back"), self._list(section, current - 1)))
        if current < len(pages):
            controls.append(Tile(control("next"), self._list(section, current + 1)))
        tiles = [
            Tile(
                self.signs[record.name],
                None if record.name in self.sold_out else f"/{self.token(record.name)}",
            )
            for record in pages[current - 1].records
        ]
        return self.show(visit, singles(tiles), *controls, mark=self.signs[section])

    @page("/{token}")
    def thing_page(self, visit: Visit, token: str) -> Response:
        """A thing and its values."""
        record = next((each for each in self.records() if self.token(each.name) == token), None)
        if record is None:
            return self.missing(visit)
        section = self.section_of(record)
        back = self._list(section, 1 + self.sections[section].index(record) // self.size)
        return self.show(visit, self.thing_blocks(record), Tile(control("back"), back))

    def thing_blocks(self, record: Record) -> list[Block]:
        """What the page of a thing shows."""
        return singles([Tile(self.signs[record.name]), Tile(number_sign(int(record.fields["number"].text)))])
