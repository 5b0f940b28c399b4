"""Finding things in a list: filters and an order, the three ways websites offer them.

A :class:`Finder` is what the pages, the moves of a solution and the evidence of a fact share, so that
they cannot disagree on how an address of a filtered list looks. Its markup is in ``finder.html``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias
from urllib.parse import urlencode

from webgym.core.truth import Choose, Click, Move
from webgym.offline.website import Visit

Style: TypeAlias = Literal["auto", "button", "links"]
STYLES: tuple[Style, ...] = ("auto", "button", "links")


@dataclass(frozen=True)
class Facet:
    """One thing to filter by, or the order.

    Attributes:
        name: the query parameter.
        label: what the page calls it.
        options: (value, text); values need no quoting in an address.
        default: text of the choice that filters nothing.
    """

    name: str
    label: str
    options: tuple[tuple[str, str], ...]
    default: str = "Any"

    def text(self, value: str) -> str:
        """What the page calls a value."""
        return dict(self.options)[value]


@dataclass(frozen=True)
class Finder:
    """Filters and orders of one list.

    Attributes:
        path: of the list.
        facets: the filters, in the order of the page.
        sort: the order; its first option is the one that no parameter means.
        style: ``auto`` are dropdowns that send themselves, ``button`` are dropdowns with a button,
            ``links`` are lists of links.
        apply: text of the button.
    """

    path: str
    facets: tuple[Facet, ...]
    sort: Facet
    style: Style
    apply: str

    def asked(self, visit: Visit) -> dict[str, str]:
        """The valid choices of a request, in the order of the page, with the words searched for as ``q``."""
        found = {"q": visit.query["q"].strip()} if visit.query.get("q", "").strip() else {}
        for facet in (*self.facets, self.sort):
            value = visit.query.get(facet.name, "")
            if value in dict(facet.options):
                found[facet.name] = value
        return found

    def link(self, asked: Mapping[str, str], name: str, value: str) -> str:
        """Address of the list with one choice changed; an empty value takes it back."""
        changed = {**asked, name: value}
        order = ["q", *(facet.name for facet in self.facets), self.sort.name]
        query = {key: changed[key] for key in order if changed.get(key)}
        return f"{self.path}?{urlencode(query)}" if query else self.path

    def moves(self, **chosen: str) -> tuple[Move, ...]:
        """From the unfiltered list to the list with these choices."""
        moves: list[Move] = []
        asked: dict[str, str] = {}
        for facet in self.facets:
            value = chosen.get(facet.name)
            if value is None:
                continue
            if self.style == "links":
                moves.append(Click(path=self.link(asked, facet.name, value)))
            else:
                moves.append(Choose(facet.label, facet.text(value)))
            asked[facet.name] = value
        if self.style == "button" and asked:
            moves.append(Click(name=self.apply, role="button"))
        order = chosen.get(self.sort.name)
        if order is not None and order != self.sort.options[0][0]:
            moves.append(Choose(self.sort.label, self.sort.text(order)))
        return tuple(moves)

    def regex(self, **chosen: str) -> str:
        """What the address of the list with at least these choices looks like."""
        wanted = "".join(f"(?=(?:.*&)?{name}={re.escape(value)}(?:&|$))" for name, value in chosen.items())
        return re.escape(self.path) + (rf"\?{wanted}" if wanted else r"(?:\?|$)")
