"""The operators' websites: same bytes for the same seed, no dead link, forms that check, well-posed tasks."""

from __future__ import annotations

import html
import re
from collections import Counter
from typing import Any
from urllib.parse import parse_qsl, quote, unquote, urlsplit

import pytest

from webgym.core.text import fold, says
from webgym.core.truth import Choose, Click, Fill
from webgym.offline.families._timetable_modes import MODES
from webgym.offline.families._timetable_network import days_on_sale
from webgym.offline.families.timetable import Timetable
from webgym.offline.look import look
from webgym.offline.parts import Place, write
from webgym.offline.website import Response, State, Visit, slug

SEEDS = range(1, 15)


def made(seed: int) -> Timetable:
    brand, label = Timetable.christen("Fernhill", seed)
    return Timetable(seed=seed, brand=brand, label=label, look=look(seed))


def ask(site: Timetable, url: str, state: State, form: dict[str, str] | None = None) -> Response:
    parts = urlsplit(url)
    query = dict(parse_qsl(parts.query, keep_blank_values=True))
    lists = {key: [value] for key, value in {**query, **(form or {})}.items()}
    method = "GET" if form is None else "POST"
    return site.handle(Visit(method, unquote(parts.path), query, lists, form or {}, state))


def follow(site: Timetable, url: str, state: State, form: dict[str, str] | None = None) -> tuple[str, str]:
    """Address and visible text of the page that a request ends at."""
    answer = ask(site, url, state, form)
    while answer.location is not None:
        url = answer.location
        answer = ask(site, url, state)
    assert answer.status in (200, 422), (url, answer.status)
    return url, text_of(answer)


def text_of(answer: Response) -> str:
    body = re.sub(r"(?s)<(script|style)\b.*?</\1>", " ", answer.body.decode())
    return fold(html.unescape(re.sub(r"<[^>]+>", " ", body)))


def links_of(answer: Response) -> set[str]:
    found = re.findall(r'(?:href|src|data-url)="(/[^"]*)"', answer.body.decode())
    return {html.unescape(link) for link in found if not link.startswith("/assets/")}


@pytest.mark.parametrize("seed", SEEDS)
def test_no_link_leads_nowhere(seed: int) -> None:
    site, seen, per_kind = made(seed), {"/"}, Counter[str]()
    queue = ["/"]
    while queue:
        url = queue.pop()
        answer = ask(site, url, {})
        assert answer.status in (200, 303), url
        for link in sorted(links_of(answer) - seen):
            kind = link.split("/")[1].split("?")[0]
            if per_kind[kind] < 12:
                per_kind[kind] += 1
                seen.add(link)
                queue.append(link)
    assert len(seen) > 50


def test_same_seed_same_bytes() -> None:
    for seed in (3, 4):
        one, two = made(seed), made(seed)
        for url in ("/", one.path("/~stops"), one.path("/~fares"), one.journey_url(*one.network.pairs()[5])):
            assert ask(one, url, {}).body == ask(two, url, {}).body
    assert ask(made(3), "/", {}).body != ask(made(4), "/", {}).body


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


def test_results_are_filtered_and_sorted() -> None:
    for seed in SEEDS:
        site = made(seed)
        origin, target = site.network.pairs()[7]
        day = days_on_sale()[1]
        url = site.journey_url(origin, target, day)
        offers = site.network.offers(origin, target, day)
        direct = [offer for offer in offers if offer.departure.change is None]
        found = len(direct)
        noun = "departure" if found == 1 else "departures"
        assert f"{found} {noun} found" in follow(site, f"{url}&direct=1", {})[1]
        _, text = follow(site, f"{url}&sort=price", {})
        ranked = sorted(offers, key=lambda offer: (offer.cents, offer.departure.minute))[: site.page_size]
        places = [text.index(fold(offer.departure.code) + " ") for offer in ranked]
        assert places == sorted(places)


def test_a_search_that_cannot_be_done_keeps_what_was_typed() -> None:
    site = next(made(seed) for seed in SEEDS if made(seed).typed)
    good = site.network.stops[0].name
    day = days_on_sale()[2].isoformat()
    start = site.path("/~search")
    answer = ask(site, f"{start}?from={quote(good)}&to=Nowhere&date={day}&people=3", {})
    text = answer.body.decode()
    assert f'value="{good}"' in text
    assert 'value="Nowhere"' in text
    assert f'value="{day}" selected' in text
    assert "We do not know this" in text
    url, _ = follow(
        site, f"{start}?from={good.upper().replace(' ', '+')}&to={site.network.stops[1].slug}", {}
    )
    assert f"from={site.network.stops[0].slug}" in url


