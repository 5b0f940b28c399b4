"""An operator's network: its stops and lines, what runs on them, and what that costs."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from datetime import date, timedelta
from functools import cached_property

from webgym.offline import names
from webgym.offline.families.timetable.modes import Mode
from webgym.offline.families.timetable.words import LINE_NAMES
from webgym.offline.seeds import pick, stream
from webgym.offline.website import TODAY, slug

DAYS_AHEAD = 14
"""Tickets are sold from tomorrow for this many days."""
PLACES_PER_PAIR = 15
"""Service numbers that every pair of stops has for itself."""


def days_on_sale() -> list[date]:
    """The days for which tickets can be bought."""
    return [TODAY + timedelta(days=ahead) for ahead in range(1, DAYS_AHEAD + 1)]


def spell(day: date) -> str:
    """``Tue 12 May 2026``."""
    return f"{day:%a} {day.day} {day:%b %Y}"


@dataclass(frozen=True)
class Hours:
    """When the counter of a stop is open: minutes after midnight, or closed all day."""

    days: str
    opens: int
    closes: int

    @property
    def closed(self) -> bool:
        """Whether it does not open at all."""
        return self.opens >= self.closes


@dataclass(frozen=True)
class Stop:
    """A place that the operator serves."""

    name: str
    slug: str
    bays: int
    phone: str
    address: str
    parking: int
    facilities: tuple[str, ...]
    hours: tuple[Hours, Hours, Hours]
    opened: int


@dataclass(frozen=True)
class Line:
    """Stops in a row; ``at`` has their distance from the hub in km, negative on one side."""

    name: str
    slug: str
    stops: tuple[Stop, ...]
    at: tuple[int, ...]
    every: int
    first: int
    last: int

    @property
    def km(self) -> int:
        """Length of the whole line."""
        return self.at[-1] - self.at[0]


@dataclass(frozen=True)
class Departure:
    """One service between two stops, on the days it runs.

    Attributes:
        code: as travellers know it, ``IC 1204``.
        minute: of departure, after midnight.
        length: of the journey in minutes, waiting included.
        change: where to change and how long to wait, or ``None`` if direct.
        calls: stops on the way with minutes after departure.
    """

    code: str
    origin: Stop
    target: Stop
    minute: int
    length: int
    change: tuple[Stop, int] | None
    calls: tuple[tuple[Stop, int], ...]
    runs: str
    cents: int
    bay: int
    amenities: tuple[str, ...]

    @property
    def slug(self) -> str:
        """For addresses."""
        return slug(self.code)

    def runs_on(self, day: date) -> bool:
        """Whether it runs on this day."""
        weekend = day.weekday() >= 5
        return self.runs == "daily" or (self.runs == "weekend") == weekend


@dataclass(frozen=True)
class Offer:
    """A departure on a day, with its lowest price for one traveller in cents."""

    departure: Departure
    day: date
    cents: int


@dataclass
class Network:
    """Stops, lines, services and prices.

    Args:
        seed: of the website.
        mode: kind of operator.
    """

    seed: int
    mode: Mode
    hub: Stop = field(init=False)
    lines: list[Line] = field(init=False)
    stops: list[Stop] = field(init=False)

    def __post_init__(self) -> None:
        rng = stream(self.seed, "network")
        arms = [(rng.randint(1, 2), rng.randint(1, 2)) for _ in range(rng.choice((3, 3, 4)))]
        places = iter(self._stops(rng, 1 + sum(left + right for left, right in arms)))
        self.hub = next(places)
        self.lines = []
        for title, (left, right) in zip(rng.sample(LINE_NAMES, len(arms)), arms, strict=True):
            at = [0]
            for _ in range(left):
                at.insert(0, at[0] - rng.randint(*self.mode.step_km))
            for _ in range(right):
                at.append(at[-1] + rng.randint(*self.mode.step_km))
            row = [next(places) for _ in range(left)]
            row += [self.hub, *(next(places) for _ in range(right))]
            name = f"{title} {self.mode.line}"
            first, last = (
                self.mode.hours[0] * 60 + rng.randrange(60),
                self.mode.hours[1] * 60 + rng.randrange(60),
            )
            every = rng.choice((20, 30, 40, 45, 60, 90, 120))
            self.lines.append(Line(name, slug(name), tuple(row), tuple(at), every, first, last))
        self.stops = sorted({stop for line in self.lines for stop in line.stops}, key=lambda stop: stop.name)

    def _stops(self, rng: random.Random, count: int) -> list[Stop]:
        made = []
        for town in names.towns(rng, count):
            name = rng.choice(self.mode.stop_names).format(town)
            opens, closes = rng.randrange(5 * 60, 9 * 60, 15), rng.randrange(17 * 60, 23 * 60, 15)
            saturday = (opens + rng.randrange(15, 120, 15), closes - rng.randrange(30, 180, 15))
            sunday = (0, 0) if rng.random() < 0.4 else (saturday[0] + 30, saturday[1] - 60)
            number, street = rng.randint(1, 180), rng.choice(names.TOWN_FIRST)
            made.append(
                Stop(
                    name=name,
                    slug=slug(name),
                    bays=rng.randint(2, 14),
                    phone=f"0{rng.randint(200, 989)} {rng.randint(100, 999)} {rng.randint(1000, 9999)}",
                    address=f"{number} {street} {rng.choice(('Street', 'Road', 'Way', 'Square', 'Quay'))}",
                    parking=rng.randint(2, 60) * 10,
                    facilities=tuple(
                        item for item in self.mode.facilities if rng.random() < rng.choice((0.35, 0.5, 0.7))
                    ),
                    hours=(
                        Hours("Monday to Friday", opens, closes),
                        Hours("Saturday", *saturday),
                        Hours("Sunday", *sunday),
                    ),
                    opened=rng.randint(1871, 2021),
                )
            )
        return made

    def stop(self, text: str) -> Stop | None:
        """The stop with this slug or name."""
        wanted = slug(text)
        return next((stop for stop in self.stops if stop.slug == wanted), None)

    def line(self, wanted: str) -> Line | None:
        """The line with this slug."""
        return next((line for line in self.lines if line.slug == wanted), None)

    def lines_of(self, stop: Stop) -> list[Line]:
        """Lines that call at a stop."""
        return [line for line in self.lines if stop in line.stops]

    def pairs(self) -> list[tuple[Stop, Stop]]:
        """All ordered pairs of stops."""
        return [(a, b) for a in self.stops for b in self.stops if a != b]

    # --- the timetable ----------------------------------------------------------------------------------

    def _way(self, origin: Stop, target: Stop) -> tuple[int, list[tuple[Stop, int]], bool]:
        """Kilometres, stops in between with their distance from the origin, and whether on one line."""
        for line in self.lines:
            if origin in line.stops and target in line.stops:
                a, b = line.stops.index(origin), line.stops.index(target)
                step = 1 if a < b else -1
                between = [(line.stops[i], abs(line.at[i] - line.at[a])) for i in range(a + step, b, step)]
                return abs(line.at[a] - line.at[b]), between, True
        first, before, _ = self._way(origin, self.hub)
        second, after, _ = self._way(self.hub, target)
        return first + second, [*before, (self.hub, first), *((s, first + km) for s, km in after)], False

    def _prefix(self, origin: Stop, target: Stop) -> str:
        return pick(self.mode.prefixes, self.seed, "prefix", *sorted((origin.name, target.name)))

    def departures(self, origin: Stop, target: Stop) -> list[Departure]:
        """All services from one stop to another, by time of departure."""
        key = (origin.slug, target.slug)
        if key not in self._made:
            self._made[key] = self._schedule(origin, target)
        return self._made[key]

    @cached_property
    def _made(self) -> dict[tuple[str, str], list[Departure]]:
        return {}

    def _schedule(self, origin: Stop, target: Stop) -> list[Departure]:
        mode, rng = self.mode, stream(self.seed, "schedule", origin.slug, target.slug)
        km, between, same_line = self._way(origin, target)
        count = rng.randint(*mode.a_day)
        start, end = mode.hours[0] * 60, mode.hours[1] * 60 + 55
        step = (end - start) / count
        base = 100 + (self.stops.index(origin) * len(self.stops) + self.stops.index(target)) * PLACES_PER_PAIR
        prefix, found = self._prefix(origin, target), []
        for nth in range(count):
            ride = mode.overhead + km / mode.speed * 60 * rng.uniform(0.94, 1.22)
            direct = not between or rng.random() < (0.62 if same_line else 0.3)
            where = rng.choice(between)[0] if same_line and between else self.hub
            wait = 0 if direct else max(4, int(ride * rng.uniform(0.08, 0.3)))
            after_change = {stop for stop, at in between if not direct and at > dict(between)[where]}
            calls = tuple(
                (stop, int(ride * at / km) + (wait if stop in after_change else 0))
                for stop, at in between
                if mode.name != "flight" or (not direct and stop == where)
            )
            found.append(
                Departure(
                    code=f"{prefix} {base + nth}",
                    origin=origin,
                    target=target,
                    minute=int(start + step * nth + rng.uniform(0, step * 0.85)),
                    length=int(ride) + wait,
                    change=None if direct else (where, wait),
                    calls=calls if rng.random() < 0.8 or not direct else (),
                    runs=rng.choices(("daily", "weekdays", "weekend"), (80, 12, 8))[0],
                    cents=int((mode.fare[0] + mode.fare[1] * km) * 100 * rng.uniform(0.75, 1.4)),
                    bay=rng.randint(1, origin.bays),
                    amenities=tuple(sorted(rng.sample(mode.amenities, rng.randint(2, 4)))),
                )
            )
        return found

    def departure(self, wanted: str) -> Departure | None:
        """The service with this slug."""
        digits = wanted.rpartition("-")[2]
        if not digits.isdecimal() or len(digits) > 6 or int(digits) < 100:
            return None
        pair = (int(digits) - 100) // PLACES_PER_PAIR
        a, b = divmod(pair, len(self.stops))
        if a >= len(self.stops) or a == b:
            return None
        services = self.departures(self.stops[a], self.stops[b])
        return next((service for service in services if service.slug == wanted), None)

    def offers(self, origin: Stop, target: Stop, day: date) -> list[Offer]:
        """What runs from one stop to another on a day, by time of departure."""
        services = [service for service in self.departures(origin, target) if service.runs_on(day)]
        return [self.offer(service, day) for service in services]

    def offer(self, service: Departure, day: date) -> Offer:
        """A service on a day, with that day's price."""
        rng = stream(self.seed, "price", service.code, day)
        busy = 1.18 if day.weekday() in (4, 6) else 1.0
        return Offer(service, day, self.rounded(service.cents * busy * rng.uniform(0.9, 1.25)))

    def rounded(self, cents: float) -> int:
        """A price with the endings that this operator's prices have."""
        step, ending = pick(((10, 0), (50, 0), (10, 0), (5, 0), (100, 90), (10, 5)), self.seed, "prices")
        return max(100, int(cents) // step * step + ending)

    def fare(self, offer: Offer, klass: str) -> int:
        """Price of an offer for one traveller in a class, in cents."""
        factor = dict(self.mode.classes)[klass]
        return offer.cents if factor == 1.0 else self.rounded(offer.cents * factor)
