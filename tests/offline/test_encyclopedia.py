"""Encyclopedias: lists that filter and sort, forms that check, contents without ties, one right answer."""

from __future__ import annotations

import re
from functools import lru_cache
from html import unescape
from urllib.parse import parse_qsl, unquote, urlsplit
from xml.etree import ElementTree

import pytest

from webgym.core.text import fold, says
from webgym.offline.families._phrases import nice_between
from webgym.offline.families.encyclopedia import Encyclopedia, stock
from webgym.offline.families.encyclopedia.schema import NONE, STOCK
from webgym.offline.look import look
from webgym.offline.website import Response, State, Visit, slug

SEEDS = range(100, 140)
FEW = range(100, 106)


@lru_cache
def made(seed: int) -> Encyclopedia:
    brand, label = Encyclopedia.christen("Fernhill", seed)
    return Encyclopedia(seed=seed, brand=brand, label=label, look=look(seed))


def ask(
    site: Encyclopedia, url: str, state: State | None = None, form: dict[str, str] | None = None
) -> Response:
    parts = urlsplit(url)
    query = dict(parse_qsl(parts.query))
    method = "GET" if form is None else "POST"
    held: State = {} if state is None else state
    return site.handle(Visit(method, unquote(parts.path), query, {}, form or {}, held))


def text_of(answer: Response) -> str:
    body = re.sub(r"(?s)<(script|style|select)\b.*?</\1>", " ", answer.body.decode())
    return fold(unescape(re.sub(r"<[^>]+>", " ", body)))


@pytest.mark.parametrize("seed", SEEDS)
def test_contents_have_no_ties_and_no_two_of_a_name(seed: int) -> None:
    site = made(seed)
    articles = site.stock.articles
    assert 25 <= len(articles) <= 70
    assert len(site.stock.by_slug) == len(articles)
    for measure in site.stock.measures:
        assert len({article.numbers[measure.key] for article in articles}) == len(articles)
    for group in site.stock.groups:
        members = site.stock.members(group)
        assert [article.lacking for article in members].count(NONE) == 1
    for article in articles:
        assert article.person.born < article.year <= article.person.died
        assert article.slug not in article.seealso
        assert all(other in site.stock.by_slug for other in article.seealso)


def test_websites_differ() -> None:
    sites = [made(seed) for seed in SEEDS]
    assert len({site.subject.noun for site in sites}) >= 15
    assert len({site.subdomain for site in sites}) >= 10
    assert len({tuple(sorted(site.paths.items())) for site in sites}) == len(sites)
    assert len({ask(site, "/").body for site in sites}) == len(sites)


def test_every_subject_can_be_built() -> None:
    for subject in STOCK.subjects:
        assert len(stock.make(3, subject).articles) > 24, subject.noun


@pytest.mark.parametrize("seed", FEW)
def test_same_seed_same_bytes(seed: int) -> None:
    one, two = made(seed), made.__wrapped__(seed)
    for path in ("/", one.path("/~list"), one.article_path(one.stock.articles[7])):
        assert ask(one, path).body == ask(two, path).body


@pytest.mark.parametrize("seed", FEW)
def test_lists_filter_and_sort(seed: int) -> None:
    site = made(seed)
    group = site.stock.groups[1]
    measure = site.stock.measures[0]
    path = f"{site.path('/~list')}?group={slug(group)}&sort={measure.key}-desc"
    ranked = sorted(site.stock.members(group), key=lambda a: -a.numbers[measure.key])
    page = ask(site, path).body.decode()
    places = [page.index(f'"{site.article_path(a)}"') for a in ranked[: site.page_size()]]
    assert places == sorted(places)
    assert f"<b>{site.count(len(ranked))}</b>" in page
    since = sorted(a.year for a in site.stock.articles)[-3]
    late = sum(article.year >= since for article in site.stock.articles)
    assert f"<b>{site.count(late)}</b>" in ask(site, f"{site.path('/~list')}?since={since}").body.decode()
    assert ask(site, f"{site.path('/~list')}?since=999999999&sort=nonsense&page=x").status == 200


