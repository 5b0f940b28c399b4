"""What an authority's website holds: services, offices, meetings, collection days, fees and cases."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import date, timedelta

from webgym.offline import names
from webgym.offline.families.government.words import WORDS, Body
from webgym.offline.seeds import stream
from webgym.offline.website import TODAY, slug

WEEKDAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday")
CHANNELS = ("Online", "In person", "By post")
STAGES = (
    "Received",
    "Papers missing",
    "With the case officer",
    "Waiting for payment",
    "Decided",
    "Sent by post",
)
MONTHS = (3, 6, 12)
SUNDAY = 6
_RUNS_OUT = ("permit", "licence", "card", "pass", "badge", "voucher", "subscription", "Passport")
"""Words in the names of services whose result is valid for some years only."""


@dataclass(frozen=True)
class Office:
    """A place to go to.

    Attributes:
        hours: (opening, closing) by weekday; ``None`` when closed.
        step_free: whether wheelchairs get in.
    """

    slug: str
    name: str
    street: str
    phone: str
    hours: tuple[tuple[str, str] | None, ...]
    step_free: bool

    def on(self, weekday: str) -> str:
        """Hours on a day, as the page writes them."""
        hours = self.hours[WEEKDAYS.index(weekday)]
        return f"{hours[0]} to {hours[1]}" if hours else "closed"


@dataclass(frozen=True)
class Service:
    """Something that people come for.

    Attributes:
        fee: in the currency's whole units; 0 is free.
        days: until it is done, working days.
        valid: years; 0 if it does not run out.
    """

    slug: str
    name: str
    group: str
    channel: str
    fee: int
    days: int
    valid: int
    papers: tuple[str, ...]
    office: Office
    steps: tuple[str, ...]
    key: str


@dataclass(frozen=True)
class Decision:
    """An item of a meeting, and how it was voted on."""

    matter: str
    proposer: str
    ayes: int
    noes: int
    abstained: int

    @property
    def carried(self) -> bool:
        """Whether it was."""
        return self.ayes > self.noes


@dataclass(frozen=True)
class Meeting:
    """A meeting and its minutes."""

    slug: str
    body: str
    day: date
    chair: str
    present: int
    room: str
    decisions: tuple[Decision, ...]

    @property
    def title(self) -> str:
        """As the list has it."""
        return f"{self.body}, {self.day.day} {self.day:%B %Y}"


@dataclass(frozen=True)
class Round:
    """The next dates in a street, one for every kind of round."""

    street: str
    days: tuple[date, ...]


@dataclass(frozen=True)
class Case:
    """Something under way, to be looked up by its number."""

    number: str
    subject: str
    stage: str
    officer: str
    updated: date


def make_offices(seed: int) -> tuple[Office, ...]:
    """Four to six offices; exactly one has steps."""
    rng = stream(seed, "offices")
    count = rng.randint(4, 6)
    streets = rng.sample(WORDS.streets, count)
    stepped = rng.randrange(count)
    found = []
    for nth, name in enumerate(rng.sample(WORDS.offices, count)):
        hours: list[tuple[str, str] | None] = []
        for weekday in WEEKDAYS:
            if (weekday == "Saturday" and rng.random() < 0.6) or (
                weekday != "Saturday" and rng.random() < 0.1
            ):
                hours.append(None)
            else:
                last = (
                    ("12:00", "12:30", "13:00")
                    if weekday == "Saturday"
                    else ("15:30", "16:00", "17:00", "18:30")
                )
                hours.append((rng.choice(("07:30", "08:00", "08:30", "09:00", "10:00")), rng.choice(last)))
        phone = f"0{rng.randint(210, 890)} {rng.randint(10, 99)} {rng.randint(1000, 9999)}"
        street = f"{streets[nth]} {rng.randint(1, 88)}"
        found.append(Office(slug(name), name, street, phone, tuple(hours), nth != stepped))
    return tuple(found)


def make_services(seed: int, body: Body, offices: tuple[Office, ...]) -> tuple[Service, ...]:
    """Every service of the body's groups, by name."""
    rng = stream(seed, "services")
    found = [
        _service(rng, name, group, rng.choice(offices))
        for group in body.groups
        for name in WORDS.services[group]
    ]
    return tuple(sorted(found, key=lambda service: service.name))