def test_booking_checks_the_form_and_reports_what_was_booked() -> None:
    site = made(6)
    state: State = {}
    origin, target = site.network.pairs()[3]
    offer = site.network.offers(origin, target, days_on_sale()[0])[0]
    klass = site.mode.classes[-1][0]
    day = offer.day.isoformat()
    url = site.path("/~book/{code}/{day}/{klass}", code=offer.departure.slug, day=day, klass=slug(klass))
    form = {"seat": site.mode.seats[0], "extra": "", "name": "Ada", "email": "ada@post", "terms": "yes"}
    answer = ask(site, url, state, form)
    assert answer.status == 422
    body = answer.body.decode()
    assert 'value="Ada"' in body
    assert f'value="{site.mode.seats[0]}" selected' in body
    assert body.count('class="error"') == 2
    assert site.report(state)["booked"] == {}
    form |= {"name": "Ada Novak", "email": "ada@post.test"}
    where, text = follow(site, url, state, form)
    number = site.reference(offer, klass, 1, "Ada Novak")
    assert where.endswith(number)
    assert says(text, number)
    booked = site.report(state)["booked"][f"{offer.departure.code} {day}"]
    assert booked["class"] == klass
    assert booked["total"] == site.money(site.network.fare(offer, klass))
    assert follow(site, site.path("/~manage"), state, {"reference": number, "surname": "novak"})[0] == where


def test_a_booking_opens_for_its_passenger_alone_and_can_be_changed() -> None:
    site = made(7)
    state: State = {}
    booking = site.network.bookings[0]
    page = site.path("/~manage/{number}", number=booking.reference)
    assert ask(site, page, state).location == site.path("/~manage")
    wrong = ask(site, site.path("/~manage"), state, {"reference": booking.reference, "surname": "Nobody"})
    assert wrong.status == 422
    assert booking.reference in wrong.body.decode()
    who = {"reference": booking.reference.lower(), "surname": booking.surname.upper()}
    assert follow(site, site.path("/~manage"), state, who)[0] == page
    extra = site.mode.extras[0][0]
    assert says(follow(site, page, state, {"extra": extra})[1], f"Extras {extra}")
    assert "this booking was cancelled" in follow(site, page, state, {"act": "cancel"})[1]
    assert site.report(state)["extras"] == {booking.reference: [extra]}
    assert site.report(state)["cancelled"] == {booking.reference: True}


def test_alerts_and_account_check_their_forms() -> None:
    site = made(8)
    state: State = {}
    line = site.network.lines[0]
    page = site.path("/~notify")
    answer = ask(site, page, state, {"line": line.slug, "often": "", "email": "nobody"})
    assert answer.status == 422
    assert f'value="{line.slug}" selected' in answer.body.decode()
    follow(site, page, state, {"line": line.slug, "often": site.often[0], "email": "Eve@post.test"})
    assert site.report(state)["alerts"] == {"eve@post.test": {"line": line.name, "often": site.often[0]}}
    member, account = site.network.member, site.path("/~account")
    assert ask(site, account, state, {"email": member.email, "password": "no"}).status == 422
    assert member.number not in follow(site, account, state)[1]
    _, text = follow(site, account, state, {"email": member.email, "password": member.password})
    assert member.number in text
    klass = site.mode.classes[0][0]
    follow(site, account, state, {"class": klass})
    assert site.report(state)["prefers"] == {"class": klass}


@pytest.mark.parametrize("seed", SEEDS)
def test_tasks_are_well_posed(seed: int) -> None:
    site = made(seed)
    assignments = list(site.assignments())
    assert len(assignments) >= 14
    place = Place(site.label, site.brand, site.host, site.start, site.domain, site.subdomain)
    tasks = [task for assignment in assignments for task in write(place, assignment)]
    assert len({task.id for task in tasks}) == len(tasks) >= 30
    assert len({task.instruction for task in tasks}) == len(tasks)
    assert sum(task.parent_id is not None for task in tasks) >= 12
    easy = sum(task.level == "easy" for task in tasks) / len(tasks)
    assert 0.6 <= easy <= 0.85
    assert {"easy", "medium", "hard"} == {task.level for task in tasks}
    for task in tasks:
        assert task.truth is not None
        answer = fold(task.truth.moves[-1].text)  # type: ignore[union-attr]
        for options in task.truth.answer.required:
            assert any(says(answer, option) for option in options), task.id
        for wrong in task.truth.answer.forbidden:
            assert not says(answer, wrong), (task.id, wrong)
        for fact in task.truth.facts:
            assert fact.evidence


