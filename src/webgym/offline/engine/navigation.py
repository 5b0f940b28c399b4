"""Moves through a specified website, and facts about the fields of its items."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from webgym.core.truth import Click, Fill, Move, See
from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, exactly, shown

Site = SpecifiedWebsite


def go_to_item(site: Site, record: Record) -> tuple[Move, ...]:
    """Moves from any page to the page of an item, through the search."""
    return Fill(site.says["search"], record.name), Click(path=site.href(record))


def unfold(site: Site, title: str, *, is_first: bool = False) -> tuple[Move, ...]:
    """Moves that open a section of an item's page; none where it is open already."""
    if is_first or site.look.detail == "plain":
        return ()
    return (Click(name=title, role="tab" if site.look.detail == "tabs" else None),)


def read_bar(site: Site, record: Record, month: str) -> tuple[Move, ...]:
    """Moves that show the value of a month's bar on an item's page."""
    is_first = not site.sections() and not site.spec.rows
    return (
        *unfold(site, site.chart_label(), is_first=is_first),
        Click(name=month, role="button"),
        See((f"{month}: {site.chart(record)[month].text}",)),
    )


def view_fields(site: Site, record: Record, fields: Sequence[str]) -> tuple[Move, ...]:
    """Moves that bring each of these fields of an item into view on its page."""
    moves: list[Move] = []
    sections = site.sections()
    for section in ("", *sections):
        wanted = [field for field in fields if site.items.fields[field].section == section]
        if wanted and section:
            moves += unfold(site, site.says[section], is_first=section == sections[0])
        moves += [See(site.items.view(record, field)) for field in wanted]
    return tuple(moves)


def row_view(site: Site, record: Record, field: str) -> tuple[str, ...]:
    """The texts by which the list shows a field of an item: its name and all values up to the field, with
    their labels; those of a table are in its first line."""
    fields = site.card_fields()
    fields = fields[: fields.index(field) + 1]
    labels, values = site.items.labels, record.fields
    if site.look.listing != "table":
        return (" ".join((record.name, *(f"{labels[each]} {values[each].text}" for each in fields))),)
    heading = " ".join((site.spec.singular, *(labels[each] for each in fields)))
    return heading, " ".join((record.name, *(values[each].text for each in fields)))


def field_fact(site: Site, record: Record, field: str, *, about: str = "", in_answer: bool = True) -> Fact:
    """The fact that a field of an item was found, on its page or in the list; see
    :meth:`~webgym.offline.engine.records.Sheet.fact`."""
    fact = site.items.fact(record, field, exactly(site.href(record)), about=about, in_answer=in_answer)
    if field not in site.card_fields():
        return fact
    listed = shown(exactly(site.finder.path), *row_view(site, record, field))
    return replace(fact, evidence=(*fact.evidence, listed))
