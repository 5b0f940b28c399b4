"""How the tasks of an operator's website are put together."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, TypeAlias

from webgym.offline.families import _timetable_journeys as journeys
from webgym.offline.families import _timetable_places as places
from webgym.offline.families import _timetable_service as service
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.timetable import Timetable

Ask: TypeAlias = Callable[["Timetable", random.Random, int], Part | None]
"""Makes a part with this many facts, or none if this draw does not give a well-posed one."""

DRAWS = 60
"""How often a part is drawn until one is well posed."""

SINGLE: tuple[tuple[str, Ask, tuple[int, ...]], ...] = (
    ("best", journeys.ask_best, (1, 2, 3)),
    ("arriving", journeys.ask_arriving, (1, 2)),
    ("count", journeys.ask_count, (1,)),
    ("trip", journeys.ask_trip, (1, 2, 3)),
    ("difference", journeys.ask_difference, (1,)),
    ("party", journeys.ask_party, (1,)),
    ("stop", places.ask_stop, (1, 2, 3)),
    ("facilities", places.ask_facilities, (1,)),
    ("facility-count", places.ask_facility_count, (1,)),
    ("line", places.ask_line, (1, 2)),
    ("which-line", places.ask_which_line, (1,)),
    ("ticket", places.ask_ticket, (1, 2)),
    ("rules", places.ask_rules, (1, 2)),
    ("help", places.ask_help, (1,)),
    ("disruption", places.ask_disruption, (1, 2)),
    ("notices", places.ask_notices, (1,)),
    ("look-up", service.ask_look_up, (1, 2, 3)),
    ("extra", service.ask_extra, (1,)),
    ("cancel", service.ask_cancel, (1,)),
    ("alerts", service.ask_alerts, (2, 3)),
    ("account", service.ask_account, (1, 2, 3)),
    ("preference", service.ask_preference, (1,)),
)
SINGLES_PER_SITE = 20
LARGE: tuple[tuple[str, Ask], ...] = (
    ("best", journeys.ask_best),
    ("trip", journeys.ask_trip),
    ("stop", places.ask_stop),
    ("look-up", service.ask_look_up),
    ("alerts", service.ask_alerts),
    ("account", service.ask_account),
    ("disruption", places.ask_disruption),
)
SMALL: tuple[tuple[str, Ask], ...] = (
    ("which-line", places.ask_which_line),
    ("ticket", places.ask_ticket),
    ("rules", places.ask_rules),
    ("help", places.ask_help),
    ("notices", places.ask_notices),
    ("facility-count", places.ask_facility_count),
    ("difference", journeys.ask_difference),
    ("extra", service.ask_extra),
    ("cancel", service.ask_cancel),
)


SHAPES = ((3, 1), (3, 1), (3, 2), (3, 3), (3, 3), (4, 3))
"""Sizes of the parts of tasks that can be decomposed; a part of more than three facts is a booking."""
LAST_SHAPES = ((3, 2, 1), (5, 3, 1))


def assignments(site: Timetable) -> Iterator[Assignment]:
    """Tasks of one part, and tasks of several that can be decomposed."""
    rng, taken = stream(site.seed, "assignments"), set[str]()
    made = 0
    for name, ask, sizes in rng.sample(SINGLE, len(SINGLE)):
        part = _draw(site, ask, name, rng.choice(sizes), taken)
        if part is not None and made < SINGLES_PER_SITE:
            made += 1
            yield Assignment(name, (part,))
    for nth, shape in enumerate((*SHAPES, rng.choice(LAST_SHAPES)), start=1):
        parts = _compose(site, rng, f"combined {nth}", shape, taken)
        if parts is not None:
            yield Assignment(f"combined-{nth}", parts)


def _draw(site: Timetable, ask: Ask, name: str, facts: int, taken: set[str]) -> Part | None:
    """A well-posed part with this many facts that was not asked before, if some draw gives one."""
    rng = stream(site.seed, "part", name, facts)
    for _ in range(DRAWS):
        part = ask(site, rng, facts)
        if part is not None and part.ask not in taken:
            taken.add(part.ask)
            return part
    return None


def _compose(
    site: Timetable, rng: random.Random, name: str, shape: Sequence[int], taken: set[str]
) -> tuple[Part, ...] | None:
    large, small = rng.sample(LARGE, len(LARGE)), rng.sample(SMALL, len(SMALL))
    parts = []
    for size in shape:
        candidates = [("booking", journeys.ask_booking)] if size > 3 else large if size == 3 else small
        while candidates:
            kind, ask = candidates.pop()
            part = _draw(site, ask, f"{name} {kind}", size, taken)
            if part is not None:
                parts.append(part)
                break
        else:
            return None
    return tuple(parts)
