"""The tasks of a specified website: their kinds, how many of each kind, and their numbers of facts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

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
from webgym.offline.engine.list_tasks import count, extreme
from webgym.offline.engine.lookup_tasks import compare, difference, either, facts
from webgym.offline.engine.navigation import Site
from webgym.offline.parts import Assignment


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