@pytest.mark.parametrize("seed", FEW)
def test_search_finds_titles_and_forgives_a_slip(seed: int) -> None:
    site = made(seed)
    article = site.stock.articles[4]
    path, key = site.path("/~search"), site.paths["q"]
    answer = ask(site, f"{path}?{key}={article.title.replace(' ', '+').lower()}")
    if site.jumps:
        assert answer.location == site.article_path(article)
    else:
        assert site.article_path(article) in answer.body.decode()
    slip = article.title[:-2] + "x" + article.title[-2:]
    page = text_of(ask(site, f"{path}?{key}={slip.replace(' ', '+')}"))
    assert "did you mean" in page
    assert says(page, article.title)
    assert "nothing was found" in text_of(ask(site, f"{path}?{key}=qqqqqqqq"))


@pytest.mark.parametrize("seed", FEW)
def test_a_correction_is_checked_and_kept(seed: int) -> None:
    site = made(seed)
    state: State = {}
    article = site.stock.articles[0]
    path = site.path("/~report/{name}", name=article.slug)
    bad = {"kind": stock.KINDS[1], "mail": "nobody", "text": "short"}
    answer = ask(site, path, state, bad)
    assert answer.status == 422
    page = answer.body.decode()
    assert 'value="nobody"' in page
    assert 'value="short"' in page
    assert re.search(rf'value="{stock.KINDS[1]}" selected', page)
    assert page.count('class="error"') == 2
    assert site.report(state)["reports"] == {}
    good = {"kind": stock.KINDS[1], "mail": "a@b.example", "text": "The figure is out of date"}
    sent = ask(site, path, state, good)
    assert sent.status == 303
    assert says(text_of(ask(site, sent.location or "", state)), good["text"])
    assert site.report(state)["reports"] == {article.title: good}


@pytest.mark.parametrize("seed", FEW)
def test_the_reading_list_and_the_newsletter_are_remembered(seed: int) -> None:
    site = made(seed)
    state: State = {}
    first, second = site.stock.articles[:2]
    shelf = site.path("/~saved")
    for article in (first, second, first):
        assert ask(site, f"{shelf}/{article.slug}", state, {}).status == 303
    assert site.report(state)["saved"] == {first.title: True, second.title: True}
    ask(site, f"{shelf}/{first.slug}", state, {"do": "remove"})
    assert site.report(state)["saved"] == {second.title: True}
    letter = site.path("/~letter")
    assert ask(site, f"{letter}/done", state).status == 404
    assert ask(site, letter, state, {"often": "x", "topic": "", "mail": "a@b.example"}).status == 422
    sent = {"often": stock.OFTEN[0], "topic": site.stock.groups[0], "mail": "a@b.example"}
    assert ask(site, letter, state, sent).status == 303
    assert site.report(state)["letter"] == sent


def test_two_of_the_same_cannot_be_compared() -> None:
    site = made(100)
    one = site.stock.articles[0].slug
    assert "Choose two different" in ask(site, f"{site.path('/~compare')}?a={one}&b={one}").body.decode()


def test_unknown_pages_are_missing() -> None:
    site = made(101)
    for pattern in ("/~wiki/none", "/~person/none", "/~group/none", "/~report/none", "/~wiki/none/history"):
        assert ask(site, site.path(pattern)).status == 404


def test_exactly_one_fulfils_an_either_or() -> None:
    """The clause is read back and applied to the whole group."""
    found = 0
    for seed in SEEDS:
        site = made(seed)
        for assignment in site.assignments():
            for part in assignment.parts:
                match = re.search(r"more than ([\d,]+).* OR a year before (\d+)", part.ask)
                if match is None:
                    continue
                found += 1
                over, before = (int(text.replace(",", "")) for text in match.groups())
                group = next(g for g in site.stock.groups if f"“{g}”" in part.ask)
                named = [m for m in site.stock.measures if f"{m.label.lower()}" in part.ask.lower()]
                right = [
                    {
                        article.title
                        for article in site.stock.members(group)
                        if article.numbers[measure.key] > over or article.year < before
                    }
                    for measure in named
                ]
                assert {part.facts[0].answer[0]} in right, (seed, part.ask)
    assert found > 10


@pytest.mark.parametrize(
    ("low", "high", "nice"), [(499, 700, 500), (500, 501, 500), (13, 14, 13), (81, 120, 100)]
)
def test_nice_numbers_lie_between(low: int, high: int, nice: int) -> None:
    assert nice_between(low, high) == nice


def test_every_subject_has_its_picture() -> None:
    site = made(100)
    for subject in STOCK.subjects:
        drawn = ask(site, f"/picture/{subject.picture}/Tom%20%26%20Co.svg").body
        ElementTree.fromstring(drawn)
        assert drawn != ask(site, f"/picture/{subject.picture}/Another.svg").body
