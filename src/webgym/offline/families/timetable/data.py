"""What an operator writes: conditions, disruptions, bookings, answers and an account."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, timedelta
from functools import cached_property

from webgym.offline import names
from webgym.offline.families.timetable.network import Departure, Line, Network, days_on_sale
from webgym.offline.families.timetable.words import DESKS, HELP, LINE_NAMES, TICKETS
from webgym.offline.seeds import pick, stream
from webgym.offline.website import TODAY, slug

LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"


def reference(*parts: object) -> str:
    """A booking reference of six characters that belongs to ``parts``."""
    rng = stream("reference", *parts)
    return "".join(rng.choice(LETTERS) for _ in range(6))


@dataclass(frozen=True)
class Ticket:
    """A kind of ticket and its conditions."""

    name: str
    change_fee: int
    refund: str
    valid: str
    surcharge: int


@dataclass(frozen=True)
class Disruption:
    """Something that does not run as planned."""

    slug: str
    cause: str
    line: Line
    starts: date
    ends: date
    status: str
    delay: int
    instead: str


@dataclass(frozen=True)
class Booking:
    """A booking that somebody made before."""

    reference: str
    given: str
    surname: str
    departure: Departure
    day: date
    klass: str
    coach: str
    place: int
    ticket: str
    paid: int


@dataclass(frozen=True)
class Topic:
    """A question with its answer; ``form`` is the word that only the right answer has."""

    question: str
    asks: str
    answer: str
    form: str
    desk: str


@dataclass(frozen=True)
class Member:
    """The account that a visitor may sign in to."""

    name: str
    email: str
    password: str
    number: str
    points: int
    tier: str
    voucher: int
    expires: date


class Operator(Network):
    """A network and what the operator writes about it."""

    @cached_property
    def tickets(self) -> list[Ticket]:
        """Kinds of tickets, the strictest first."""
        rng = stream(self.seed, "tickets")
        fees = sorted(rng.sample(range(4, 60, 3), 3), reverse=True)
        refunds = [
            "No refund",
            f"{rng.choice((30, 40, 50))} % back until {rng.randint(5, 12)} days before",
            f"{rng.choice((70, 80, 85))} % back until {rng.randint(1, 4)} days before",
            f"{rng.choice((95, 100))} % back until {rng.choice((1, 2, 4))} hours before",
        ]
        valid = [
            "Booked departure only",
            f"{rng.randint(1, 3)} hours either side",
            "Any departure that day",
            f"Any day within {rng.randint(2, 9)} weeks",
        ]
        extra = [0, *sorted(rng.sample(range(10, 95, 5), 3))]
        kinds = pick(TICKETS, self.seed, "ticket names")
        rows = zip(kinds, [*fees, 0], refunds, valid, extra, strict=True)
        return [Ticket(*row) for row in rows]

    @cached_property
    def rules(self) -> dict[str, int]:
        """The numbers in the conditions of carriage."""
        rng = stream(self.seed, "rules")
        return {
            "pieces": rng.randint(1, 3),
            "kilos": rng.randrange(16, 35),
            "oversize": rng.randint(5, 29),
            "free_age": rng.randint(3, 7),
            "half_age": rng.randint(12, 17),
            "child_off": rng.choice((25, 30, 40, 50, 60)),
            "group": rng.randint(6, 12),
            "group_off": rng.choice((10, 15, 20, 35)),
            "bike": rng.randint(3, 18),
            "dog": rng.randint(2, 16),
            "bike_hours": rng.choice((2, 4, 6, 12, 24)),
            "cages": rng.randint(1, 3),
        }

    @cached_property
    def disruptions(self) -> list[Disruption]:
        """What does not run as planned, the latest first."""
        rng = stream(self.seed, "disruptions")
        causes = [(cause, line) for cause in self.mode.causes for line in self.lines]
        found = []
        for cause, line in rng.sample(causes, rng.randint(6, 8)):
            starts = TODAY + timedelta(days=rng.randint(-9, 9))
            ends = starts + timedelta(days=rng.randint(1, 12))
            status = "Planned" if starts > TODAY else "Resolved" if ends < TODAY else "Active"
            instead = rng.choice(
                (
                    "replacement coaches run instead",
                    "please travel earlier or later",
                    "tickets are valid on other lines",
                    "some departures are cancelled",
                    "seats cannot be reserved",
                )
            )
            title = slug(f"{cause} {line.name}")
            found.append(Disruption(title, cause, line, starts, ends, status, rng.randint(5, 75), instead))
        return sorted(found, key=lambda item: (item.starts, item.slug), reverse=True)

    @cached_property
    def bookings(self) -> list[Booking]:
        """Bookings that others made and that can be looked up."""
        rng = stream(self.seed, "bookings")
        surnames = rng.sample(names.FAMILY, 6)
        found = []
        for surname in surnames:
            origin, target = rng.choice(self.pairs())
            day = rng.choice(days_on_sale()[3:])
            offers = self.offers(origin, target, day)
            offer = rng.choice(offers)
            klass = rng.choice(self.mode.classes)[0]
            found.append(
                Booking(
                    reference=reference(self.seed, surname),
                    given=rng.choice(names.GIVEN),
                    surname=surname,
                    departure=offer.departure,
                    day=day,
                    klass=klass,
                    coach=rng.choice("ABCDEFGHJ"),
                    place=rng.randint(11, 98),
                    ticket=rng.choice(self.tickets).name,
                    paid=self.fare(offer, klass),
                )
            )
        return found

    @cached_property
    def topics(self) -> list[Topic]:
        """Questions and answers."""
        rng = stream(self.seed, "help")
        desk = rng.choice(DESKS)
        forms = rng.sample(range(10, 99), len(HELP))
        found = []
        for (question, asks, answer), number in zip(HELP, forms, strict=True):
            form = f"{rng.choice('RTKPX')}{number}"
            numbers = {
                "days": rng.randint(2, 60),
                "weeks": rng.randint(2, 9),
                "minutes": rng.randrange(10, 60, 5),
                "group": self.rules["group"],
            }
            found.append(Topic(question, asks, answer.format(form=form, desk=desk, **numbers), form, desk))
        rng.shuffle(found)
        return found

    @cached_property
    def member(self) -> Member:
        """The account of a frequent traveller."""
        rng = stream(self.seed, "member")
        given, family = rng.choice(names.GIVEN), rng.choice(names.FAMILY)
        return Member(
            name=f"{given} {family}",
            email=f"{given}.{family}@mail.test".lower(),
            password=f"{rng.choice(LINE_NAMES).lower()}-{rng.randint(100, 999)}",
            number=f"{rng.randint(1000, 9999)} {rng.randint(1000, 9999)}",
            points=rng.randint(300, 9900),
            tier=rng.choice(("Bronze", "Silver", "Gold", "Platinum")),
            voucher=rng.randint(5, 60),
            expires=TODAY + timedelta(days=rng.randint(30, 400)),
        )
