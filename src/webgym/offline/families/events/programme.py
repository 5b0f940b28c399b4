"""What can be asked about the programme: an event, the best of some, a count, tickets."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline import names
from webgym.offline.families._saying import count_words, days, having, in_section, spans, sums, the, times
from webgym.offline.families.events.data import Band, Event, month_key
from webgym.offline.parts import Fact, Part

if TYPE_CHECKING:
    from webgym.offline.families.events import Events


@dataclass(frozen=True)
class Detail:
    """Something that the page of an event says.

    Attributes:
        noun: what a task calls it.
        texts: what shows it, on the page of the event.
        ways: how an answer may say it.
        section: of the page, or ``""`` if it is always visible.
        listed: whether a listing shows the last of the texts, too.
    """

    noun: str
    texts: tuple[str, ...]
    ways: tuple[str, ...]
    section: str = ""
    listed: bool = False


def details(site: Events, event: Event) -> list[Detail]:
    """What can be asked about an event."""
    start, doors = site.clock(event.start), site.clock(event.doors)
    found = [
        Detail("date", ("Date", site.spell(event.day)), days(event.day), listed=True),
        Detail("starting time", ("Starts", start), times(event.start), listed=True),
        Detail("time at which the doors open", ("Doors open", doors), times(event.doors)),
        Detail(
            "length in minutes",
            ("Length", f"{event.minutes} min"),
            (*spans(event.minutes), str(event.minutes)),
            listed=True,
        ),
        Detail("place", ("Place", event.venue.name), (event.venue.name,), listed=True),
    ]
    if event.age:
        found.append(Detail("age from which it is suitable", ("Age", f"from {event.age}"), (str(event.age),)))
    section = "" if site.prices_on_top else site.say["tickets"]
    for band in event.bands:
        noun = f"price of one ticket of the kind {band.name}"
        shown = site.money(band.cents)
        found.append(Detail(noun, (band.name, shown), sums(site, band.cents), section or "dialog"))
    return found


def titles(site: Events) -> tuple[str, ...]:
    """Titles of the sections of an event's page, in their order."""
    say = site.say
    return (say["about"], *(() if site.prices_on_top else (say["tickets"],)), say["access"], "With")


def reach(site: Events, event: Event) -> tuple[Move, ...]:
    """From the front page to the page of an event."""
    return (Fill(site.say["search"], event.title), Click(path=site.event_url(event)))


def reveal(site: Events, section: str) -> tuple[Move, ...]:
    """Make a part of an event's page visible."""
    if section == "dialog":
        return (Click(name="See all prices"),)
    return in_section(site, titles(site), section) if section else ()


def show(site: Events, chosen: list[Detail]) -> tuple[Move, ...]:
    """Look at some details; those in a dialog last, because it covers the page."""
    moves: list[Move] = []
    for section in sorted({detail.section for detail in chosen}):
        texts = tuple(text for detail in chosen if detail.section == section for text in detail.texts)
        moves += [*reveal(site, section), See(tuple(dict.fromkeys(texts)))]
    if any(detail.section == "dialog" for detail in chosen):
        moves.append(Click(name="Close"))
    return tuple(moves)


def views(site: Events, event: Event, detail: Detail) -> tuple[Evidence, ...]:
    """Where a detail of an event can be seen."""
    found = [Evidence(detail.texts, having(site.event_url(event)))]
    if detail.listed:
        found.append(Evidence((event.title, detail.texts[-1]), re.escape(site.path("/~listing"))))
    return tuple(found)


def about(site: Events, event: Event, chosen: list[Detail], which: str) -> tuple[Fact, ...]:
    """Facts about an event."""
    return tuple(
        Fact(f"The {detail.noun} of {which} is found.", views(site, event, detail), answer=detail.ways)
        for detail in chosen
    )


def said(chosen: list[Detail]) -> str:
    """The details as an answer says them."""
    return "; ".join(f"{detail.noun} {detail.texts[-1]}" for detail in chosen)


def called(event: Event) -> str:
    """How a task calls an event."""
    return f"“{event.title}”"


def ask_event(site: Events, rng: random.Random, facts: int) -> Part | None:
    """What the page of an event says."""
    event = rng.choice(site.season.events)
    chosen, which = rng.sample(details(site, event), facts), called(event)
    return Part(
        ask=f"look up the {site.kind.event} {which} and give {the([detail.noun for detail in chosen])}",
        description=f"The {site.kind.event} {which}",
        facts=about(site, event, chosen, which),
        moves=(*reach(site, event), *show(site, chosen)),
        says=f"{which}: {said(chosen)}.",
    )


