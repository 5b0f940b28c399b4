"""Ways through a specified website, and what proves that a field of an item was seen."""

from __future__ import annotations

from collections.abc import Sequence

from webgym.core.truth import Click, Fill, Move, See
from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, exactly

Site = SpecifiedWebsite


def go(site: Site, record: Record) -> tuple[Move, ...]:
    """To an item's page, from anywhere."""
    return Fill(site.says["search"], record.name), Click(path=site.href(record))


def unfold(site: Site, title: str, *, is_first: bool = False) -> tuple[Move, ...]:
    """Open a section of an item's page, where that is needed."""
    if is_first or site.look.detail == "plain":
        return ()
    return (Click(name=title, role="tab" if site.look.detail == "tabs" else None),)


def chart_moves(site: Site, record: Record, month: str) -> tuple[Move, ...]:
    """From an item's page, until the bar of a month tells its value."""
    is_first = not site.sections() and not site.spec.rows
    return (
        *unfold(site, site.chart_label(), is_first=is_first),
        Click(name=month, role="button"),
        See((f"{month}: {site.chart(record)[month].text}",)),
    )


def look(site: Site, record: Record, fields: Sequence[str]) -> tuple[Move, ...]:
    """From an item's page, until each of these fields was in view."""
    moves: list[Move] = []
    sections = site.sections()
    for section in ("", *sections):
        wanted = [of for of in fields if site.items.fields[of].section == section]
        if wanted and section:
            moves += unfold(site, site.says[section], is_first=section == sections[0])
        moves += [See(site.items.view(record, of)) for of in wanted]
    return tuple(moves)


def fact(site: Site, record: Record, of: str, *, about: str = "", asked: bool = True) -> Fact:
    """A field of an item was seen, and told where it is asked for."""
    return site.items.fact(record, of, exactly(site.href(record)), about=about, asked=asked)
