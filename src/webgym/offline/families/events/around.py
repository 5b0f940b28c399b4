"""What can be asked about venues, people, results, conditions and the newsletter."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline import names
from webgym.offline.families._saying import (
    count_words,
    days,
    further,
    having,
    in_section,
    sums,
    the,
    times,
)
from webgym.offline.families.events.data import Past, Venue
from webgym.offline.parts import Fact, Part

if TYPE_CHECKING:
    from webgym.offline.families.events import Events

VENUE_SECTIONS = ("The place", "How to get here", "Box office")


def thousands(count: int) -> tuple[str, ...]:
    """Ways to write a large number."""
    return tuple(dict.fromkeys((f"{count:,}", str(count))))


def ask_venue(site: Events, rng: random.Random, facts: int) -> Part | None:
    """What the page of a venue says."""
    venue = rng.choice(site.season.venues)
    there = having(site.path("/~venues/{name}", name=venue.slug))
    opens, closes = venue.box_office
    choices: list[tuple[str, int, tuple[str, ...], tuple[str, ...]]] = [
        ("address", 0, ("Address", venue.address), (venue.address,)),
        ("number of seats", 0, ("Seats", f"{venue.seats:,}"), thousands(venue.seats)),
        ("year of opening", 0, ("Opened in", str(venue.opened)), (str(venue.opened),)),
        ("nearest stop", 1, ("Nearest stop", venue.stop), (venue.stop,)),
        (
            "number of wheelchair places",
            1,
            ("Wheelchair places", str(venue.wheelchair)),
            (str(venue.wheelchair),),
        ),
        ("number of parking places", 1, ("Parking places", str(venue.parking)), (str(venue.parking),)),
        ("opening time of the box office", 2, ("Box office opens", site.clock(opens)), times(opens)),
        ("closing time of the box office", 2, ("Box office closes", site.clock(closes)), times(closes)),
        ("telephone number", 2, ("Telephone", venue.phone), (venue.phone, venue.phone.replace(" ", ""))),
    ]
    chosen = rng.sample(choices, facts)
    moves: list[Move] = [
        Click(path=site.path("/~venues")),
        Click(path=site.path("/~venues/{name}", name=venue.slug)),
    ]
    for at in sorted({row[1] for row in chosen}):
        texts = tuple(dict.fromkeys(text for row in chosen if row[1] == at for text in row[2]))
        moves += [*in_section(site, VENUE_SECTIONS, VENUE_SECTIONS[at]), See(texts)]
    return Part(
        ask=f"open the page of the venue {venue.name} and give {the([row[0] for row in chosen])}",
        description=f"The venue {venue.name}",
        facts=tuple(
            Fact(f"The {noun} of {venue.name} is found.", (Evidence(texts, there),), answer=ways)
            for noun, _, texts, ways in chosen
        ),
        moves=tuple(moves),
        says=f"{venue.name}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, _, ways in chosen) + ".",
    )


def ask_which_venue(site: Events, rng: random.Random, facts: int) -> Part | None:
    """The largest venue, the oldest, or the only one for which this or that holds."""
    venues = site.season.venues
    seats, year = rng.choice(venues).seats, rng.choice(venues).opened
    tests: list[tuple[str, list[Venue]]] = [
        ("with the most seats", [v for v in venues if v.seats == max(other.seats for other in venues)]),
        ("with the fewest seats", [v for v in venues if v.seats == min(other.seats for other in venues)]),
        ("that opened first", [v for v in venues if v.opened == min(other.opened for other in venues)]),
        (
            f"that, as the only one, has more than {seats:,} seats OR opened before {year}",
            [v for v in venues if v.seats > seats or v.opened < year],
        ),
    ]
    what, found = rng.choice(tests)
    if facts != 1 or len(found) != 1:
        return None
    shown = tuple(venue.name for venue in venues)
    return Part(
        ask=f"compare all venues and name the one {what}",
        description=f"The venue {what}",
        facts=(
            Fact(
                f"The venue {what} is found.",
                (
                    Evidence(shown, having(site.path("/~venues"))),
                    Evidence(
                        (found[0].name, f"{found[0].seats:,}"),
                        having(site.path("/~venues/{name}", name=found[0].slug)),
                    ),
                ),
                answer=(found[0].name,),
            ),
        ),
        moves=(Click(path=site.path("/~venues")), See(shown)),
        says=f"It is {found[0].name}.",
    )


def ask_person(site: Events, rng: random.Random, facts: int) -> Part | None:
    """What the page of somebody says."""
    people = site.season.people
    person = rng.choice(people)
    there = having(site.path("/~people/{name}", name=person.slug))
    coming = site.season.with_person(person)
    since = "Founded in" if site.kind.league else "Born in"
    choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        ("home town", ("Home town", person.home), (person.home,)),
        (f"entry for “{site.kind.role[0]}”", (site.kind.role[0], person.role), (person.role,)),
        (
            "year of foundation" if site.kind.league else "year of birth",
            (since, str(person.since)),
            (str(person.since),),
        ),
    ]
    if coming and (len(coming) == 1 or coming[0].day != coming[1].day):
        first = coming[0]
        choices.append(("date of the next appearance", (site.spell(first.day), first.title), days(first.day)))
    chosen = rng.sample(choices, facts)
    place = people.index(person)
    seen = tuple(dict.fromkeys(text for _, texts, _ in chosen for text in texts))
    return Part(
        ask=f"open the page of the {site.kind.person} {person.name} and give "
        f"{the([noun for noun, *_ in chosen])}",
        description=f"{person.name}",
        facts=tuple(
            Fact(f"The {noun} of {person.name} is found.", (Evidence(texts, there),), answer=ways)
            for noun, texts, ways in chosen
        ),
        moves=(
            Click(path=site.path("/~people")),
            *further(site, place // site.page_size),
            Click(path=site.path("/~people/{name}", name=person.slug)),
            See(seen),
        ),
        says=f"{person.name}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen) + ".",
    )


def ask_role_count(site: Events, rng: random.Random, facts: int) -> Part | None:
    """How many people have something in common."""
    value, role = rng.choice(site.role_options)
    count = sum(person.role == role for person in site.season.people)
    if facts != 1 or not 2 <= count < len(site.season.people):
        return None
    shown = f"{count} found"
    what = f"{site.kind.people} for whom the website gives {role} under “{site.kind.role[0]}”"
    return Part(
        ask=f"count those among the {what}",
        description=f"Number of {what}",
        facts=(
            Fact(
                f"The number of {what} is found.",
                (Evidence((shown,), having(site.path("/~people"), role=value)),),
                answer=count_words(count),
            ),
        ),
        moves=(Click(path=site.path("/~people")), Choose(site.kind.role[0], role), See((shown,))),
        says=f"There are {count}.",
    )


def ask_past(site: Events, rng: random.Random, facts: int) -> Part | None:
    """What drew the most visitors in a season."""
    season = str(rng.choice(site.seasons))
    ranked = sorted(site.past_of(season), key=lambda past: -past.visitors)
    if ranked[0].visitors == ranked[1].visitors:
        return None
    best = ranked[0]
    there = having(site.path("/~past"), season=season)
    which = f"the {site.kind.event} with the most visitors in {season}"
    when = f"{best.day.day} {best.day:%b %Y}"
    choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        ("title", (best.title,), (best.title,)),
        ("number of visitors", (best.title, f"{best.visitors:,}"), thousands(best.visitors)),
        ("date", (best.title, when), days(best.day)),
        ("place", (best.title, best.venue.name), (best.venue.name,)),
    ]
    chosen = [choices[0], *rng.sample(choices[1:], facts - 1)]
    seen = tuple(
        dict.fromkeys(text for _, texts, _ in chosen for text in (best.title, f"{best.visitors:,}", *texts))
    )
    anywhere = having(site.path("/~past"), sort="visitors")
    return Part(
        ask=f"find {which} among what took place before and give {the([noun for noun, *_ in chosen])}",
        description=f"{which[:1].upper()}{which[1:]}",
        facts=tuple(
            Fact(
                f"The {noun} of {which} is found.",
                (Evidence(texts, there), Evidence(texts, anywhere)),
                answer=ways,
            )
            for noun, texts, ways in chosen
        ),
        moves=(
            Click(path=site.path("/~past")),
            Choose(site.say["season"], season),
            Choose("Ranked by", "Most visitors"),
            See(seen),
        ),
        says=f"{best.title}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen[1:]) + ".",
    )


def ask_result(site: Events, rng: random.Random, facts: int) -> Part | None:
    """Something that took place on a page further back, such as how a match ended."""
    season = rng.choice(site.seasons)
    found = site.past_of(str(season))
    at = rng.randrange(min(len(found), 20))
    past: Past = found[at]
    if sum(other.title == past.title for other in site.season.past) > 1:
        return None
    there = having(site.path("/~past"))
    one, two = past.score
    visitors, when = f"{past.visitors:,}", f"{past.day.day} {past.day:%b %Y}"
    choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        ("number of visitors", (past.title, visitors), thousands(past.visitors)),
        ("date", (past.title, when), days(past.day)),
        ("place", (past.title, past.venue.name), (past.venue.name,)),
    ]
    if site.kind.league:
        ways = (f"{one}:{two}", f"{one}-{two}", f"{one} - {two}", f"{one} : {two}", f"{one} to {two}")
        choices[0] = ("final score", (past.title, f"{one}:{two}"), ways)
    chosen = rng.sample(choices, facts)
    seen = tuple(dict.fromkeys(text for _, texts, _ in chosen for text in texts))
    return Part(
        ask=f"find the {site.kind.event} “{past.title}” of {season} among what took place before and give "
        f"{the([noun for noun, *_ in chosen])}",
        description=f"“{past.title}” of {season}",
        facts=tuple(
            Fact(
                f"The {noun} of “{past.title}” of {season} is found.", (Evidence(texts, there),), answer=ways
            )
            for noun, texts, ways in chosen
        ),
        moves=(
            Click(path=site.path("/~past")),
            Choose(site.say["season"], str(season)),
            *further(site, at // 10),
            See(seen),
        ),
        says=f"“{past.title}”: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen) + ".",
    )


def ask_standings(site: Events, rng: random.Random, facts: int) -> Part | None:
    """A row of a league's table."""
    if not site.kind.league:
        return None
    row = rng.choice(site.season.standings)
    rows = site.season.standings
    most = sorted(rows, key=lambda other: -other.goals)
    there = having(site.path("/~standings"))
    if rng.random() < 0.4:
        if facts != 2 or most[0].goals == most[1].goals:
            return None
        row, which = most[0], f"the {site.kind.person} that scored the most goals"
        goals = ("number of goals", (row.club.name, str(row.goals)), (str(row.goals),))
        chosen: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
            ("name", (row.club.name,), (row.club.name,)),
            goals,
        ]
    else:
        which = f"{row.club.name}"
        choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
            ("number of points", (row.club.name, str(row.points)), (str(row.points),)),
            ("number of wins", (row.club.name, str(row.won)), count_words(row.won)),
            (
                "place in the table",
                (row.club.name, str(row.place)),
                count_words(row.place),
            ),
            ("goals scored", (row.club.name, str(row.goals)), (str(row.goals),)),
        ]
        chosen = rng.sample(choices, facts)
    seen = tuple(dict.fromkeys(text for _, texts, _ in chosen for text in texts))
    return Part(
        ask=f"look up {which} in the table of the league and give {the([noun for noun, *_ in chosen])}",
        description=f"The table: {which}",
        facts=tuple(
            Fact(f"The {noun} of {which} is found.", (Evidence(texts, there),), answer=ways)
            for noun, texts, ways in chosen
        ),
        moves=(Click(path=site.path("/~standings")), See(seen)),
        says=f"{row.club.name}: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen) + ".",
    )


