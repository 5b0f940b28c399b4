"""The tasks of an organiser's website."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from webgym.offline.families._composing import Ask, Composer
from webgym.offline.families.events import around, programme
from webgym.offline.parts import Assignment

if TYPE_CHECKING:
    from webgym.offline.families.events import Events

SINGLE: tuple[tuple[str, Ask[Events], tuple[int, ...]], ...] = (
    ("event", programme.ask_event, (1, 2, 3)),
    ("event-again", programme.ask_event, (1, 2)),
    ("best", programme.ask_best, (1, 2, 3)),
    ("best-again", programme.ask_best, (1, 2)),
    ("count", programme.ask_count, (1,)),
    ("day", programme.ask_day, (1, 2)),
    ("compare", programme.ask_compare, (3,)),
    ("total", programme.ask_total, (1,)),
    ("sold-out", programme.ask_sold_out, (1,)),
    ("access", programme.ask_access, (1,)),
    ("save", programme.ask_save, (1,)),
    ("venue", around.ask_venue, (1, 2, 3)),
    ("venue-again", around.ask_venue, (1, 2)),
    ("which-venue", around.ask_which_venue, (1,)),
    ("person", around.ask_person, (1, 2, 3)),
    ("role-count", around.ask_role_count, (1,)),
    ("past", around.ask_past, (1, 2, 3)),
    ("result", around.ask_result, (1, 2)),
    ("standings", around.ask_standings, (1, 2)),
    ("rules", around.ask_rules, (1, 2)),
    ("return", around.ask_return, (1,)),
    ("news", around.ask_news, (2, 3)),
)
LARGE: tuple[tuple[str, Ask[Events]], ...] = (
    ("event", programme.ask_event),
    ("best", programme.ask_best),
    ("compare", programme.ask_compare),
    ("venue", around.ask_venue),
    ("person", around.ask_person),
    ("past", around.ask_past),
    ("news", around.ask_news),
    ("standings", around.ask_standings),
)
SMALL: tuple[tuple[str, Ask[Events]], ...] = (
    ("count", programme.ask_count),
    ("total", programme.ask_total),
    ("save", programme.ask_save),
    ("which-venue", around.ask_which_venue),
    ("role-count", around.ask_role_count),
    ("result", around.ask_result),
    ("rules", around.ask_rules),
    ("day", programme.ask_day),
)


def assignments(site: Events) -> Iterator[Assignment]:
    """Tasks of one part, and tasks of several that can be decomposed."""
    return Composer(site, SINGLE, LARGE, SMALL, ("tickets", programme.ask_tickets)).assignments()
