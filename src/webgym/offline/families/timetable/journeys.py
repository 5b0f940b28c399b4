"""What can be asked about journeys: the best departure, one departure's details, a booking."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline import names
from webgym.offline.engine.saying import count_words, first_up, having, spans, sums, the, times
from webgym.offline.families.timetable.network import Departure, Offer, Stop, days_on_sale, spell
from webgym.offline.parts import Fact, Part
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.timetable import Timetable


@dataclass(frozen=True)
class Query:
    """A journey search."""

    origin: Stop
    target: Stop
    day: date
    people: int = 1

    def __str__(self) -> str:
        return f"from {self.origin.name} to {self.target.name} on {spell(self.day)}"


def search(site: Timetable, query: Query) -> tuple[Move, ...]:
    """From the front page to the results."""
    day: tuple[Move, ...] = ()
    if query.day != days_on_sale()[0]:
        day = (Choose(site.say["date"], spell(query.day)),)
    if query.people > 1:
        day += (Choose(site.say["people"], str(query.people)),)
    if site.typed:
        return (*day, Fill(site.say["from"], query.origin.name), Fill(site.say["to"], query.target.name))
    chosen = (Choose(site.say["from"], query.origin.name), Choose(site.say["to"], query.target.name))
    return (*chosen, *day, Click(name=site.say["search"], role="button"))


def results(site: Timetable, query: Query, *, people: bool = False, **more: object) -> str:
    """A regular expression for the results of a search."""
    asked = {"from": query.origin.slug, "to": query.target.slug, "date": query.day.isoformat()}
    if people:
        asked["people"] = str(query.people)
    return having(site.path("/~search"), **asked, **more)


def on_trip(site: Timetable, offer: Offer, people: int | None = None) -> str:
    """A regular expression for the page of a departure; ``people`` matters for prices alone."""
    path = re.escape(site.trip_url(offer.departure, offer.day))
    if people is None:
        return path + r"(?:\?|$)"
    return path + (r"(?:\?people=1)?$" if people == 1 else rf"\?people={people}$")


@dataclass(frozen=True)
class Attribute:
    """Something to be told about a departure: its name, how it is shown, and how an answer may say it."""

    noun: str
    shown: Callable[[Timetable, Offer], str]
    ways: Callable[[Timetable, Offer], tuple[str, ...]]
    priced: bool = False


def _arrival(departure: Departure) -> int:
    return departure.minute + departure.length


ATTRIBUTES: dict[str, Attribute] = {
    "departs": Attribute(
        "departure time",
        lambda site, offer: site.clock(offer.departure.minute),
        lambda _, offer: times(offer.departure.minute),
    ),
    "arrives": Attribute(
        "arrival time",
        lambda site, offer: site.arrival(offer.departure),
        lambda _, offer: times(_arrival(offer.departure)),
    ),
    "length": Attribute(
        "journey time",
        lambda site, offer: site.span(offer.departure.length),
        lambda _, offer: spans(offer.departure.length),
    ),
    "price": Attribute(
        "price for one passenger",
        lambda site, offer: site.money(offer.cents),
        lambda site, offer: sums(site, offer.cents),
        priced=True,
    ),
    "code": Attribute(
        "service number",
        lambda _, offer: offer.departure.code,
        lambda _, offer: (offer.departure.code, offer.departure.code.replace(" ", "")),
    ),
}
SETS = (
    ("price",),
    ("departs",),
    ("departs", "price"),
    ("code", "length"),
    ("departs", "arrives"),
    ("departs", "length", "price"),
    ("code", "departs", "price"),
    ("departs", "arrives", "price"),
)


def told(site: Timetable, query: Query, offer: Offer, which: str, keys: Sequence[str]) -> tuple[Fact, ...]:
    """Facts about a departure that was found among the results."""
    code, facts = offer.departure.code, []
    for key in keys:
        attribute = ATTRIBUTES[key]
        texts = tuple(dict.fromkeys((code, attribute.shown(site, offer))))
        there = results(site, query, people=attribute.priced)
        trip = on_trip(site, offer, 1 if attribute.priced else None)
        facts.append(
            Fact(
                text=f"The {attribute.noun} of {which} {query} is found.",
                evidence=(Evidence(texts, there), Evidence(texts, trip)),
                answer=attribute.ways(site, offer),
            )
        )
    return tuple(facts)


def ask_best(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """The cheapest or fastest departure, perhaps among some only."""
    query = some_query(site, rng)
    offers = site.network.offers(query.origin, query.target, query.day)
    by, word = rng.choice((("price", "cheapest"), ("length", "fastest")))
    limit, kept = rng.choice(("", "", "direct", "morning", "afternoon", "evening")), offers
    moves: tuple[Move, ...] = ()
    if limit == "direct":
        kept = [offer for offer in offers if offer.departure.change is None]
        moves = (Click(name=site.say["direct"]),)
    elif limit:
        earliest, latest = site.periods[limit]
        kept = [offer for offer in offers if earliest <= offer.departure.minute < latest]
        moves = (Choose(site.say["period"], limit.capitalize()),)

    def cost(offer: Offer) -> int:
        return offer.cents if by == "price" else offer.departure.length

    ranked = sorted(kept, key=cost)
    if len(ranked) < 3 or (limit and len(kept) == len(offers)) or cost(ranked[0]) == cost(ranked[1]):
        return None
    best, keys = ranked[0], rng.choice([keys for keys in SETS if len(keys) == facts])
    among = {"": "", "direct": " direct"}.get(limit, f" {limit}")
    which = f"the {word}{among} {site.mode.vehicle}"
    moves += (Choose(site.say["sort"], site.say[f"by_{by}"]),)
    shown = [ATTRIBUTES[key].shown(site, best) for key in keys]
    nouns = [ATTRIBUTES[key].noun for key in keys]
    return Part(
        ask=f"find {which} {query} and give {the(nouns)}" + _meaning(limit),
        description=f"{first_up(which)} {query}",
        facts=told(site, query, best, which, keys),
        moves=(*search(site, query), *moves, See(tuple(dict.fromkeys((best.departure.code, *shown))))),
        says=f"For {which} {query}: "
        + ", ".join(f"{noun} {text}" for noun, text in zip(nouns, shown, strict=True))
        + ".",
    )


def _meaning(limit: str) -> str:
    return {
        "morning": " (morning means leaving before noon)",
        "afternoon": " (afternoon means leaving from noon to before 6 pm)",
        "evening": " (evening means leaving at 6 pm or later)",
    }.get(limit, "")


def ask_arriving(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """The last departure that arrives in time."""
    query = some_query(site, rng)
    offers = site.network.offers(query.origin, query.target, query.day)
    limit = rng.choice([int(value) for value, _ in site.limits if value])
    kept = [offer for offer in offers if _arrival(offer.departure) <= limit * 60]
    overnight = any(_arrival(offer.departure) >= 24 * 60 for offer in offers)
    if not 2 <= len(kept) <= site.page_size or len(kept) == len(offers) or overnight:
        return None
    best = kept[-1]
    if _arrival(best.departure) == limit * 60:
        return None
    keys = rng.choice([keys for keys in SETS if len(keys) == facts and keys != ("price",)])
    which = f"the last {site.mode.vehicle} that arrives before {site.clock(limit * 60)}"
    shown = [ATTRIBUTES[key].shown(site, best) for key in keys]
    nouns = [ATTRIBUTES[key].noun for key in keys]
    moves = (Choose(site.say["arrive"], site.clock(limit * 60)),)
    return Part(
        ask=f"find {which} {query} and give {the(nouns)}",
        description=f"{first_up(which)} {query}",
        facts=told(site, query, best, which, keys),
        moves=(*search(site, query), *moves, See(tuple(dict.fromkeys((best.departure.code, *shown))))),
        says=f"The last one in time: {', '.join(map(' '.join, zip(nouns, shown, strict=True)))}.",
    )


def ask_count(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """How many direct departures there are on a day."""
    query = some_query(site, rng)
    offers = site.network.offers(query.origin, query.target, query.day)
    direct = [offer for offer in offers if offer.departure.change is None]
    if facts != 1 or not 2 <= len(direct) < len(offers):
        return None
    found = f"{len(direct)} departures found"
    codes = tuple(offer.departure.code for offer in direct)
    views = [Evidence((found,), results(site, query, direct=1))]
    if len(offers) <= site.page_size:
        views.append(Evidence((f"{len(offers)} departures found", *codes), results(site, query)))
    return Part(
        ask=f"count the direct departures {query}",
        description=f"Number of direct departures {query}",
        facts=(
            Fact(
                text=f"The number of direct departures {query} is found.",
                evidence=tuple(views),
                answer=count_words(len(direct)),
            ),
        ),
        moves=(*search(site, query), Click(name=site.say["direct"]), See((found,))),
        says=f"There are {len(direct)} direct departures.",
    )


def some_query(site: Timetable, rng: random.Random) -> Query:
    """A search, for tomorrow more often than not."""
    origin, target = rng.choice(site.network.pairs())
    days = days_on_sale()
    return Query(origin, target, days[0] if rng.random() < 0.45 else rng.choice(days[1:]))


def some_trip(site: Timetable, rng: random.Random) -> tuple[Query, Offer]:
    """A search, and a departure on the first page of its results."""
    query = some_query(site, rng)
    offers = site.network.offers(query.origin, query.target, query.day)
    return query, rng.choice(offers[: site.page_size])


def called(site: Timetable, query: Query, offer: Offer) -> str:
    """How a task calls a departure."""
    return f"the {site.clock(offer.departure.minute)} {site.mode.vehicle} {query}"


def ask_trip(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """What the page of a departure says."""
    query, offer = some_trip(site, rng)
    trip, which = offer.departure, called(site, query, offer)
    there = on_trip(site, offer)
    dearest = site.mode.classes[-1][0]
    fare = site.network.fare(offer, dearest)
    bay = site.mode.bay
    choices: list[tuple[str, Evidence, tuple[str, ...], str]] = [
        (
            f"{bay.lower()}",
            Evidence((trip.code, bay, str(trip.bay)), there),
            (str(trip.bay),),
            f"{bay} {trip.bay}",
        ),
        (
            f"price in {dearest} for one passenger",
            Evidence((dearest, site.money(fare)), on_trip(site, offer, 1)),
            sums(site, fare),
            f"{dearest} {site.money(fare)}",
        ),
        (
            "arrival time",
            Evidence((trip.code, site.arrival(trip)), there),
            times(_arrival(trip)),
            f"arrives {site.arrival(trip)}",
        ),
    ]
    rng.shuffle(choices)
    chosen = choices[:facts]
    seen = tuple(dict.fromkeys(text for _, evidence, _, _ in chosen for text in evidence.texts))
    return Part(
        ask=f"look up {which} and give {the([noun for noun, *_ in chosen])}",
        description=f"Details of {which}",
        facts=tuple(
            Fact(text=f"The {noun} of {which} is found.", evidence=(evidence,), answer=ways)
            for noun, evidence, ways, _ in chosen
        ),
        moves=(*search(site, query), Click(path=site.trip_url(trip, offer.day)), See(seen)),
        says=f"{first_up(which)}: {', '.join(text for *_, text in chosen)}.",
    )


def ask_difference(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """How much more a better class costs."""
    query, offer = some_trip(site, rng)
    low, high = site.mode.classes[0][0], rng.choice(site.mode.classes[1:])[0]
    cheap, dear = site.network.fare(offer, low), site.network.fare(offer, high)
    which = called(site, query, offer)
    if facts != 1:
        return None
    texts = (low, site.money(cheap), high, site.money(dear))
    return Part(
        ask=f"work out how much more {high} costs than {low} for one passenger on {which}",
        description=f"Difference between two classes on {which}",
        facts=(
            Fact(
                text=f"The difference between the fares for {high} and {low} on {which} is worked out.",
                evidence=(Evidence(texts, on_trip(site, offer, 1)),),
                answer=sums(site, dear - cheap),
            ),
        ),
        moves=(*search(site, query), Click(path=site.trip_url(offer.departure, offer.day)), See(texts)),
        says=f"{high} costs {site.money(dear - cheap)} more.",
    )


def ask_party(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """What several travellers pay together."""
    query, offer = some_trip(site, rng)
    people = rng.randint(2, 5)
    klass = rng.choice(site.mode.classes)[0]
    if facts != 1:
        return None
    one, all_together = (site.network.fare(offer, klass) * n for n in (1, people))
    which = called(site, query, offer)
    query = Query(query.origin, query.target, query.day, people)
    return Part(
        ask=f"find the total fare for {people} passengers in {klass} on {which}",
        description=f"Fare for {people} passengers on {which}",
        facts=(
            Fact(
                text=f"The total fare for {people} passengers in {klass} on {which} is found.",
                evidence=(
                    Evidence((klass, site.money(all_together)), on_trip(site, offer, people)),
                    Evidence((klass, site.money(one)), on_trip(site, offer, 1)),
                ),
                answer=sums(site, all_together),
            ),
        ),
        moves=(
            *search(site, query),
            Click(path=site.trip_url(offer.departure, offer.day, people)),
            See((klass, site.money(all_together))),
        ),
        says=f"{people} passengers pay {site.money(all_together)}.",
    )


def ask_booking(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Book a departure."""
    query, offer = some_trip(site, rng)
    trip, klass, seat = offer.departure, rng.choice(site.mode.classes)[0], rng.choice(site.mode.seats)
    given, family = rng.choice(names.GIVEN), rng.choice(names.FAMILY)
    name, email = f"{given} {family}", f"{given}.{family}@post.test".lower()
    number, day = site.reference(offer, klass, 1, name), query.day.isoformat()
    key, page = ("booked", f"{trip.code} {day}"), having(site.path("/~booked/{number}", number=number))
    which = called(site, query, offer)

    def done(
        text: str, shown: tuple[str, ...], *checks: tuple[str, object], answer: tuple[str, ...] = ()
    ) -> Fact:
        state = tuple(StateCheck((*key, field), value) for field, value in checks)
        return Fact(text=text, evidence=(Evidence(shown, page),), state=state, answer=answer)

    all_facts = (
        done(f"A booking for one passenger on {which} is made.", (number, trip.code), ("people", 1)),
        done(f"The booking is in {klass}.", (number, klass), ("class", klass)),
        done(f"The booking is for {name} with {email}.", (number, email), ("name", name), ("email", email)),
        done("The booking reference is reported.", (number,), answer=(number,)),
        done(f"The seat preference is {seat}.", (number, seat), ("seat", seat)),
    )
    if not 4 <= facts <= 5:
        return None
    seated = f", seat preference {seat}," if facts == 5 else ","
    return Part(
        ask=f"book {which} in {klass}{seated} for one passenger named {name} with the e-mail address {email} "
        "and give the booking reference",
        description=f"Booking of {which}",
        facts=all_facts[:facts],
        moves=(
            *search(site, query),
            Click(path=site.trip_url(trip, offer.day)),
            Click(path=site.path("/~book/{code}/{day}/{klass}", code=trip.slug, day=day, klass=slug(klass))),
            Choose(site.say["seat"], seat),
            Click(name=site.say["terms"]),
            Fill(site.say["name"], name),
            Fill(site.say["email"], email),
            See((number, trip.code, klass, seat)),
        ),
        says=f"The booking reference is {number}.",
    )