def ask_rules(site: Events, rng: random.Random, facts: int) -> Part | None:
    """What visitors need to know."""
    rules, there = site.season.rules, having(site.path("/~visit"))
    titles = tuple(site.say[key] for key in ("refunds", "groups", "bags", "young"))
    fee, cloak = rules["fee"] * 100, rules["cloak"] * 100
    before, group, young = (rules[key] for key in ("days", "group", "young"))
    share, bag = rules["student_off"], rules["bag"]
    choices: list[tuple[int, str, str, tuple[str, ...]]] = [
        (
            0,
            "number of days until which tickets can be returned",
            f"until {before} days",
            count_words(before),
        ),
        (0, "cost of returning a ticket", f"Returning costs {site.money(fee)}", sums(site, fee)),
        (1, "smallest group that gets a discount", f"Groups of {group} or more", count_words(group)),
        (1, "discount for students in per cent", f"Students get {share} %", (f"{share} %", str(share))),
        (2, "size of a bag that may be kept, in cm", f"more than {bag} cm", (f"{bag} cm", str(bag))),
        (2, "price of the cloakroom", f"which costs {site.money(cloak)}", sums(site, cloak)),
        (3, "age under which children come in free", f"Children under {young}", count_words(young)),
    ]
    tab = rng.randrange(4)
    mine = [row for row in choices if row[0] == tab]
    if facts > len(mine):
        return None
    chosen = rng.sample(mine, facts)
    seen = tuple(row[2] for row in chosen)
    return Part(
        ask=f"look up in the information for visitors {the([row[1] for row in chosen])}",
        description=f"Information for visitors: {titles[tab].lower()}",
        facts=tuple(
            Fact(f"The {noun} is found.", (Evidence((text,), there),), answer=ways)
            for _, noun, text, ways in chosen
        ),
        moves=(Click(path=site.path("/~visit")), *in_section(site, titles, titles[tab]), See(seen)),
        says="; ".join(f"{noun}: {ways[0]}" for _, noun, _, ways in chosen) + ".",
    )