@pytest.mark.parametrize("seed", SEEDS)
def test_evidence_stands_where_the_solution_leads(seed: int) -> None:
    """Plays every part of every task over HTTP and looks for the evidence on the pages it comes by."""
    site = made(seed)
    for assignment in site.assignments():
        for part in assignment.parts:
            state: State = {}
            pages = played(site, part.moves, state)
            for fact in part.facts:
                assert any(
                    re.match(evidence.path, url) and all(says(text, wanted) for wanted in evidence.texts)
                    for evidence in fact.evidence
                    for url, text in pages
                ), (assignment.name, fact.text, fact.evidence)
                for check in fact.state:
                    held: Any = site.report(state)
                    for key in check.key:
                        held = held.get(key)
                    assert held == check.value, (assignment.name, fact.text)


def played(site: Timetable, moves: tuple[object, ...], state: State) -> list[tuple[str, str]]:
    """What a browser without scripts would make of the moves: (address, text) of every page."""
    pages, url = [follow(site, "/", state)], "/"
    values: dict[str, str] = {}
    for move in moves:
        body = ask(site, url, state).body.decode()
        if isinstance(move, Click) and move.path is not None:
            assert html.escape(move.path) in body, (url, move.path)
            url, text = follow(site, move.path, state)
            values = {}
        elif isinstance(move, Click):
            assert move.name is not None
            label = html.escape(move.name)
            box = re.search(
                rf'<input type="checkbox" name="([^"]+)" value="([^"]+)"[^>]*aria-label="{re.escape(label)}"',
                body,
            )
            button = re.search(rf">{re.escape(label)}</(button|summary)>", body)
            more = re.search(
                rf'(?:data-url|href)="([^"]+)"[^>]*>?[^<]*(?:aria-label="{re.escape(label)}"|>{re.escape(label)}<)',
                body,
            )
            if box is not None:
                values[box[1]] = box[2]
                if "data-submit" not in box.string[box.start() : box.string.index(">", box.start())]:
                    continue
                url, text = sent(site, url, body, box.start(), values, state)
            elif more is not None:
                url, text = follow(site, html.unescape(more[1]), state)
            else:
                assert button is not None, (url, move.name)
                if (
                    button[1] == "summary"
                    or 'type="button"' in body[: button.start()].rpartition("<button")[2]
                ):
                    continue
                if "data-do" in body[: button.start()].rpartition("<button")[2]:
                    continue
                url, text = sent(site, url, body, button.start(), values, state)
                values = {}
        elif isinstance(move, Choose | Fill):
            label = html.escape(move.field)
            tag = re.search(
                rf'<(?:select|input)[^>]*name="([^"]+)"[^>]*aria-label="{re.escape(label)}"[^>]*>', body
            )
            assert tag is not None, (url, move.field)
            if isinstance(move, Fill):
                values[tag[1]] = move.text
            else:
                rest = body[tag.end() : body.index("</select>", tag.end())]
                option = re.search(rf'value="([^"]*)"[^>]*>{re.escape(html.escape(move.option))}<', rest)
                assert option is not None, (url, move.option)
                values[tag[1]] = html.unescape(option[1])
            if isinstance(move, Choose) and "data-submit" not in tag[0]:
                continue
            url, text = sent(site, url, body, tag.start(), values, state)
        else:
            continue
        pages.append((url, text))
    return pages


def sent(
    site: Timetable, url: str, body: str, at: int, values: dict[str, str], state: State
) -> tuple[str, str]:
    """Send the form around a place in a page, unless a required field is still empty."""
    opening = body[:at].rpartition("<form")[2]
    start = at - len(opening)
    form = body[start : body.index("</form>", at)]
    tag = form[: form.index(">")]
    fields = dict(re.findall(r'<input type="hidden" name="([^"]+)" value="([^"]*)"', form))
    for control in re.finditer(r"<(input|select)\b([^>]*)>", form):
        name = re.search(r'name="([^"]+)"', control[2])
        if name is None or 'type="hidden"' in control[2]:
            continue
        if control[1] == "select":
            options = form[control.end() : form.index("</select>", control.end())]
            chosen = re.search(r'value="([^"]*)" selected', options) or re.search(r'value="([^"]*)"', options)
            fields[name[1]] = chosen[1] if chosen else ""
        elif 'type="checkbox"' in control[2]:
            if " checked" in control[2]:
                fields[name[1]] = "1"
        else:
            value = re.search(r'value="([^"]*)"', control[2])
            fields[name[1]] = html.unescape(value[1]) if value else ""
        fields |= {key: value for key, value in values.items() if key == name[1]}
        if " required" in control[2] and not fields.get(name[1]):
            return url, ""
    action = re.search(r'action="([^"]*)"', tag)
    target = action[1] if action else urlsplit(url).path
    if 'method="post"' in tag:
        return follow(site, url if action is None else target, state, fields)
    pairs = "&".join(f"{quote(key)}={quote(value)}" for key, value in fields.items())
    return follow(site, f"{target}?{pairs}", state)
