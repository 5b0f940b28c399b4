"""The job boards: signing in, what their forms refuse, what they keep, filters and orders."""

from __future__ import annotations

import pytest

from webgym.offline.families.jobs import Jobs
from webgym.offline.families.jobs.catalog import LEVELS
from webgym.offline.look import look
from webgym.offline.seeds import number
from webgym.offline.website import Response, State, Visit

FORM = {
    "experience": "2 to 5 years",
    "notice": "Immediately",
    "name": "Ada Novak",
    "email": "ada@letters.example",
    "phone": "0123 456789",
    "reason": "I have always wanted to",
}


def make(index: int) -> Jobs:
    seed = number("jobs", index)
    brand, label = Jobs.christen("Fernhill", seed)
    return Jobs(seed=seed, brand=brand, label=label, look=look(seed))


@pytest.fixture
def site() -> Jobs:
    return next(site for site in map(make, range(20)) if site.guarded)


def post(site: Jobs, path: str, state: State, form: dict[str, str]) -> Response:
    return site.handle(Visit("POST", path, {}, {}, form, state))


def get(site: Jobs, path: str, state: State, query: dict[str, str] | None = None) -> Response:
    return site.handle(Visit("GET", path, query or {}, {}, {}, state))


def sign_in(site: Jobs, state: State) -> Response:
    account = site.account
    return post(site, site.path("/~signin"), state, {"email": account.email, "password": account.password})


def test_a_wrong_password_is_refused_and_the_address_kept(site: Jobs) -> None:
    state: State = {}
    form = {"email": site.account.email, "password": "guess"}
    answer = post(site, site.path("/~signin"), state, form)
    assert answer.status == 422
    assert f'value="{site.account.email}"' in answer.body.decode()
    assert "guess" not in answer.body.decode()
    assert site.report(state)["signed in"] is None


def test_applications_are_behind_the_sign_in_and_gone_after_signing_out(site: Jobs) -> None:
    state: State = {}
    mine = site.path("/~mine")
    assert get(site, mine, state).location == site.path("/~signin")
    assert sign_in(site, state).location == mine
    page = get(site, mine, state).body.decode()
    assert all(one.job.title in page and one.stage in page for one in site.account.applications)
    post(site, site.path("/~signin/out"), state, {})
    assert get(site, mine, state).location == site.path("/~signin")


def test_an_application_is_withdrawn_once_and_only_by_its_owner(site: Jobs) -> None:
    state: State = {}
    job = site.account.applications[0].job
    assert post(site, site.path("/~mine"), state, {"job": job.slug}).location == site.path("/~signin")
    sign_in(site, state)
    for _ in range(2):
        post(site, site.path("/~mine"), state, {"job": job.slug})
    assert site.report(state)["withdrawn"] == {job.title: True}
    other = next(j for j in site.jobs if all(j != one.job for one in site.account.applications))
    assert post(site, site.path("/~mine"), state, {"job": other.slug}).status == 404


@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("experience", "", "Please choose one."),
        ("notice", "Never", "Please choose one."),
        ("name", "Ada", "first and last name"),
        ("email", "ada@letters", "does not look like an e-mail"),
        ("phone", "12-34", "Digits and spaces only"),
        ("reason", "Because", "at least 10 characters"),
    ],
)
def test_a_faulty_application_is_refused_and_keeps_the_rest(
    site: Jobs, name: str, value: str, complaint: str
) -> None:
    state: State = {}
    job = site.jobs[0]
    answer = post(site, f"{site.href(job)}/apply", state, {**FORM, name: value})
    assert answer.status == 422
    page = answer.body.decode()
    assert complaint in page
    kept = [text for field, text in FORM.items() if field != name]
    assert all(f'value="{text}"' in page for text in kept)
    assert site.report(state)["applied"] == {}


def test_an_application_is_kept_and_confirmed(site: Jobs) -> None:
    state: State = {}
    job = site.jobs[0]
    answer = post(site, f"{site.href(job)}/apply", state, FORM)
    assert answer.location is not None
    assert site.report(state)["applied"] == {job.title: FORM}
    assert site.receipt(job) in get(site, answer.location, state).body.decode()
    assert get(site, answer.location, {}).status == 404


def test_a_guarded_board_saves_only_after_signing_in(site: Jobs) -> None:
    state: State = {}
    job, saved = site.jobs[0], site.path("/~saved")
    assert post(site, saved, state, {"job": job.slug}).location == site.path("/~signin")
    sign_in(site, state)
    post(site, saved, state, {"job": job.slug})
    assert site.report(state)["saved"] == {job.title: True}
    post(site, saved, state, {"job": job.slug, "forget": "1"})
    assert site.report(state)["saved"] == {}


def test_filters_and_orders_hold(site: Jobs) -> None:
    paid = site.find(sort="pay")
    assert [job.high for job in paid] == sorted((job.high for job in site.jobs), reverse=True)
    closing = site.find(sort="closing")
    assert [job.closes for job in closing] == sorted(job.closes for job in site.jobs)
    floor = site.finder.facets[-1].options[1][0]
    assert all(job.low >= int(floor) for job in site.find(floor=floor))
    assert {job.title for job in site.find(q=site.jobs[0].title.upper())} == {site.jobs[0].title}


@pytest.mark.parametrize("level", LEVELS)
def test_pay_statistics_follow_the_level(site: Jobs, level: str) -> None:
    page = get(site, site.path("/~pay"), {}, {"level": level.lower().replace(" ", "-")}).body.decode()
    assert all(site.money(row.median) in page for row in site.pay[level])
    assert all(row.lower < row.median < row.upper for row in site.pay[level])
