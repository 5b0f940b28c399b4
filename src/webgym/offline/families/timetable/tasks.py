"""The tasks of an operator's website."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from webgym.offline.engine.composing import Ask, Composer
from webgym.offline.families.timetable import journeys, places, service
from webgym.offline.parts import Assignment

if TYPE_CHECKING:
    from webgym.offline.families.timetable import Timetable

SINGLE: tuple[tuple[str, Ask[Timetable], tuple[int, ...]], ...] = (
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
LARGE: tuple[tuple[str, Ask[Timetable]], ...] = (
    ("best", journeys.ask_best),
    ("trip", journeys.ask_trip),
    ("stop", places.ask_stop),
    ("look-up", service.ask_look_up),
    ("alerts", service.ask_alerts),
    ("account", service.ask_account),
    ("disruption", places.ask_disruption),
)
SMALL: tuple[tuple[str, Ask[Timetable]], ...] = (
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


def assignments(site: Timetable) -> Iterator[Assignment]:
    """Tasks of one part, and tasks of several that can be decomposed."""
    return Composer(site, SINGLE, LARGE, SMALL, ("booking", journeys.ask_booking)).assignments()
