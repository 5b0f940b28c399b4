"""The authorities' websites: what their forms refuse and keep, the calculator, the calendar, the minutes."""

from __future__ import annotations

import pytest

from webgym.offline.families.government import Government
from webgym.offline.families.government.words import WORDS
from webgym.offline.look import look
from webgym.offline.seeds import number
from webgym.offline.website import Response, State, Visit, slug


def make(index: int) -> Government:
    seed = number("government", index)
    brand, label = Government.christen("Fernhill", seed)
    return Government(seed=seed, brand=brand, label=label, look=look(seed))


@pytest.fixture
def site() -> Government:
    return make(1)


def post(site: Government, path: str, state: State, form: dict[str, str]) -> Response:
    return site.handle(Visit("POST", path, {}, {}, form, state))


def get(site: Government, path: str, query: dict[str, str] | None = None) -> str:
    return site.handle(Visit("GET", path, query or {}, {}, {}, {})).body.decode()


@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("what", "Castle", "Please choose one."),
        ("office", "", "Please choose one."),
        ("name", "Ada", "at least 5 characters"),
        ("email", "ada.letters.example", "does not look like an e-mail"),
        ("street", "", "at least 5 characters"),
    ],
)
def test_a_faulty_application_is_refused_and_keeps_the_rest(
    site: Government, name: str, value: str, complaint: str
) -> None:
    form = {
        "what": site.body.permits[0],
        "office": site.offices[0].name,
        "name": "Ada Novak",
        "email": "ada@letters.example",
        "street": "Mill Lane 4",
    }
    state: State = {}
    answer = post(site, site.path("/~permit"), state, {**form, name: value})
    page = answer.body.decode()
    assert answer.status == 422
    assert complaint in page
    assert all(f'value="{text}"' in page for field, text in form.items() if field != name)
    assert site.report(state)["permit"] is None
    assert post(site, site.path("/~permit"), state, form).location == site.path("/~permit/done")
    assert site.report(state)["permit"] == form


def test_a_report_needs_a_description(site: Government) -> None:
    state: State = {}
    form = {"what": site.body.troubles[0], "urgency": "Dangerous", "street": "Mill Lane", "text": " "}
    answer = post(site, site.path("/~trouble"), state, form)
    assert answer.status == 422
    assert '<option value="Dangerous" selected>' in answer.body.decode()
    assert site.report(state)["trouble"] is None


def test_the_calculator_charges_more_for_longer_and_asks_for_all_answers(site: Government) -> None:
    _, places, kinds = site.body.price
    fees = [site.tariff[places[0], kinds[0], months] for months in (3, 6, 12)]
    assert fees == sorted(set(fees))
    query = {"place": slug(places[0]), "kind": slug(kinds[0]), "months": "6"}
    assert f"{site.money(fees[1])} in all" in get(site, site.path("/~price"), query)
    assert "in all" not in get(site, site.path("/~price"), {**query, "months": "7"})


@pytest.mark.parametrize("change", [str.upper, str.lower, slug, lambda text: f"  {text} "])
def test_streets_are_found_however_they_are_written(site: Government, change: object) -> None:
    assert callable(change)
    street = site.rounds[0].street
    page = get(site, site.path("/~rounds"), {"street": change(street)})
    assert f"Next dates in {street}" in page
    assert "nothing planned" in get(site, site.path("/~rounds"), {"street": "Nowhere"})


def test_a_case_is_found_by_its_number_alone(site: Government) -> None:
    case = site.cases[0]
    assert case.officer in get(site, site.path("/~track"), {"number": case.number.lower()})
    assert "There is no case" in get(site, site.path("/~track"), {"number": "C-1"})


@pytest.mark.parametrize("index", range(6))
def test_minutes_add_up_and_offices_are_open_in_the_right_order(index: int) -> None:
    site = make(index)
    for meeting in site.meetings:
        assert meeting.day.weekday() < 5
        for item in meeting.decisions:
            assert item.ayes != item.noes
            assert item.noes >= 0 <= item.abstained
    for office in site.offices:
        assert all(hours is None or hours[0] < hours[1] for hours in office.hours)
    assert [office.step_free for office in site.offices].count(False) == 1


def test_no_name_of_a_service_is_part_of_another_on_the_same_website() -> None:
    for body in WORDS.bodies.values():
        offered = [name.casefold() for group in body.groups for name in WORDS.services[group]]
        assert len(set(offered)) == len(offered)
        assert not [(a, b) for a in offered for b in offered if a != b and a in b]
