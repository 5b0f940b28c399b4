"""What can be asked about bookings, alerts and the member account."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline import names
from webgym.offline.engine.saying import days, having, sums, the, times
from webgym.offline.parts import Fact, Part

if TYPE_CHECKING:
    from webgym.offline.families.timetable import Timetable


# --- bookings, alerts and accounts ----------------------------------------------------------------------


def _open(site: Timetable, number: str, surname: str) -> tuple[Move, ...]:
    fields = (Fill(site.say["reference"], number), Fill(site.say["surname"], surname))
    return (Click(path=site.path("/~manage")), *fields)


def ask_look_up(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """What a booking says."""
    booking = rng.choice(site.network.bookings[:2])
    trip, seat = booking.departure, f"{booking.coach}{booking.place}"
    there = having(site.path("/~manage/{number}", number=booking.reference))
    choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        ("seat", ("Seat", seat), (seat, f"{booking.coach} {booking.place}")),
        ("class", ("Class", booking.klass), (booking.klass,)),
        ("day of travel", ("Day", site.spell(booking.day)), days(booking.day)),
        ("departure time", ("Departs", site.clock(trip.minute)), times(trip.minute)),
        ("destination", ("Journey", trip.target.name), (trip.target.name,)),
        ("price paid", ("Paid", site.money(booking.paid)), sums(site, booking.paid)),
        ("kind of ticket", ("Ticket", booking.ticket), (booking.ticket,)),
    ]
    chosen = rng.sample(choices, facts)
    seen = tuple(dict.fromkeys(text for _, texts, _ in chosen for text in texts))
    return Part(
        ask=f"open the booking {booking.reference} of passenger {booking.surname} and give "
        f"{the([noun for noun, *_ in chosen])}",
        description=f"Booking {booking.reference}",
        facts=tuple(
            Fact(
                text=f"The {noun} of booking {booking.reference} is found.",
                evidence=(Evidence(texts, there),),
                answer=ways,
            )
            for noun, texts, ways in chosen
        ),
        moves=(*_open(site, booking.reference, booking.surname), See(seen)),
        says=f"Booking {booking.reference}: "
        + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen)
        + ".",
    )


def ask_extra(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Add something to a booking."""
    booking = rng.choice(site.network.bookings[2:4])
    extra, price = rng.choice(site.mode.extras)
    if facts != 1:
        return None
    number = booking.reference
    return Part(
        ask=f"add the extra {extra} to the booking {number} of passenger {booking.surname}",
        description=f"An extra for booking {number}",
        facts=(
            Fact(
                text=f"The extra {extra} is added to booking {number}.",
                evidence=(
                    Evidence(("Extras", extra), having(site.path("/~manage/{number}", number=number))),
                ),
                state=(StateCheck(("extras", number), [extra]),),
            ),
        ),
        moves=(
            *_open(site, number, booking.surname),
            Choose(site.say["extra"], f"{extra}, {site.money(price * 100)}"),
            Click(name="Add to booking"),
            See(("Extras", extra, "Confirmed")),
        ),
        says=f"{extra} was added to the booking.",
    )


def ask_cancel(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Cancel a booking."""
    booking = rng.choice(site.network.bookings[4:])
    if facts != 1:
        return None
    number, shown = booking.reference, "This booking was cancelled"
    return Part(
        ask=f"cancel the booking {number} of passenger {booking.surname}",
        description=f"Cancellation of booking {number}",
        facts=(
            Fact(
                text=f"Booking {number} is cancelled.",
                evidence=(Evidence((shown,), having(site.path("/~manage/{number}", number=number))),),
                state=(StateCheck(("cancelled", number), True),),
            ),
        ),
        moves=(
            *_open(site, number, booking.surname),
            Click(name="Cancel this booking"),
            Click(name="Yes, cancel it"),
            See((shown,)),
        ),
        says="The booking was cancelled.",
    )


def ask_alerts(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Subscribe to alerts."""
    line, often = rng.choice(site.network.lines), rng.choice(site.often)
    email = f"{rng.choice(names.GIVEN)}{rng.randint(10, 99)}@post.test".lower()
    there = having(site.path("/~notify/done"))
    if facts not in (2, 3):
        return None

    def holds(field: str, value: str) -> tuple[StateCheck, ...]:
        return (StateCheck(("alerts", email, field), value),)

    found = [
        Fact(
            f"The alerts are for the {line.name}.",
            (Evidence((line.name, email), there),),
            holds("line", line.name),
        ),
        Fact(f"The alerts come {often.lower()}.", (Evidence((email, often), there),), holds("often", often)),
    ]
    seen = (line.name, email, often)
    if facts == 3:
        found.append(
            Fact(
                f"The sign-up is for {email}.",
                (Evidence((f"go to {email}",), there),),
                holds("often", often),
            )
        )
    return Part(
        ask=f"sign {email} up for e-mail alerts about the {line.name}, sent {often.lower()}",
        description=f"Alerts for {email}",
        facts=tuple(found),
        moves=(
            Click(path=site.path("/~notify")),
            Choose(f"Which {site.mode.line.lower()}", line.name),
            Choose("How often", often),
            Fill(site.say["email"], email),
            See(seen),
        ),
        says=f"{email} is signed up.",
    )


def ask_account(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Sign in, and tell what the account says or change it."""
    member, there = site.network.member, having(site.path("/~account"))
    points = f"{member.points:,}"
    choices: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        ("number of points", ("Points", points), (points, str(member.points))),
        ("level", ("Level", member.tier), (member.tier,)),
        ("member number", ("Member number", member.number), (member.number, member.number.replace(" ", ""))),
        (
            "value of the open voucher",
            ("Open voucher", site.money(member.voucher * 100)),
            sums(site, member.voucher * 100),
        ),
    ]
    chosen = rng.sample(choices, facts)
    seen = tuple(dict.fromkeys(text for _, texts, _ in chosen for text in texts))
    return Part(
        ask=f"sign in to the member account with {member.email} and the password {member.password} and give "
        f"{the([noun for noun, *_ in chosen])}",
        description="The member account",
        facts=tuple(
            Fact(text=f"The {noun} of the account is found.", evidence=(Evidence(texts, there),), answer=ways)
            for noun, texts, ways in chosen
        ),
        moves=(
            Click(path=site.path("/~account")),
            Fill(site.say["email"], member.email),
            Fill("Password", member.password),
            See(seen),
        ),
        says="The account: " + "; ".join(f"{noun} {ways[0]}" for noun, _, ways in chosen) + ".",
    )


def ask_preference(site: Timetable, rng: random.Random, facts: int) -> Part | None:
    """Sign in and set the preferred class."""
    member, klass = site.network.member, rng.choice(site.mode.classes)[0]
    if facts != 1:
        return None
    return Part(
        ask=f"sign in to the member account with {member.email} and the password {member.password} and save "
        f"{klass} as the preferred class",
        description="Preference in the member account",
        facts=(
            Fact(
                text=f"{klass} is saved as the preferred class of the account.",
                evidence=(Evidence(("Preferred class", klass), having(site.path("/~account"))),),
                state=(StateCheck(("prefers", "class"), klass),),
            ),
        ),
        moves=(
            Click(path=site.path("/~account")),
            Fill(site.say["email"], member.email),
            Fill("Password", member.password),
            Choose("Preferred class", klass),
            Click(name="Save preference"),
            See(("Preferred class", klass)),
        ),
        says=f"{klass} is saved as the preferred class.",
    )
