"""The catalogue of an organiser: venues, people, what takes place, and what took place before."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date, timedelta
from functools import cached_property

from webgym.offline import names
from webgym.offline.families.events.kinds import WORDS, Kind
from webgym.offline.seeds import pick, stream
from webgym.offline.website import TODAY, slug

MONTHS = ((2026, 5), (2026, 6), (2026, 7), (2026, 8))
"""Months that are on sale."""
SEASONS = (2023, 2024, 2025)
LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"


def reference(*parts: object) -> str:
    """An order number of eight characters that belongs to ``parts``."""
    rng = stream("order", *parts)
    return "".join(rng.choice(LETTERS) for _ in range(8))


def month_key(day: date) -> str:
    """``2026-05``."""
    return f"{day:%Y-%m}"


@dataclass(frozen=True)
class Venue:
    """A place where events are."""

    name: str
    slug: str
    address: str
    seats: int
    opened: int
    stop: str
    walk: int
    phone: str
    box_office: tuple[int, int]
    wheelchair: int
    parking: int


@dataclass(frozen=True)
class Person:
    """Somebody who appears; in a league, a club."""

    name: str
    slug: str
    home: str
    since: int
    role: str
    words: str


@dataclass(frozen=True)
class Band:
    """A price band of an event."""

    name: str
    cents: int
    left: int


@dataclass(frozen=True)
class Event:
    """Something that takes place."""

    title: str
    slug: str
    category: str
    venue: Venue
    day: date
    start: int
    doors: int
    minutes: int
    age: int
    people: tuple[Person, ...]
    bands: tuple[Band, ...]
    access: tuple[str, ...]
    about: str

    @property
    def cents(self) -> int:
        """The lowest price."""
        return self.bands[0].cents

    @property
    def sold_out(self) -> bool:
        """Whether no ticket is left in any band."""
        return all(band.left == 0 for band in self.bands)

    @property
    def status(self) -> str:
        """What a listing says about tickets."""
        left = sum(band.left for band in self.bands)
        return "Sold out" if left == 0 else "Few left" if left < 30 else "On sale"


@dataclass(frozen=True)
class Past:
    """Something that took place."""

    title: str
    season: int
    day: date
    venue: Venue
    visitors: int
    home: Person | None = None
    away: Person | None = None
    score: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Standing:
    """A row of a league's table."""

    place: int
    club: Person
    played: int
    won: int
    drawn: int
    lost: int
    goals: int
    against: int

    @property
    def points(self) -> int:
        """Three for a win, one for a draw."""
        return 3 * self.won + self.drawn