def ask_return(site: Events, rng: random.Random, facts: int) -> Part | None:
    """How tickets are returned."""
    del rng
    if facts != 1:
        return None
    rules = site.season.rules
    form, days_before = f"V{rules['form']}", rules["days"]
    return Part(
        ask="find out how tickets are returned, naming the form that is needed",
        description="How tickets are returned",
        facts=(
            Fact(
                "Instructions on how to return tickets, with the form that is needed, are found.",
                (Evidence((f"form {form}",), having(site.path("/~visit"))),),
                answer=(f"form {form}", form),
            ),
        ),
        moves=(Click(path=site.path("/~visit")), See((f"form {form}",))),
        says=f"Fill in form {form} and bring it with the tickets until {days_before} days before.",
    )


def ask_news(site: Events, rng: random.Random, facts: int) -> Part | None:
    """Sign up for the newsletter."""
    _, topic = rng.choice(site.categories)
    often = rng.choice(site.often)
    given, family = rng.choice(names.GIVEN), rng.choice(names.FAMILY)
    name, email = f"{given} {family}", f"{given}{rng.randint(10, 99)}@post.test".lower()
    there = having(site.path("/~news/done"))
    if facts not in (2, 3):
        return None

    def done(text: str, shown: Sequence[str], key: str, value: str) -> Fact:
        return Fact(
            text,
            (Evidence((f"We write to {email}", *shown), there),),
            (StateCheck(("news", email, key), value),),
        )

    found = (
        done(f"The newsletter is about {topic}.", (topic,), "about", topic),
        done(f"It comes: {often.lower()}.", (often,), "often", often),
        done(f"The sign-up is for {name} with {email}.", (name,), "name", name),
    )
    return Part(
        ask=f"sign up for the newsletter about {topic}, to come {often[:1].lower()}{often[1:]}, for {name} "
        f"with the e-mail address {email}",
        description=f"Newsletter for {email}",
        facts=found[:facts],
        moves=(
            Click(path=site.path("/~news")),
            Choose("About what", topic),
            Choose("How often", often),
            Fill(site.say["name"], name),
            Fill(site.say["email"], email),
            See((name, f"We write to {email}", topic, often)),
        ),
        says=f"{name} is signed up.",
    )
