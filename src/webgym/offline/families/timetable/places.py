"""What can be asked about stops, lines, conditions, help and disruptions."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Move, See
from webgym.offline.engine.saying import (
    count_words,
    days,
    further,
    having,
    in_section,
    listed,
    spans,
    sums,
    the,
    times,
)
from webgym.offline.parts import Fact, Part
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.timetable import Timetable
    from webgym.offline.families.timetable.data import Disruption
    from webgym.offline.families.timetable.network import Line


# --- stops and lines --------------------------------------------------------------------------------


def ask_stop(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """What the page of a stop says."""
    stop = rng.choice(site.network.stops)
    there = having(site.path("/~stops/{name}", name=stop.slug))
    titles = ("Opening hours", "Facilities here", "Getting here")
    hours = rng.choice([hours for hours in stop.hours if not hours.closed])
    shown = f"{site.clock(hours.opens)} to {site.clock(hours.closes)}"
    when = "on weekdays" if hours.days.startswith("Monday") else f"on {hours.days}s"
    choices: list[tuple[str, str, tuple[str, ...], tuple[str, ...]]] = [
        ("telephone number", titles[2], ("Telephone", stop.phone), (stop.phone, stop.phone.replace(" ", ""))),
        ("number of parking places", titles[2], ("Parking places", str(stop.parking)), (str(stop.parking),)),
        ("street address", titles[2], ("Address", stop.address), (stop.address,)),
        ("year of opening", titles[2], ("Opened in", str(stop.opened)), (str(stop.opened),)),
        (f"closing time {when}", titles[0], (hours.days, shown), times(hours.closes)),
        (f"opening time {when}", titles[0], (hours.days, shown), times(hours.opens)),
    ]
    chosen = rng.sample(choices, facts)
    moves: list[Move] = [Click(path=site.path("/~stops")), *reach(site, stop.slug)]
    for title in sorted({row[1] for row in chosen}, key=titles.index):
        texts = tuple(dict.fromkeys(text for row in chosen if row[1] == title for text in row[2]))
        moves += [*in_section(site, titles, title), See(texts)]
    return Part(
        ask=f"open the page of the {site.mode.stop} {stop.name} and give {the([row[0] for row in chosen])}",
        description=f"The {site.mode.stop} {stop.name}",
        facts=tuple(
            Fact(text=f"The {noun} of {stop.name} is found.", evidence=(Evidence(texts, there),), answer=ways)
            for noun, _, texts, ways in chosen
        ),
        moves=tuple(moves),
        says=f"{stop.name}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, _, ways in chosen) + ".",
    )


def reach(site: Timetable, name: str) -> tuple[Move, ...]:
    """From the list of stops to one of them, through pages of the list where there are some."""
    place = [stop.slug for stop in site.network.stops].index(name)
    return (*further(site, place // site.page_size), Click(path=site.path("/~stops/{name}", name=name)))


def ask_facilities(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """The one stop that has two things."""
    stops = site.network.stops
    pairs = [
        (pair, found[0])
        for pair in combinations(site.mode.facilities, 2)
        if len(found := [stop for stop in stops if set(pair) <= set(stop.facilities)]) == 1
    ]
    if facts != 1 or not pairs:
        return None
    (one, two), stop = rng.choice(pairs)
    filtered = having(site.path("/~stops"), **{slug(one): 1, slug(two): 1})
    return Part(
        ask=f"find the only {site.mode.stop} that has both of these facilities: {one} and {two}",
        description=f"The {site.mode.stop} with {one} and {two}",
        facts=(
            Fact(
                text=f"The {site.mode.stop} that has both {one} and {two} is found.",
                evidence=(
                    Evidence((stop.name,), filtered),
                    Evidence((one, two), having(site.path("/~stops/{name}", name=stop.slug))),
                ),
                answer=(stop.name,),
                wrong=tuple(other.name for other in stops if other != stop and other.name not in stop.name)[
                    :3
                ],
            ),
        ),
        moves=(Click(path=site.path("/~stops")), Click(name=one), Click(name=two), See((stop.name,))),
        says=f"It is {stop.name}.",
    )


def ask_facility_count(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """How many stops have something."""
    item = rng.choice(site.mode.facilities)
    count = sum(item in stop.facilities for stop in site.network.stops)
    if facts != 1 or not 2 <= count < len(site.network.stops):
        return None
    shown = f"{count} {site.mode.stops}"
    return Part(
        ask=f"find out how many {site.mode.stops} have this facility: {item}",
        description=f"Number of {site.mode.stops} with {item}",
        facts=(
            Fact(
                text=f"The number of {site.mode.stops} that have {item} is found.",
                evidence=(Evidence((shown,), having(site.path("/~stops"), **{slug(item): 1})),),
                answer=count_words(count),
            ),
        ),
        moves=(Click(path=site.path("/~stops")), Click(name=item), See((shown,))),
        says=f"{count} {site.mode.stops} have it.",
    )


def ask_line(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """What the page of a line says."""
    line = rng.choice(site.network.lines)
    there = having(site.path("/~lines/{name}", name=line.slug))
    overview = having(site.path("/~lines"))
    last = line.stops[-1]
    choices: list[tuple[str, tuple[Evidence, ...], tuple[str, ...]]] = [
        (
            "first departure",
            (Evidence(("First departure", site.clock(line.first)), there),),
            times(line.first),
        ),
        ("last departure", (Evidence(("Last departure", site.clock(line.last)), there),), times(line.last)),
        (
            "length in kilometres",
            (Evidence(("Length", f"{line.km} km"), there), Evidence((line.name, f"{line.km} km"), overview)),
            (f"{line.km} km", str(line.km)),
        ),
        (
            f"distance between {line.stops[0].name} and {line.stops[-2].name}",
            (Evidence((line.stops[-2].name, f"{line.at[-2] - line.at[0]} km"), there),),
            (f"{line.at[-2] - line.at[0]} km", str(line.at[-2] - line.at[0])),
        ),
    ]
    chosen = rng.sample(choices, facts)
    moves: list[Move] = [
        Click(path=site.path("/~lines")),
        Click(path=site.path("/~lines/{name}", name=line.slug)),
    ]
    moves += [
        See(evidence[0].texts) for _, evidence, _ in sorted(chosen, key=lambda row: row[0].startswith("dist"))
    ]
    return Part(
        ask=f"open the page of the {line.name} (the one that ends in {last.name}) and give "
        f"{the([noun for noun, *_ in chosen])}",
        description=f"The {line.name}",
        facts=tuple(
            Fact(text=f"The {noun} of the {line.name} is found.", evidence=evidence, answer=ways)
            for noun, evidence, ways in chosen
        ),
        moves=tuple(moves),
        says=f"{line.name}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen) + ".",
    )


def ask_which_line(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """The longest line, the busiest, or the only one for which this or that holds."""
    lines = site.network.lines
    long, often = rng.choice(lines).km, rng.choice(lines).every
    tests: list[tuple[str, list[Line]]] = [
        ("the longest", [line for line in lines if line.km == max(other.km for other in lines)]),
        ("the shortest", [line for line in lines if line.km == min(other.km for other in lines)]),
        ("the most frequent", [line for line in lines if line.every == min(other.every for other in lines)]),
        (
            f"the only one that is longer than {long} km OR runs more often than every {often} minutes",
            [line for line in lines if line.km > long or line.every < often],
        ),
    ]
    what, found = rng.choice(tests)
    if facts != 1 or len(found) != 1:
        return None
    line = found[0]
    shown = tuple(other.name for other in lines)
    return Part(
        ask=f"compare all lines of the network and name {what}",
        description=f"The line that is {what}",
        facts=(
            Fact(
                text=f"The line that is {what} is found.",
                evidence=(Evidence(shown, having(site.path("/~lines"))),),
                answer=(line.name, line.name.split()[0]),
            ),
        ),
        moves=(Click(path=site.path("/~lines")), See(shown)),
        says=f"It is the {line.name}.",
    )


# --- conditions, help and disruptions -----------------------------------------------------------------


def ask_ticket(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """What a kind of ticket allows."""
    ticket = rng.choice(site.network.tickets)
    there = having(site.path("/~fares"))
    choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        ("validity", (ticket.name, ticket.valid), (ticket.valid,)),
        ("refund rule", (ticket.name, ticket.refund), (ticket.refund,)),
    ]
    if ticket.change_fee:
        fee = ticket.change_fee * 100
        choices.append(("fee for changes", (ticket.name, site.money(fee)), sums(site, fee)))
    if ticket.surcharge:
        shown = f"+{ticket.surcharge} %"
        choices.append(
            (
                "extra cost in per cent",
                (ticket.name, shown),
                (shown, f"{ticket.surcharge} %", str(ticket.surcharge)),
            )
        )
    if facts > len(choices):
        return None
    chosen = rng.sample(choices, facts)
    seen = tuple(dict.fromkeys(text for _, texts, _ in chosen for text in texts))
    return Part(
        ask=f"look up the conditions of the ticket called {ticket.name} and give "
        f"{the([noun for noun, *_ in chosen])}, in the words of the website",
        description=f"Conditions of the {ticket.name} ticket",
        facts=tuple(
            Fact(
                text=f"The {noun} of the {ticket.name} ticket is found.",
                evidence=(Evidence(texts, there),),
                answer=ways,
            )
            for noun, texts, ways in chosen
        ),
        moves=(Click(path=site.path("/~fares")), See(seen)),
        says=f"{ticket.name}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen) + ".",
    )


def ask_rules(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Luggage, children, groups, bicycles and pets."""
    rules, say = site.network.rules, site.say
    titles = tuple(say[key] for key in ("types", "luggage", "children", "animals"))
    bike, dog, heavy = (rules[key] * 100 for key in ("bike", "dog", "oversize"))
    kilos, share, young, group = (rules[key] for key in ("kilos", "group_off", "free_age", "group"))
    choices: list[tuple[int, str, tuple[str, ...], tuple[str, ...]]] = [
        (
            1,
            "greatest weight of a free piece",
            (f"up to {kilos} kg",),
            (f"{kilos} kg", str(kilos)),
        ),
        (1, "price of a heavier piece", (f"heavier costs {site.money(heavy)}",), sums(site, heavy)),
        (2, "age under which children travel free", (f"Children under {young}",), count_words(young)),
        (2, "discount for groups in per cent", (f"get {share} %",), (f"{share} %", str(share))),
        (2, "smallest group that gets a discount", (f"Groups of {group} or more",), count_words(group)),
        (
            3,
            "price for a bicycle and a dog together",
            (f"bicycle costs {site.money(bike)}", f"Dogs pay {site.money(dog)}"),
            sums(site, bike + dog),
        ),
        (3, "price for a bicycle", (f"bicycle costs {site.money(bike)}",), sums(site, bike)),
    ]
    tab = rng.choice((1, 2, 3))
    mine = [row for row in choices if row[0] == tab]
    if facts > len(mine):
        return None
    chosen, there = rng.sample(mine, facts), having(site.path("/~fares"))
    seen = tuple(dict.fromkeys(text for row in chosen for text in row[2]))
    return Part(
        ask=f"look up in the conditions of carriage {the([row[1] for row in chosen])}",
        description=f"Conditions of carriage: {titles[tab].lower()}",
        facts=tuple(
            Fact(text=f"The {noun} is found.", evidence=(Evidence(texts, there),), answer=ways)
            for _, noun, texts, ways in chosen
        ),
        moves=(Click(path=site.path("/~fares")), *in_section(site, titles, titles[tab]), See(seen)),
        says="; ".join(f"{noun}: {ways[0]}" for _, noun, _, ways in chosen) + ".",
    )


