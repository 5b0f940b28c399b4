"""Filters, sort order and pages of a list.

Pages, moves of solutions and evidence of facts all use the same :class:`Finder`, so that they agree on the
address of a filtered list. Its markup is in ``finder.html``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeAlias, TypeVar
from urllib.parse import urlencode

from webgym.core.truth import Choose, Click, Move
from webgym.offline.website import Visit

Style: TypeAlias = Literal["auto", "button", "links"]
STYLES: tuple[Style, ...] = ("auto", "button", "links")


@dataclass(frozen=True)
class Facet:
    """One filter of a list, or its sort order.

    Attributes:
        name: name of the query parameter.
        label: its label on the page.
        options: pairs of value and text on the page; values need no quoting in an address.
        default: text of the option that does not filter.
    """

    name: str
    label: str
    options: tuple[tuple[str, str], ...]
    default: str = "Any"

    def text(self, value: str) -> str:
        """The text of a value on the page."""
        return dict(self.options)[value]


@dataclass(frozen=True)
class Finder:
    """The filters and the sort order of one list.

    Attributes:
        path: path of the list.
        facets: the filters, in page order.
        sort: the sort order; its first option is the default, without a parameter.
        style: ``auto``: dropdowns that apply at once; ``button``: dropdowns with a button; ``links``: lists
            of links.
        apply: label of the button.
    """

    path: str
    facets: tuple[Facet, ...]
    sort: Facet
    style: Style
    apply: str

    def query(self, visit: Visit) -> dict[str, str]:
        """The valid query parameters of a request, in page order; ``q`` is the search text."""
        words = visit.query.get("q", "").strip()
        query = {"q": words} if words else {}
        for facet in (*self.facets, self.sort):
            value = visit.query.get(facet.name, "")
            if value in dict(facet.options):
                query[facet.name] = value
        return query

    def link(self, query: Mapping[str, str], name: str, value: str) -> str:
        """Address of the list with one parameter changed; an empty value removes it."""
        changed = {**query, name: value}
        order = ["q", *(facet.name for facet in self.facets), self.sort.name]
        parameters = {key: changed[key] for key in order if changed.get(key)}
        return f"{self.path}?{urlencode(parameters)}" if parameters else self.path

    def moves(self, **chosen: str) -> tuple[Move, ...]:
        """Moves from the unfiltered list to the list with these filters and this order."""
        moves: list[Move] = []
        query: dict[str, str] = {}
        for facet in self.facets:
            value = chosen.get(facet.name)
            if value is None:
                continue
            if self.style == "links":
                moves.append(Click(path=self.link(query, facet.name, value)))
            else:
                moves.append(Choose(facet.label, facet.text(value)))
            query[facet.name] = value
        if self.style == "button" and query:
            moves.append(Click(name=self.apply, role="button"))
        order = chosen.get(self.sort.name)
        if order is not None and order != self.sort.options[0][0]:
            moves.append(Choose(self.sort.label, self.sort.text(order)))
        return tuple(moves)

    def regex(self, **chosen: str) -> str:
        """Regular expression for addresses of the list with at least these parameters."""
        lookaheads = "".join(
            f"(?=(?:.*&)?{name}={re.escape(value)}(?:&|$))" for name, value in chosen.items()
        )
        return re.escape(self.path) + (rf"\?{lookaheads}" if lookaheads else r"(?:\?|$)")


T = TypeVar("T")


@dataclass(frozen=True)
class Paged(Generic[T]):
    """One page of a list.

    Attributes:
        items: on this page.
        total: number of items in the whole list.
        number: of this page, from 1.
        count: number of pages.
    """

    items: Sequence[T]
    total: int
    number: int
    count: int


def paged(items: Sequence[T], visit: Visit, size: int) -> Paged[T]:
    """The page of the visit's ``page`` parameter, limited to the existing pages."""
    count = max(1, -(-len(items) // size))
    requested = visit.query.get("page", "1")
    number = min(max(int(requested), 1), count) if requested.isdecimal() and len(requested) < 6 else 1
    return Paged(items[(number - 1) * size : number * size], len(items), number, count)
