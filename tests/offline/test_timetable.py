"""The operators' websites: same bytes for the same seed, results that obey, and forms that check."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from webgym.core.text import fold, says
from webgym.offline.families.timetable import Timetable
from webgym.offline.families.timetable.modes import MODES
from webgym.offline.families.timetable.network import days_on_sale
from webgym.offline.look import look
from webgym.offline.website import slug

SEEDS = range(1, 15)


def made(seed: int) -> Timetable:
    brand, label = Timetable.christen("Fernhill", seed)
    return Timetable(seed=seed, brand=brand, label=label, look=look(seed))


def test_same_seed_same_bytes(visitor: Any) -> None:
    for seed in (3, 4):
        one, two = made(seed), made(seed)
        for url in ("/", one.path("/~stops"), one.path("/~fares"), one.journey_url(*one.network.pairs()[5])):
            assert visitor(one).ask(url).body == visitor(two).ask(url).body
    assert visitor(made(3)).ask("/").body != visitor(made(4)).ask("/").body


def test_websites_differ() -> None:
    sites = [made(seed) for seed in range(50)]
    assert len({site.mode.name for site in sites}) == len(MODES)
    assert len({tuple(site.say.values()) for site in sites}) == 50
    assert len({tuple(sorted(site.paths.items())) for site in sites}) == 50
    assert len({site.subdomain for site in sites}) == 3
    assert len({len(site.network.stops) for site in sites}) >= 4


def test_services_have_numbers_of_their_own_and_are_found_by_them() -> None:
    site = made(5)
    services = [service for pair in site.network.pairs() for service in site.network.departures(*pair)]
    assert len({service.code for service in services}) == len(services)
    assert all(site.network.departure(service.slug) is service for service in services)
    assert site.network.departure("ic-99999") is None
    assert site.network.departure("nonsense") is None


def test_results_are_filtered_and_sorted(visitor: Any) -> None:
    for seed in SEEDS:
        site = made(seed)
        origin, target = site.network.pairs()[7]
        day = days_on_sale()[1]
        url = site.journey_url(origin, target, day)
        offers = site.network.offers(origin, target, day)
        direct = [offer for offer in offers if offer.departure.change is None]
        found = len(direct)
        noun = "departure" if found == 1 else "departures"
        assert f"{found} {noun} found" in visitor(site).follow(f"{url}&direct=1")[1]
        _, text = visitor(site).follow(f"{url}&sort=price")
        ranked = sorted(offers, key=lambda offer: (offer.cents, offer.departure.minute))[: site.page_size]
        places = [text.index(fold(offer.departure.code) + " ") for offer in ranked]
        assert places == sorted(places)


def test_a_search_that_cannot_be_done_keeps_what_was_typed(visitor: Any) -> None:
    site = next(made(seed) for seed in SEEDS if made(seed).typed)
    good = site.network.stops[0].name
    day = days_on_sale()[2].isoformat()
    start = site.path("/~search")
    answer = visitor(site).ask(f"{start}?from={quote(good)}&to=Nowhere&date={day}&people=3")
    text = answer.body.decode()
    assert f'value="{good}"' in text
    assert 'value="Nowhere"' in text
    assert f'value="{day}" selected' in text
    assert "We do not know this" in text
    url, _ = visitor(site).follow(
        f"{start}?from={good.upper().replace(' ', '+')}&to={site.network.stops[1].slug}"
    )
    assert f"from={site.network.stops[0].slug}" in url


def test_booking_checks_the_form_and_reports_what_was_booked(visitor: Any) -> None:
    site = made(6)
    guest = visitor(site)
    origin, target = site.network.pairs()[3]
    offer = site.network.offers(origin, target, days_on_sale()[0])[0]
    klass = site.mode.classes[-1][0]
    day = offer.day.isoformat()
    url = site.path("/~book/{code}/{day}/{klass}", code=offer.departure.slug, day=day, klass=slug(klass))
    form = {"seat": site.mode.seats[0], "extra": "", "name": "Ada", "email": "ada@post", "terms": "yes"}
    answer = guest.ask(url, form)
    assert answer.status == 422
    body = answer.body.decode()
    assert 'value="Ada"' in body
    assert f'value="{site.mode.seats[0]}" selected' in body
    assert body.count('class="error"') == 2
    assert site.report(guest.state)["booked"] == {}
    form |= {"name": "Ada Novak", "email": "ada@post.test"}
    where, text = guest.follow(url, form)
    number = site.reference(offer, klass, 1, "Ada Novak")
    assert where.endswith(number)
    assert says(text, number)
    booked = site.report(guest.state)["booked"][f"{offer.departure.code} {day}"]
    assert booked["class"] == klass
    assert booked["total"] == site.money(site.network.fare(offer, klass))
    assert guest.follow(site.path("/~manage"), {"reference": number, "surname": "novak"})[0] == where


def test_a_booking_opens_for_its_passenger_alone_and_can_be_changed(visitor: Any) -> None:
    site = made(7)
    guest = visitor(site)
    booking = site.network.bookings[0]
    page = site.path("/~manage/{number}", number=booking.reference)
    assert guest.ask(page).location == site.path("/~manage")
    wrong = guest.ask(site.path("/~manage"), {"reference": booking.reference, "surname": "Nobody"})
    assert wrong.status == 422
    assert booking.reference in wrong.body.decode()
    who = {"reference": booking.reference.lower(), "surname": booking.surname.upper()}
    assert guest.follow(site.path("/~manage"), who)[0] == page
    extra = site.mode.extras[0][0]
    assert says(guest.follow(page, {"extra": extra})[1], f"Extras {extra}")
    assert "this booking was cancelled" in guest.follow(page, {"act": "cancel"})[1]
    assert site.report(guest.state)["extras"] == {booking.reference: [extra]}
    assert site.report(guest.state)["cancelled"] == {booking.reference: True}


def test_alerts_and_account_check_their_forms(visitor: Any) -> None:
    site = made(8)
    guest = visitor(site)
    line = site.network.lines[0]
    page = site.path("/~notify")
    answer = guest.ask(page, {"line": line.slug, "often": "", "email": "nobody"})
    assert answer.status == 422
    assert f'value="{line.slug}" selected' in answer.body.decode()
    guest.follow(page, {"line": line.slug, "often": site.often[0], "email": "Eve@post.test"})
    assert site.report(guest.state)["alerts"] == {
        "eve@post.test": {"line": line.name, "often": site.often[0]}
    }
    member, account = site.network.member, site.path("/~account")
    assert guest.ask(account, {"email": member.email, "password": "no"}).status == 422
    assert member.number not in guest.follow(account)[1]
    _, text = guest.follow(account, {"email": member.email, "password": member.password})
    assert member.number in text
    klass = site.mode.classes[0][0]
    guest.follow(account, {"class": klass})
    assert site.report(guest.state)["prefers"] == {"class": klass}
