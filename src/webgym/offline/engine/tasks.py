"""The tasks of a specified website: which kinds there are, how many of each, and of how many facts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from webgym.offline.engine.composer import Ask, Composer
from webgym.offline.engine.extra_tasks import account, bar, files, line, member, owner, pin, put, tally, which
from webgym.offline.engine.form_tasks import save, send
from webgym.offline.engine.list_tasks import count, extreme
from webgym.offline.engine.lookup_tasks import compare, difference, either, facts
from webgym.offline.engine.navigation import Site
from webgym.offline.parts import Assignment


def assignments(site: Site) -> Iterator[Assignment]:
    """The tasks of a website."""
    extra = {name: each for name, each in extra_asks(site).items() if each}
    single: list[tuple[str, Ask, tuple[int, ...]]] = [
        *_times(2 if extra else 4, "facts", facts, 1, 2, 3),
        *_times(3, "extreme", extreme, 1, 2, 3),
        *_times(2, "compare", compare, 3),
        *_times(2 if extra else 3, "count", count, 1),
        *_times(1 if extra else 2, "either", either, 1),
        *_times(2, "save", save, 1, 2, 3),
        *_times(1, "difference", difference, 3),
        *_times(3 if extra else 4, "send", send, 3, 4, 5),
        *(one for name, (ask, *sizes) in extra.items() for one in _times(2, name, ask, *sizes)),
    ]
    large: list[tuple[str, Ask]] = [
        ("facts", facts),
        ("extreme", extreme),
        ("compare", compare),
        ("difference", difference),
        ("save", save),
        *((name, ask) for name, (ask, *sizes) in extra.items() if 3 in sizes),
    ]
    small = [
        ("facts", facts),
        ("extreme", extreme),
        ("count", count),
        ("either", either),
        ("save", save),
        *((name, ask) for name, (ask, *sizes) in extra.items() if min(sizes) < 3),
    ]
    once = frozenset({"put", "account", "files"})
    yield from Composer(site, single, large, small, ("send", send), once).assignments()


def _times(count: int, name: str, ask: Ask, *sizes: int) -> Iterator[tuple[str, Ask, tuple[int, ...]]]:
    for nth in range(count):
        yield f"{name}-{nth}", ask, sizes


def extra_asks(site: Site) -> dict[str, tuple[Any, ...]]:
    """What a website asks beside, with the numbers of facts it may have; empty for no such thing."""
    spec = site.spec
    return {
        "member": (member, 1, 2, 3) if spec.groups else (),
        "owner": (owner, 2, 3) if any(each.noun for each in spec.groups.values()) else (),
        "line": (line, 1, 2) if spec.rows else (),
        "which": (which, 1) if any(each.which for each in spec.rows.values()) else (),
        "tally": (tally, 1) if any(each.tally for each in spec.rows.values()) else (),
        "put": (put, 2, 3) if spec.cart else (),
        "account": (account, 2, 3) if spec.account else (),
        "files": (files, 1, 2, 3) if spec.files else (),
        "bar": (bar, 1) if spec.chart else (),
        "pin": (pin, 1, 2, 3) if spec.map else (),
    }