def narrowing(site: Events, rng: random.Random) -> tuple[dict[str, str], str, tuple[Move, ...]]:
    """Some filters, as the address, a task and a solution have them."""
    month, month_name = rng.choice(site.months)
    kind, kind_name = rng.choice(site.categories)
    by_month = Choose(site.say["month"], month_name)
    by_kind = Choose(site.say["category"], kind_name)
    choices: tuple[tuple[dict[str, str], str, tuple[Move, ...]], ...] = (
        ({"month": month}, f" in {month_name}", (by_month,)),
        ({"category": kind}, f" in the category {kind_name}", (by_kind,)),
        (
            {"month": month, "category": kind},
            f" in the category {kind_name} in {month_name}",
            (by_month, by_kind),
        ),
    )
    return rng.choice(choices)


def ask_best(site: Events, rng: random.Random, facts: int) -> Part | None:
    """The cheapest, longest, first or last event among some."""
    query, among, moves = narrowing(site, rng)
    found = site.narrowed(query)
    rules: tuple[tuple[str, str, Callable[[Event], int]], ...] = (
        ("cheapest", "price", lambda event: event.cents),
        ("longest", "length", lambda event: -event.minutes),
        ("first", "", lambda event: event.day.toordinal()),
        ("last", "", lambda event: -event.day.toordinal()),
    )
    word, by, cost = rng.choice(rules)
    ranked = sorted(found, key=cost)
    if (
        len(found) < 3
        or cost(ranked[0]) == cost(ranked[1])
        or (word == "last" and len(found) > site.page_size)
    ):
        return None
    best, which = ranked[0], f"the {word} {site.kind.event}{among}"
    order = {"price": "by_price", "length": "by_length"}.get(by)
    sort = (Choose(site.say["sort"], site.say[order]),) if order else ()
    price = Detail("lowest price", (best.title, site.money(best.cents)), sums(site, best.cents), listed=True)
    known = {"cheapest": [price], "longest": details(site, best)[3:4], "first": [], "last": []}[word]
    others = [detail for detail in details(site, best) if detail.listed and detail not in known]
    title = Fact(
        f"The title of {which} is found.",
        (
            Evidence((best.title, site.spell(best.day)), listing(site, query)),
            Evidence((best.title, site.spell(best.day)), having(site.event_url(best))),
        ),
        answer=(best.title,),
    )
    chosen = (known + rng.sample(others, 2))[: facts - 1]
    asked = the(["title", *(detail.noun for detail in chosen)])
    shown = (best.title, site.spell(best.day), *(detail.texts[-1] for detail in chosen))
    texts = tuple(dict.fromkeys(shown))
    mean = " (the lowest price counts)" if word == "cheapest" else ""
    return Part(
        ask=f"find {which}{mean} and give {asked}",
        description=which[:1].upper() + which[1:],
        facts=(title, *about(site, best, chosen, which)),
        moves=(Click(path=site.path("/~listing")), *moves, *sort, See(texts)),
        says=f"It is {called(best)}. {said(chosen)}",
    )


def listing(site: Events, query: dict[str, str]) -> str:
    """A regular expression for the listing with some filters; a search may have led there as well."""
    return having(site.path("/~listing"), **query)


def ask_count(site: Events, rng: random.Random, facts: int) -> Part | None:
    """How many events there are among some."""
    query, among, moves = narrowing(site, rng)
    found = site.narrowed(query)
    if facts != 1 or not 2 <= len(found) < len(site.season.events):
        return None
    shown = f"{len(found)} entries"
    return Part(
        ask=f"count the {site.kind.events}{among}",
        description=f"Number of {site.kind.events}{among}",
        facts=(
            Fact(
                f"The number of {site.kind.events}{among} is found.",
                (Evidence((shown,), listing(site, query)),),
                answer=count_words(len(found)),
            ),
        ),
        moves=(Click(path=site.path("/~listing")), *moves, See((shown,))),
        says=f"There are {len(found)}.",
    )


