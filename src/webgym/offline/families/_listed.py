"""Websites of one long list: things with a page each, found by a finder and shown in sections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, ClassVar

from webgym.core.truth import Click, Move, See
from webgym.offline.families._asking import count, exactly, shown
from webgym.offline.families._finder import Finder
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.website import Website


@dataclass
class Listed(Website):
    """Base of these families; :meth:`build` sets the fields.

    Attributes:
        says: what the website calls things.
        finder: filters and orders of the list.
        page_size: things on a page of the list.
    """

    first_section: ClassVar[str]
    """The section of a thing's page that is open."""

    says: dict[str, str] = field(init=False)
    finder: Finder = field(init=False)
    page_size: int = field(init=False)

    def find(self, **asked: str) -> Sequence[Any]:
        """The things that the list with these choices shows, in its order."""
        raise NotImplementedError

    def href(self, thing: Any, /) -> str:
        """The address of a thing's page."""
        raise NotImplementedError


def at(site: Listed, thing: Any) -> str:
    """Pattern of the address of a thing's page."""
    return exactly(site.href(thing))


def unfold(site: Listed, section: str) -> tuple[Move, ...]:
    """Open a section of a thing's page, where that is needed."""
    if site.look.detail == "plain" or section == site.first_section:
        return ()
    return (Click(name=site.says[section], role="tab" if site.look.detail == "tabs" else None),)


def last_page(site: Listed, pages: int) -> tuple[Move, ...]:
    """From the first page of a list to its last."""
    if site.look.pager == "numbers":
        return (Click(name=f"Page {pages}"),) if pages > 1 else ()
    return (Click(name="Next" if site.look.pager == "steps" else "Load more"),) * (pages - 1)


def how_many(
    site: Listed,
    turn: int,
    filters: Sequence[tuple[str, str]],
    nouns: str,
    described: Callable[[dict[str, str]], str],
    *,
    said: str = "{} {} found",
    most: int = 1 << 30,
) -> Part | None:
    """How many things two filters leave.

    Args:
        site: with the list.
        turn: which of the tasks of this kind.
        filters: pairs of facets' names, of which one is taken.
        nouns: what the things are.
        described: a clause for the choices, behind "that".
        said: what the list says of their number; takes number and nouns.
        most: how many at most.
    """
    names = filters[(turn + site.seed) % len(filters)]
    one, two = (facet for facet in site.finder.facets if facet.name in names)
    options = [{one.name: a, two.name: b} for (a, _), (b, _) in product(one.options, two.options)]
    stream(site.seed, "count", turn).shuffle(options)
    for chosen in options:
        total = len(site.find(**chosen))
        if not 2 <= total <= most:
            continue
        text, kind = said.format(total, nouns), described(chosen)
        proof = (shown(site.finder.regex(**chosen), text),)
        return Part(
            f"find out how many {nouns} there are that {kind}",
            f"Number of {nouns}",
            (Fact(f"The number of {nouns} that {kind} is found", proof, answer=count(total)),),
            (Click(path=site.finder.path), *site.finder.moves(**chosen), See((text,))),
            f"There are {total}.",
        )
    return None
