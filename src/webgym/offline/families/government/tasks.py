"""What is asked for on the authorities' websites."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from webgym.offline.families._asking import compose
from webgym.offline.families.government.deeds import Deeds
from webgym.offline.families.government.lists import Lists
from webgym.offline.families.government.one import OnePage
from webgym.offline.families.government.papers import Papers
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.government import Government


def assignments(site: Government) -> Iterator[Assignment]:
    """About 25 tasks before decomposition."""
    rng = stream(site.seed, "tasks")
    services = list(site.services)
    rng.shuffle(services)
    draw = iter(services)
    one, many, paper, do = OnePage(site), Lists(site), Papers(site), Deeds(site)
    singles: dict[str, Part | None] = {
        "fee": one.fee(next(service for service in services if service.fee)),
        "papers": one.papers(next(draw)),
        "how-to": one.howto(next(draw)),
        "validity": one.validity(next(service for service in services[::-1] if service.valid)),
        "closing-time": one.closing_time(),
        "steps-at-the-door": one.steps_at_the_door(),
        "early-or-saturday": one.early_or_saturday(),
        "next-date": paper.next_dates(1),
        "calculator": paper.price(),
        "case": paper.case(),
        "carried": paper.vote(),
        "rejected": paper.rejected(),
        "fastest": many.extreme("days", 0),
        "cheapest": many.extreme("fee", 1),
        "slowest": many.slowest(),
        "count": many.count(0),
        "either": many.either(),
        "first-meeting": many.first_meeting(),
        "permit": do.permit(0),
        "report": do.trouble(0),
    }
    for name, part in singles.items():
        yield from compose(name, [part])
    composed: dict[str, list[Part | None]] = {
        "service-and-dates": [one.service(next(draw)), paper.next_dates(3)],
        "office-and-count": [one.office(), many.count(1)],
        "minutes-and-permit": [paper.minutes(), do.permit(1)],
        "prices-report-how": [paper.prices(), do.trouble(1), one.howto(next(draw))],
        "fastest-and-service": [many.extreme("days", 2, deeper=True), one.service(next(draw))],
        "dates-office-case": [paper.next_dates(3), one.office(), paper.case()],
    }
    for name, parts in composed.items():
        yield from compose(name, parts)