def ask_day(site: Events, rng: random.Random, facts: int) -> Part | None:
    """What takes place on a day."""
    event = rng.choice(site.season.events)
    if len([other for other in site.season.events if other.day == event.day]) > 1 or facts > 2:
        return None
    month, when = month_key(event.day), f"on {event.day.day} {event.day:%B %Y}"
    calendar = site.path("/~calendar/{month}", month=month)
    ahead = [key for key, _ in site.months].index(month)
    months = [site.path("/~calendar/{month}", month=key) for key, _ in site.months[: ahead + 1]]
    start = next(detail for detail in details(site, event) if detail.noun == "starting time")
    chosen = [start] if facts == 2 else []
    last = (Click(path=site.event_url(event)), See(start.texts)) if chosen else ()
    title = Fact(
        f"The title of what takes place {when} is found.",
        (
            Evidence((event.title, str(event.day.day)), having(calendar)),
            Evidence((event.title, site.spell(event.day)), re.escape(site.path("/~listing"))),
            Evidence((event.title, site.spell(event.day)), having(site.event_url(event))),
        ),
        answer=(event.title,),
    )
    return Part(
        ask=f"find out what takes place {when} and give {the(['title', *(d.noun for d in chosen)])}",
        description=f"What takes place {when}",
        facts=(title, *about(site, event, chosen, f"what takes place {when}")),
        moves=(*(Click(path=path) for path in months), See((event.title,)), *last),
        says=f"It is {called(event)}. {said(chosen)}",
    )


def ask_compare(site: Events, rng: random.Random, facts: int) -> Part | None:
    """Prices of the same kind of ticket for two events, and which is cheaper."""
    one, two = rng.sample(site.season.events, 2)
    band = rng.choice(site.kind.bands)[0]
    a, b = (next(band_ for band_ in event.bands if band_.name == band) for event in (one, two))
    if a.cents == b.cents or facts != 3:
        return None
    section = "dialog" if site.prices_on_top else site.say["tickets"]
    difference = abs(a.cents - b.cents)
    rows: tuple[tuple[Event, Band], ...] = ((one, a), (two, b))
    prices = tuple(
        Fact(
            f"The price of a ticket of the kind {band} for {called(event)} is found.",
            (Evidence((band, site.money(row.cents)), having(site.event_url(event))),),
            answer=sums(site, row.cents),
        )
        for event, row in rows
    )
    both = [
        (*reach(site, event), *reveal(site, section), See((band, site.money(row.cents))))
        for event, row in rows
    ]
    return Part(
        ask=f"compare the prices of one ticket of the kind {band} for {called(one)} and {called(two)} and "
        "give both prices and the difference between them",
        description=f"{band}: {called(one)} and {called(two)}",
        facts=(
            *prices,
            Fact(
                f"The difference between the prices for {called(one)} and {called(two)} is worked out.",
                tuple(evidence for fact in prices for evidence in fact.evidence),
                answer=sums(site, difference),
            ),
        ),
        moves=(*both[0], *_home(site), *both[1], *_home(site)),
        says=f"{called(one)} costs {site.money(a.cents)}, {called(two)} {site.money(b.cents)}; "
        f"the difference is {site.money(difference)}.",
    )


def _home(site: Events) -> tuple[Move, ...]:
    """A dialog covers the header, so it is closed before the next search."""
    return (Click(name="Close"),) if site.prices_on_top else ()


def ask_total(site: Events, rng: random.Random, facts: int) -> Part | None:
    """What some tickets cost together."""
    event = rng.choice(site.season.events)
    band, count = rng.choice(event.bands), rng.randint(2, 6)
    if facts != 1:
        return None
    section = "dialog" if site.prices_on_top else site.say["tickets"]
    texts = (band.name, site.money(band.cents))
    return Part(
        ask=f"work out what {count} tickets of the kind {band.name} cost together for {called(event)}",
        description=f"Cost of {count} tickets for {called(event)}",
        facts=(
            Fact(
                f"The cost of {count} tickets of the kind {band.name} for {called(event)} is worked out.",
                (Evidence(texts, having(site.event_url(event))),),
                answer=sums(site, band.cents * count),
            ),
        ),
        moves=(*reach(site, event), *reveal(site, section), See(texts), *_home(site)),
        says=f"They cost {site.money(band.cents * count)}.",
    )


def ask_sold_out(site: Events, rng: random.Random, facts: int) -> Part | None:
    """The only event among some for which there are no tickets."""
    query, among, moves = narrowing(site, rng)
    found = site.narrowed(query)
    gone = [event for event in found if event.sold_out]
    if facts != 1 or len(gone) != 1 or not 2 <= len(found) <= site.page_size:
        return None
    event, which = gone[0], f"the only {site.kind.event}{among} that is sold out"
    return Part(
        ask=f"find {which} and give the title",
        description=which[:1].upper() + which[1:],
        facts=(
            Fact(
                f"The title of {which} is found.",
                (
                    Evidence((event.title, "Sold out"), re.escape(site.path("/~listing"))),
                    Evidence((event.title, "Sold out"), having(site.event_url(event))),
                ),
                answer=(event.title,),
            ),
        ),
        moves=(Click(path=site.path("/~listing")), *moves, See((event.title, "Sold out"))),
        says=f"It is {called(event)}.",
    )