def ask_help(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """How something is done."""
    topic = rng.choice(site.network.topics)
    if facts != 1:
        return None
    return Part(
        ask=f"find out how to {topic.asks}, naming the form that is needed",
        description=f"How to {topic.asks}",
        facts=(
            Fact(
                text=f"Instructions on how to {topic.asks}, with the form that is needed, are found.",
                evidence=(Evidence((f"form {topic.form}",), having(site.path("/~help"))),),
                answer=(f"form {topic.form}", topic.form),
                wrong=tuple(other.form for other in site.network.topics if other != topic)[:3],
            ),
        ),
        moves=(Click(path=site.path("/~help")), Click(name=topic.question), See((f"form {topic.form}",))),
        says=topic.answer,
    )


def ask_disruption(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Until when something lasts, and what it does."""
    items: Sequence[Disruption] = site.network.disruptions
    item = rng.choice(items)
    title = f"{item.cause}: {item.line.name}"
    twin = [other for other in items if other.line == item.line]
    shown, delay = f"{item.ends.day} {item.ends:%b %Y}", f"up to {item.delay} minutes"
    there = re.escape(site.path("/~status"))
    choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        ("its last day", (title, shown), days(item.ends)),
        ("its first day", (title, f"{item.starts.day} {item.starts:%b %Y}"), days(item.starts)),
        (
            "the greatest delay it causes",
            (title, delay),
            (f"{item.delay} minutes", *spans(item.delay), str(item.delay)),
        ),
    ]
    chosen = rng.sample(choices, facts)
    narrow = (Choose(f"Affected {site.mode.line.lower()}", item.line.name),) if len(twin) < len(items) else ()
    seen = tuple(dict.fromkeys(text for _, texts, _ in chosen for text in texts))
    if len(twin) > 5:
        return None
    return Part(
        ask=f"find the notice about {item.cause.lower()} on the {item.line.name} and give "
        f"{listed([noun for noun, *_ in chosen])}",
        description=f"{item.cause} on the {item.line.name}",
        facts=tuple(
            Fact(
                text=f"For the {item.cause.lower()} on the {item.line.name}, {noun} is found.",
                evidence=(Evidence(texts, there),),
                answer=ways,
            )
            for noun, texts, ways in chosen
        ),
        moves=(Click(path=site.path("/~status")), *narrow, See(seen)),
        says=f"{title}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen) + ".",
    )


def ask_notices(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """How many notices there are of one kind."""
    counts = Counter(item.status for item in site.network.disruptions)
    status = rng.choice(("Active", "Planned", "Resolved"))
    count = counts[status]
    if facts != 1 or count < 2:
        return None
    shown = f"{count} notices"
    return Part(
        ask=f"find out how many {status.lower()} disruptions there are",
        description=f"Number of {status.lower()} disruptions",
        facts=(
            Fact(
                text=f"The number of {status.lower()} disruptions is found.",
                evidence=(Evidence((shown,), having(site.path("/~status"), state=status.lower())),),
                answer=count_words(count),
            ),
        ),
        moves=(Click(path=site.path("/~status")), Choose("State", status), See((shown,))),
        says=f"There are {count} {status.lower()} disruptions.",
    )