@dataclass
class Season:
    """Everything an organiser puts on.

    Args:
        seed: of the website.
        kind: of the organiser.
    """

    seed: int
    kind: Kind
    venues: list[Venue] = field(init=False)
    people: list[Person] = field(init=False)
    events: list[Event] = field(init=False)

    def __post_init__(self) -> None:
        rng = stream(self.seed, "season")
        places = names.towns(rng, 40)
        self.venues = [self._venue(rng, town) for town in places[: rng.randint(3, 6)]]
        self.people = self._people(rng, places[8:])
        self.events = self._events(rng)

    def _venue(self, rng: random.Random, town: str) -> Venue:
        name = rng.choice(self.kind.venues).format(town)
        opens = rng.randrange(9 * 60, 12 * 60, 30)
        return Venue(
            name=name,
            slug=slug(name),
            address=f"{rng.randint(1, 140)} {rng.choice(WORDS.streets)} "
            f"{rng.choice(('Street', 'Lane', 'Square'))}",
            seats=rng.choice((10, 10, 100 if self.kind.league else 10)) * rng.randint(8, 190),
            opened=rng.randint(1860, 2021),
            stop=f"{rng.choice(WORDS.streets)} {rng.choice(('Cross', 'Gate', 'Green', 'Corner'))}",
            walk=rng.randint(2, 19),
            phone=f"0{rng.randint(200, 989)} {rng.randint(100, 999)} {rng.randint(1000, 9999)}",
            box_office=(opens, rng.randrange(16 * 60, 20 * 60, 30)),
            wheelchair=rng.randint(2, 40),
            parking=rng.randint(2, 80) * 5,
        )

    def _people(self, rng: random.Random, towns: Sequence[str]) -> list[Person]:
        count = rng.randint(10, 12) if self.kind.league else rng.randint(12, 20)
        if self.kind.league:
            ends = ("Rovers", "United", "Athletic", "Town", "Wanderers", "Albion")
            called = [f"{town} {rng.choice(ends)}" for town in towns[:count]]
        else:
            called = names.people(rng, count)
        found = []
        for nth, name in enumerate(called):
            home = towns[nth] if self.kind.league else rng.choice(towns)
            since = rng.randint(1871, 1990) if self.kind.league else rng.randint(1948, 2003)
            found.append(
                Person(name, slug(name), home, since, rng.choice(self.kind.role[1]), rng.choice(WORDS.about))
            )
        return sorted(found, key=lambda person: person.name)

    def _titles(self, rng: random.Random) -> dict[str, tuple[Person, ...]]:
        kind, found = self.kind, dict[str, tuple[Person, ...]]()
        wanted = rng.randint(30, 52)
        while len(found) < wanted:
            who, other = rng.sample(self.people, 2)
            pattern = rng.choice(kind.titles)
            title = pattern.format(
                one=rng.choice(kind.ones or ("",)),
                two=rng.choice(kind.twos or ("",)),
                who=who.name,
                other=other.name,
            )
            people = (who, other) if "{other}" in pattern or rng.random() < 0.3 else (who,)
            # A title inside another one could be taken for it.
            if not any(title in known or known in title for known in found):
                found[title] = people
        return found

    def _events(self, rng: random.Random) -> list[Event]:
        last = date(MONTHS[-1][0], MONTHS[-1][1], 31)
        days = [TODAY + timedelta(days=ahead) for ahead in range(1, (last - TODAY).days + 1)]
        found = []
        for title, people in self._titles(rng).items():
            minutes = rng.randint(*self.kind.minutes)
            start = rng.randrange(self.kind.hours[0] * 60, self.kind.hours[1] * 60 + 1, 15)
            venue = rng.choice(self.venues)
            found.append(
                Event(
                    title=title,
                    slug=slug(title),
                    category=rng.choice(self.kind.categories),
                    venue=venue,
                    day=rng.choice(days),
                    start=start,
                    doors=start - rng.choice((15, 20, 30, 45, 60)),
                    minutes=minutes,
                    age=rng.choice((0, 0, 6, 8, 12, 14, 16)),
                    people=people,
                    bands=self._bands(rng),
                    access=tuple(sorted(rng.sample(WORDS.access, rng.randint(1, 4)))),
                    about=" ".join(rng.sample(WORDS.about, 2)),
                )
            )
        return sorted(found, key=lambda event: (event.day, event.start, event.title))

    def _bands(self, rng: random.Random) -> tuple[Band, ...]:
        base = rng.randint(*self.kind.price) * 100 + pick((0, 50, 90), self.seed, "ending")
        gone = rng.random()
        bands = []
        for name, factor in self.kind.bands:
            cents = base if factor == 1.0 else int(base * factor) // 50 * 50
            left = 0 if gone < 0.12 else rng.choice((0, rng.randint(1, 9), rng.randint(10, 240), 160))
            bands.append(Band(name, cents, left))
        if gone >= 0.12 and not any(band.left for band in bands):
            bands[0] = Band(bands[0].name, bands[0].cents, 40)
        return tuple(bands)

    def event(self, wanted: str) -> Event | None:
        """The event with this slug."""
        return next((event for event in self.events if event.slug == wanted), None)

    def venue(self, wanted: str) -> Venue | None:
        """The venue with this slug."""
        return next((venue for venue in self.venues if venue.slug == wanted), None)

    def person(self, wanted: str) -> Person | None:
        """The person with this slug."""
        return next((person for person in self.people if person.slug == wanted), None)

    def with_person(self, person: Person) -> list[Event]:
        """Events in which somebody appears."""
        return [event for event in self.events if person in event.people]

    # --- what took place before ------------------------------------------------------------------------

    @cached_property
    def past(self) -> list[Past]:
        """What took place, the latest first."""
        rng, found = stream(self.seed, "past"), []
        for season in SEASONS:
            for title in self._past_titles(rng):
                day = date(season, 1, 1) + timedelta(days=rng.randrange(364))
                venue = rng.choice(self.venues)
                visitors = int(venue.seats * rng.uniform(0.35, 1.0))
                home, _, away = title.partition(" v ")
                clubs = {person.name: person for person in self.people}
                if self.kind.league:
                    score = (rng.choice((0, 0, 1, 1, 2, 3, 4)), rng.choice((0, 0, 1, 1, 2, 3)))
                    found.append(Past(title, season, day, venue, visitors, clubs[home], clubs[away], score))
                else:
                    found.append(Past(title, season, day, venue, visitors))
        return sorted(found, key=lambda past: (past.day, past.title), reverse=True)

    def _past_titles(self, rng: random.Random) -> list[str]:
        if self.kind.league:
            pairs = [(a, b) for a in self.people for b in self.people if a != b]
            return [f"{a.name} v {b.name}" for a, b in rng.sample(pairs, rng.randint(22, 30))]
        titles = [f"{one} {two}" for one in self.kind.ones for two in self.kind.twos]
        return rng.sample(titles, rng.randint(12, 18))

    @cached_property
    def standings(self) -> list[Standing]:
        """A league's table; it counts matches that the results do not list."""
        rng, rows = stream(self.seed, "standings"), []
        for club in self.people:
            won, drawn, lost = rng.randint(2, 16), rng.randint(0, 8), rng.randint(2, 14)
            goals, against = won * 2 + drawn + rng.randint(0, 14), lost * 2 + drawn + rng.randint(0, 12)
            rows.append((club, won + drawn + lost, won, drawn, lost, goals, against))
        rows.sort(key=lambda row: (3 * row[2] + row[3], row[5] - row[6], row[0].name), reverse=True)
        return [Standing(place, *row) for place, row in enumerate(rows, start=1)]

    @cached_property
    def rules(self) -> dict[str, int]:
        """The numbers in the information for visitors."""
        rng = stream(self.seed, "rules")
        return {
            "days": rng.randint(2, 21),
            "fee": rng.randint(1, 9),
            "group": rng.randint(8, 20),
            "group_off": rng.choice((10, 15, 20, 25)),
            "student_off": rng.choice((30, 40, 50)),
            "bag": rng.randrange(20, 46, 5),
            "cloak": rng.randint(1, 4),
            "young": rng.randint(3, 8),
            "adult": rng.randint(2, 5),
            "late": rng.randrange(5, 30, 5),
            "form": rng.randint(10, 99),
        }