def _service(rng: random.Random, name: str, group: str, office: Office) -> Service:
    key = rng.choice(("two weeks", "three weeks", "ten days", "five days", "six weeks", "one month"))
    first = rng.choice(
        (
            "Choose a time in the booking calendar.",
            "Fill in the form and sign it.",
            "Call us to be given a case number.",
        )
    )
    last = rng.choice(
        (
            "Fetch it in person; bring the slip.",
            "We send it to you by post.",
            "You get a message when it is ready.",
        )
    )
    return Service(
        slug=slug(name),
        name=name,
        group=group,
        channel=rng.choice(CHANNELS),
        fee=rng.choice((0, *range(4, 180, 3))),
        days=rng.randint(1, 60),
        valid=rng.choice((1, 2, 3, 5, 10)) if any(word in name for word in _RUNS_OUT) else 0,
        papers=tuple(rng.sample(WORDS.papers, rng.randint(2, 5))),
        office=office,
        steps=(
            first,
            "Bring or upload the documents named above.",
            f"Pay the fee within {key}, or the application lapses.",
            last,
        ),
        key=key,
    )


def make_meetings(seed: int, body: Body) -> tuple[Meeting, ...]:
    """Twelve to eighteen meetings of the past year, newest first."""
    rng = stream(seed, "meetings")
    count = rng.randint(12, 18)
    workdays = [age for age in range(5, 360) if (TODAY - timedelta(days=age)).weekday() < SUNDAY - 1]
    days = sorted(rng.sample(workdays, count))
    members = names.people(rng, 9)
    found = []
    for age in days:
        day = TODAY - timedelta(days=age)
        which = rng.choice(body.council)
        seats = rng.randint(15, 31)
        decisions = []
        for matter in rng.sample(body.matters, rng.randint(2, 4)):
            noes, abstained = rng.randint(0, seats // 2), rng.randint(0, 4)
            ayes = seats - noes - abstained
            if ayes == noes:
                ayes, abstained = ayes + 1, abstained - 1 if abstained else 0
            decisions.append(Decision(matter, rng.choice(members), ayes, noes, abstained))
        room = rng.choice(("Council chamber", "Room 12", "Great hall", "Room 204"))
        key = f"{slug(which)}-{day.isoformat()}"
        found.append(Meeting(key, which, day, rng.choice(members), seats, room, tuple(decisions)))
    return tuple(found)


def make_rounds(seed: int, kinds: int) -> tuple[Round, ...]:
    """Dates of every kind in 14 to 18 streets."""
    rng = stream(seed, "rounds")
    streets = sorted(rng.sample(WORDS.streets, rng.randint(14, 18)))
    ahead = [day for day in range(1, 27) if (TODAY + timedelta(days=day)).weekday() != SUNDAY]
    return tuple(
        Round(street, tuple(TODAY + timedelta(days=day) for day in rng.sample(ahead, kinds)))
        for street in streets
    )


def make_tariff(seed: int, body: Body) -> dict[tuple[str, str, int], int]:
    """The calculator's fee for every combination of answers, in whole units of the currency."""
    rng = stream(seed, "tariff")
    _, places, kinds = body.price
    base = rng.randint(6, 15)
    by_place = dict(zip(places, rng.sample(range(8, 22), len(places)), strict=True))
    by_kind = dict(zip(kinds, sorted(rng.sample(range(3, 30), len(kinds))), strict=True))
    return {
        (place, kind, months): base + (by_place[place] + by_kind[kind]) * months // 3
        for place in places
        for kind in kinds
        for months in MONTHS
    }


def make_cases(seed: int, services: tuple[Service, ...]) -> tuple[Case, ...]:
    """Four cases under way."""
    rng = stream(seed, "cases")
    numbers = rng.sample(range(10000, 99999), 4)
    stages = rng.sample(STAGES, 4)
    return tuple(
        Case(
            f"C-{number}",
            service.name,
            stage,
            names.person(rng),
            TODAY - timedelta(days=rng.randint(1, 20)),
        )
        for number, stage, service in zip(numbers, stages, rng.sample(services, 4), strict=True)
    )
