"""The organisers' websites: filters, calendars, tickets, forms that check, and catalogues that differ."""

from __future__ import annotations

from typing import Any

from webgym.core.text import fold, says
from webgym.offline.families.events import Events
from webgym.offline.families.events.data import SEASONS
from webgym.offline.families.events.kinds import KINDS
from webgym.offline.look import look
from webgym.offline.website import slug

SEEDS = range(1, 15)


def made(seed: int) -> Events:
    brand, label = Events.christen("Fernhill", seed)
    return Events(seed=seed, brand=brand, label=label, look=look(seed))


def test_same_seed_same_bytes(visitor: Any) -> None:
    for seed in (3, 4):
        one, two = made(seed), made(seed)
        for url in ("/", one.path("/~listing"), one.path("/~past"), one.event_url(one.season.events[3])):
            assert visitor(one).ask(url).body == visitor(two).ask(url).body
    assert visitor(made(3)).ask("/").body != visitor(made(4)).ask("/").body


def test_websites_differ() -> None:
    sites = [made(seed) for seed in range(60)]
    assert {site.kind.name for site in sites} == {kind.name for kind in KINDS}
    assert len({tuple(site.say.values()) for site in sites}) == 60
    assert len({len(site.season.events) for site in sites}) > 8
    assert len({(site.domain, site.subdomain) for site in sites}) == 8


def test_no_title_can_be_taken_for_another() -> None:
    for seed in SEEDS:
        titles = [event.title for event in made(seed).season.events]
        assert not any(one in two for one in titles for two in titles if one != two)
        assert len({slug(title) for title in titles}) == len(titles)


def test_the_listing_obeys_its_filters_and_order(visitor: Any) -> None:
    for seed in SEEDS:
        site = made(seed)
        month, category = site.months[1][0], site.categories[0][0]
        events = [e for e in site.season.events if f"{e.day:%Y-%m}" == month and slug(e.category) == category]
        noun = "entry" if len(events) == 1 else "entries"
        url = f"{site.path('/~listing')}?month={month}&category={category}&sort=price"
        _, text = visitor(site).follow(url)
        assert f"{len(events)} {noun}" in text
        ranked = sorted(events, key=lambda event: (event.cents, event.day))[: site.page_size]
        places = [text.index(fold(event.title)) for event in ranked]
        assert places == sorted(places)
        wanted = site.season.events[5].title
        assert says(visitor(site).follow(f"{site.path('/~listing')}?q={wanted}")[1], wanted)


def test_the_calendar_shows_every_event_of_its_month(visitor: Any) -> None:
    site = made(5)
    for month, name in site.months:
        _, text = visitor(site).follow(site.path("/~calendar/{month}", month=month))
        assert fold(name) in text
        for event in site.season.events:
            if f"{event.day:%Y-%m}" == month:
                assert says(text, event.title)
    assert visitor(site).ask(site.path("/~calendar/{month}", month="2031-01")).status == 404


def test_tickets_are_checked_and_reported(visitor: Any) -> None:
    for basket in (True, False):
        site = next(made(seed) for seed in range(40) if made(seed).has_basket is basket)
        guest = visitor(site)
        event = next(event for event in site.season.events if event.bands[0].left >= 3)
        band = event.bands[0]
        choice = {"band": band.name, "count": "3", "name": "Ada", "email": "ada@post.test"}
        assert guest.ask(site.event_url(event), choice | {"band": "Nowhere"}).status == 422
        assert guest.ask(site.event_url(event), choice | {"count": "9"}).status == 422
        page = site.event_url(event)
        if basket:
            page, text = guest.follow(page, choice)
            assert page == site.path("/~basket")
            assert says(text, site.money(3 * band.cents))
            assert site.report(guest.state)["basket"] == {event.title: {"band": band.name, "count": 3}}
        answer = guest.ask(page, choice)
        assert answer.status == 422
        assert 'value="Ada"' in answer.body.decode()
        assert site.report(guest.state)["bought"] == {}
        url, text = guest.follow(page, choice | {"name": "Ada Novak"})
        number = site.order_number("Ada Novak", {event.title: {"band": band.name, "count": 3}})
        assert url.endswith(number)
        assert says(text, number)
        bought = site.report(guest.state)["bought"][event.title]
        assert (bought["band"], bought["count"], bought["order"]) == (band.name, 3, number)
        assert site.report(guest.state)["basket"] == {}


def test_a_band_without_tickets_is_not_sold(visitor: Any) -> None:
    site = made(9)
    event, band = next((e, b) for e in site.season.events for b in e.bands if not b.left)
    choice = {"band": band.name, "count": "1", "name": "Ada Novak", "email": "ada@post.test"}
    answer = visitor(site).ask(site.event_url(event), choice)
    assert answer.status == 422
    assert event.sold_out or "This is sold out." in answer.body.decode()


def test_something_can_be_taken_out_of_the_basket(visitor: Any) -> None:
    site = next(made(seed) for seed in range(40) if made(seed).has_basket)
    guest = visitor(site)
    event = next(event for event in site.season.events if event.bands[0].left)
    guest.follow(site.event_url(event), {"band": event.bands[0].name, "count": "1"})
    _, text = guest.follow(site.path("/~basket"), {"remove": event.title})
    assert "there is nothing here yet" in text
    assert site.report(guest.state)["basket"] == {}


def test_saved_events_and_the_newsletter(visitor: Any) -> None:
    site = made(4)
    guest, event = visitor(site), site.season.events[7]
    _, text = guest.follow(site.event_url(event), {"act": "save"})
    assert says(text, event.title)
    assert site.report(guest.state)["saved"] == {event.title: True}
    page, wishes = (
        site.path("/~news"),
        {"about": site.categories[1][0], "often": "", "name": "Ada Novak", "email": "x"},
    )
    answer = guest.ask(page, wishes)
    assert answer.status == 422
    assert answer.body.decode().count('class="error"') == 2
    assert 'value="Ada Novak"' in answer.body.decode()
    _, text = guest.follow(page, wishes | {"often": site.often[0], "email": "Ada@post.test"})
    assert "ada@post.test" in text
    held = site.report(guest.state)["news"]["ada@post.test"]
    assert held == {"about": site.categories[1][1], "often": site.often[0], "name": "Ada Novak"}


def test_results_are_ranked_within_a_season(visitor: Any) -> None:
    for seed in SEEDS:
        site = made(seed)
        found = site.past_of(str(SEASONS[0]))
        assert found
        assert all(past.day.year == past.season == SEASONS[0] for past in found)
        best = max(found, key=lambda past: past.visitors)
        _, text = visitor(site).follow(f"{site.path('/~past')}?season={SEASONS[0]}&sort=visitors")
        assert f"{best.visitors:,}" in text


def test_only_leagues_have_a_table(visitor: Any) -> None:
    sites = [made(seed) for seed in range(40)]
    league = next(site for site in sites if site.kind.league)
    other = next(site for site in sites if not site.kind.league)
    points = [row.points for row in league.season.standings]
    assert points == sorted(points, reverse=True)
    assert visitor(league).ask(league.path("/~standings")).status == 200
    assert visitor(other).ask(other.path("/~standings")).status == 404
