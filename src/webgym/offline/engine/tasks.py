"""The tasks of a specified website: their kinds, how many of each kind, and their numbers of facts.

The tasks on its list are here, too: count items, and find the first in an order. Every such function takes
the website, a random generator and a number of facts, and returns a part with that many facts, or ``None`` if
the draw gives no well-posed part.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

from webgym.core.truth import Click, See
from webgym.offline.engine.composer import Composer, PartMaker
from webgym.offline.engine.extra_tasks import (
    account,
    chart_bar,
    count_rows,
    extreme_pin,
    extreme_row,
    fill_cart,
    group_record,
    move_files,
    related_record,
    row,
)
from webgym.offline.engine.form_tasks import save, send
from webgym.offline.engine.lookup_tasks import compare, difference, either, facts
from webgym.offline.engine.navigation import Site, field_fact, row_view, view_fields
from webgym.offline.engine.spelling import count as counted
from webgym.offline.parts import Assignment, Fact, Part, shown


def assignments(site: Site) -> Iterator[Assignment]:
    """The tasks of a website."""
    extra = {name: entry for name, entry in extra_makers(site).items() if entry}
    single: list[tuple[str, PartMaker, tuple[int, ...]]] = [
        *_repeat(2 if extra else 4, "facts", facts, 1, 2, 3),
        *_repeat(3, "extreme", extreme, 1, 2, 3),
        *_repeat(2, "compare", compare, 3),
        *_repeat(2 if extra else 3, "count", count, 1),
        *_repeat(1 if extra else 2, "either", either, 1),
        *_repeat(2, "save", save, 1, 2, 3),
        *_repeat(1, "difference", difference, 3),
        *_repeat(3 if extra else 4, "send", send, 3, 4, 5),
        *(task for name, (make, *sizes) in extra.items() for task in _repeat(2, name, make, *sizes)),
    ]
    large: list[tuple[str, PartMaker]] = [
        ("facts", facts),
        ("extreme", extreme),
        ("compare", compare),
        ("difference", difference),
        ("save", save),
        *((name, make) for name, (make, *sizes) in extra.items() if 3 in sizes),
    ]
    small = [
        ("facts", facts),
        ("extreme", extreme),
        ("count", count),
        ("either", either),
        ("save", save),
        *((name, make) for name, (make, *sizes) in extra.items() if min(sizes) < 3),
    ]
    once = frozenset({"put", "account", "files"})
    yield from Composer(site, single, large, small, ("send", send), once).assignments()


def _repeat(
    count: int, name: str, make: PartMaker, *sizes: int
) -> Iterator[tuple[str, PartMaker, tuple[int, ...]]]:
    for nth in range(count):
        yield f"{name}-{nth}", make, sizes


def extra_makers(site: Site) -> dict[str, tuple[Any, ...]]:
    """Makers of the tasks on what only some websites have, each with its possible numbers of facts.

    The value of a kind that does not fit the website is empty. The keys are part of task ids.
    """
    spec = site.spec
    return {
        "member": (group_record, 1, 2, 3) if spec.groups else (),
        "owner": (related_record, 2, 3) if any(group.noun for group in spec.groups.values()) else (),
        "line": (row, 1, 2) if spec.rows else (),
        "which": (extreme_row, 1) if any(rows.which for rows in spec.rows.values()) else (),
        "tally": (count_rows, 1) if any(rows.tally for rows in spec.rows.values()) else (),
        "put": (fill_cart, 2, 3) if spec.cart else (),
        "account": (account, 2, 3) if spec.account else (),
        "files": (move_files, 1, 2, 3) if spec.files else (),
        "bar": (chart_bar, 1) if spec.chart else (),
        "pin": (extreme_pin, 1, 2, 3) if spec.map else (),
    }


def _having(site: Site, chosen: dict[str, str]) -> str:
    facets = {facet.name: facet for facet in site.finder.facets}
    return " and ".join(
        site.items.fields[field].having.format(value=facets[field].text(value))
        for field, value in chosen.items()
    )


def _filters(site: Site, rng: random.Random, at_most: int) -> dict[str, str]:
    facets = rng.sample(site.finder.facets, min(rng.randint(1, at_most), len(site.finder.facets)))
    facets.sort(key=site.finder.facets.index)
    return {facet.name: rng.choice(facet.options)[0] for facet in facets}


def count(site: Site, rng: random.Random, size: int) -> Part | None:
    """Count the items that match filters."""
    chosen = _filters(site, rng, 2)
    total = len(site.find(**chosen))
    if size != 1 or total < 2:
        return None
    plural = site.spec.plural
    text, having = f"{total} {plural}", _having(site, chosen)
    return Part(
        f"find out how many {plural} {having}",
        f"Number of {plural} that {having}",
        (
            Fact(
                f"The number of {plural} that {having} is found",
                (shown(site.finder.regex(**chosen), text),),
                answer=counted(total, plural),
                what=f"the number of {plural}",
            ),
        ),
        (Click(path=site.finder.path), *site.finder.moves(**chosen), See((text,))),
    )


def extreme(site: Site, rng: random.Random, size: int) -> Part | None:
    """Find the item with the highest or lowest value of a field among those that match filters, and its
    fields."""
    if size > 3:
        return None
    field = rng.choice([field for field in site.items.labels if any(site.items.fields[field].orders)])
    spec, is_most, chosen = site.items.fields[field], rng.random() < 0.5, _filters(site, rng, 2)
    query = {**chosen, "sort": f"{field}-{'down' if is_most else 'up'}"}
    records = site.find(**query)
    if len(records) < 3 or records[0].rank(field) == records[1].rank(field):
        return None
    best, word, having = records[0], spec.most if is_most else spec.least, _having(site, chosen)
    view = (best.name, best.fields[field].text)
    ordered = shown(site.finder.regex(**query), *view)
    rows = dict.fromkeys(text for record in records for text in row_view(site, record, field))
    unordered = shown(site.finder.regex(**chosen), *rows)
    named = Fact(
        f"Among the {site.spec.plural} that {having}, the one with the {word} {spec.noun} is found",
        (ordered, unordered) if len(records) <= site.page_size else (ordered,),
        answer=(best.name,),
        what=f"the name of the {site.spec.singular} with the {word} {spec.noun}",
        wrong=tuple(record.name for record in records[1:]),
    )
    others = [other for other in site.items.labels if other not in query and other != field]
    if size > len(others) + 1:
        return None
    more = rng.sample(others, size - 1)
    more.sort(key=list(site.items.labels).index)
    request = f", and give the name and {site.items.nouns(more)}" if more else ""
    return Part(
        f"find the {site.spec.singular} with the {word} {spec.noun} among those that {having}{request}",
        f"{word} {spec.noun} among those that {having}",
        (named, *(field_fact(site, best, other, about=f"that {site.spec.singular}") for other in more)),
        (
            Click(path=site.finder.path),
            *site.finder.moves(**query),
            See(view),
            *((Click(path=site.href(best)), *view_fields(site, best, more)) if more else ()),
        ),
    )
