"""Sections of things: a front page of sections, lists with pages, and a page for every thing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import ClassVar, Literal

from webgym.core.truth import Click, Move
from webgym.offline.engine.table import ListPage, Record, Shown, Value
from webgym.offline.seeds import stream
from webgym.offline.small.questions import NAME
from webgym.offline.small.screen import Block, Tile, capacity, singles
from webgym.offline.small.signs import Sign, control, number_sign, numbers
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, Visit, page

Kind = Literal["color", "icon", "word"]

SOLD_OUT = 0.12
"""Share of things that are listed and lead nowhere."""


class Catalog(SmallWebsite):
    """A website with things in sections.

    Attributes:
        kinds: what sections may be told apart by.
        kind: what this website's sections are told apart by.
        sections: the things of every section, by the section's name, in the order of its list.
        signs: of things and sections, by name.
        size: things on a page of a list.
        sold_out: names of things that have no page.
    """

    kinds: ClassVar[tuple[Kind, ...]] = ("color", "icon", "word")
    kind: Kind
    sections: dict[str, list[Record]]
    signs: dict[str, Sign]
    size: int
    sold_out: set[str]

    def fill(self) -> None:
        """Deal things into sections and give each its values."""
        rng = stream(self.seed, "catalog")
        self.kind = rng.choice(self.kinds)
        self.size = min(rng.randint(4, 8), capacity(self.design.layout, 1))
        dealt = self._dealt(rng.randint(3, 5 if self.kind == "word" else 6))
        self.signs = {sign.name: sign for section, things in dealt for sign in (section, *things)}
        self.sold_out = set()
        self.sections = {}
        for section, things in dealt:
            place = section.name if self.kind == "word" else ""
            # At least three things of a section can be had.
            spare = things[3:]
            self.sold_out |= {thing.name for thing in spare if rng.random() < SOLD_OUT}
            rng.shuffle(things)
            self.sections[section.name] = [
                Record(thing.name, self.fields(thing), frozenset({thing.color, thing.icon}), place)
                for thing in things
            ]

    def _dealt(self, count: int) -> list[tuple[Sign, list[Sign]]]:
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
        """The values of a thing."""
        value = stream(self.seed, "number", thing.name).randint(1, int(numbers()[-1]))
        return {"number": Value(str(value), rank=value)}

    # --- the guide --------------------------------------------------------------------------------

    def records(self) -> list[Record]:
        """All things that have a page."""
        return [
            each for section in self.sections.values() for each in section if each.name not in self.sold_out
        ]

    def section_of(self, record: Record) -> str:
        """The section that lists a thing."""
        return next(name for name, things in self.sections.items() if record in things)

    def way(self, record: Record) -> Shown:
        """Through the section and its list to the thing's page."""
        section = self.section_of(record)
        number = self.sections[section].index(record) // self.size
        moves: tuple[Move, ...] = (Click(section), *(Click("next"),) * number, Click(record.name))
        return Shown(moves, f"/{self.token(record.name)}$")

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

    def candidates(self, of: str) -> Sequence[str]:
        """All numbers, or the names of all things."""
        if of == NAME:
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
        """The sections."""
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
        at, pages = int(number), self.pages(section)
        controls = []
        if at > 1:
            controls.append(Tile(control("back"), self._list(section, at - 1)))
        if at < len(pages):
            controls.append(Tile(control("next"), self._list(section, at + 1)))
        tiles = [
            Tile(self.signs[each.name], None if each.name in self.sold_out else f"/{self.token(each.name)}")
            for each in pages[at - 1].records
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