def ask_access(site: Events, rng: random.Random, facts: int) -> Part | None:
    """Which of some offers an event has: this one OR that one."""
    event = rng.choice(site.season.events)
    item = rng.choice(event.access)
    lacking = [
        other for other in ("Captions", "Audio description", "Induction loop") if other not in event.access
    ]
    if facts != 1 or not lacking:
        return None
    other = rng.choice(lacking)
    first, second = sorted((item, other))
    return Part(
        ask=f"find out which of these two {called(event)} offers, {first} OR {second}, and name only that",
        description=f"Access to {called(event)}",
        facts=(
            Fact(
                f"It is found which one {called(event)} offers: {first} OR {second}.",
                (Evidence((item,), having(site.event_url(event))),),
                answer=(item,),
                wrong=(other,),
            ),
        ),
        moves=(*reach(site, event), *reveal(site, site.say["access"]), See((item,))),
        says=f"It offers this: {item}.",
    )


def ask_save(site: Events, rng: random.Random, facts: int) -> Part | None:
    """Save an event for later."""
    event = rng.choice(site.season.events)
    if facts != 1:
        return None
    return Part(
        ask=f"put {called(event)} on the list of saved {site.kind.events}, without buying anything",
        description=f"{called(event)} on the list",
        facts=(
            Fact(
                f"{called(event)} is saved on the visitor's list.",
                (Evidence((site.say["saved"], event.title), having(site.path("/~saved"))),),
                (StateCheck(("saved", event.title), True),),
            ),
        ),
        moves=(*reach(site, event), Click(name=site.say["save"]), See((event.title, site.spell(event.day)))),
        says=f"{called(event)} is on the list.",
    )


def ask_tickets(site: Events, rng: random.Random, facts: int) -> Part | None:
    """Buy tickets."""
    event = rng.choice(site.season.events)
    count = rng.randint(1, 5)
    bands = [band for band in event.bands if band.left >= count]
    if not bands or facts not in (4, 5):
        return None
    band = rng.choice(bands)
    given, family = rng.choice(names.GIVEN), rng.choice(names.FAMILY)
    name, email = f"{given} {family}", f"{given}.{family}@post.test".lower()
    number = site.order_number(name, {event.title: {"band": band.name, "count": count}})
    page, cost = having(site.path("/~order/{number}", number=number)), band.cents * count

    def done(
        text: str, shown: tuple[str, ...], *checks: tuple[str, object], answer: tuple[str, ...] = ()
    ) -> Fact:
        state = tuple(StateCheck(("bought", event.title, key), value) for key, value in checks)
        return Fact(text, (Evidence(shown, page),), state, answer)

    amount = f"{count} ticket" if count == 1 else f"{count} tickets"
    all_facts = (
        done(f"{amount} for {called(event)} are bought.", (event.title, str(count)), ("count", count)),
        done(f"The tickets are of the kind {band.name}.", (event.title, band.name), ("band", band.name)),
        done(
            f"The tickets go to {name} with {email}.", (number, name, email), ("name", name), ("email", email)
        ),
        done("The order number is reported.", (number,), answer=(number,)),
        done("The price paid is reported.", (number, site.money(cost)), answer=sums(site, cost)),
    )
    buyer = (Fill(site.say["name"], name), Fill(site.say["email"], email))
    add = (Click(name=site.say["add"]),) if site.has_basket else ()
    wanted = "the order number and the price paid" if facts == 5 else "the order number"
    how_many = (Choose(site.say["count"], str(count)),) if count > 1 else ()
    return Part(
        ask=f"buy {amount} of the kind {band.name} for {called(event)} in the name of {name} with the e-mail "
        f"address {email} and give {wanted}",
        description=f"Tickets for {called(event)}",
        facts=all_facts[:facts],
        moves=(
            *reach(site, event),
            Choose(site.say["band"], site.band_text(band)),
            *how_many,
            *add,
            *buyer,
            See((number, event.title, band.name, site.money(cost), email)),
        ),
        says=f"The order number is {number}; {site.money(cost)} was paid.",
    )
