"""Websites from a specification: files that do not fit, pages and forms, tasks, and a sample in Chromium."""

from __future__ import annotations

import random
import re
import sys
from collections import Counter
from importlib.util import module_from_spec, spec_from_file_location
from itertools import combinations, product
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from markupsafe import escape

from webgym.core.errors import SitesError
from webgym.core.task import Task
from webgym.core.text import fold, says
from webgym.core.truth import Click, Evidence, Give
from webgym.judge.offline import compare
from webgym.offline.data import load_beside
from webgym.offline.engine.item_tasks import field_fact, row_view
from webgym.offline.engine.records import Record
from webgym.offline.engine.spec import Spec, spec_of
from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.engine.tasks import _having, extreme
from webgym.offline.families import FAMILIES, Lettings
from webgym.offline.look import look
from webgym.offline.web import OfflineWeb
from webgym.offline.website import slug
from webgym.testing import check_family

Bank, Clinic, Shop = (
    next(family for family in FAMILIES if family.family == name) for name in ("bank", "clinic", "shop")
)
EXAMPLE = Path(__file__).parents[2] / "examples" / "own_website"
SEEDS = range(3)


def made(family: Any, seed: int = 0) -> Any:
    brand, label = family.christen("Fernhill", seed)
    return family(seed=seed, brand=brand, label=label, look=look(seed))


def tasks_of(family: type, websites: int) -> list[Task]:
    web = OfflineWeb(families=(family,), per_family=max(websites, 2))
    hosts = [host for host, spec in web.specs.items() if spec.behaviour == "good"][:websites]
    return [task for host in hosts for task in web.tasks_of(host)]


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.family)
def test_tasks_are_well_posed(family: type[SpecifiedWebsite]) -> None:
    tasks = tasks_of(family, len(SEEDS))
    assert len(tasks) >= 30 * len(SEEDS)
    for what in ("id", "instruction"):
        assert len({getattr(task, what) for task in tasks}) == len(tasks), what
    levels = Counter(task.level for task in tasks)
    assert 0.5 < levels["easy"] / len(tasks) < 0.85
    assert levels["medium"]
    assert levels["hard"]
    for task in tasks:
        assert task.truth is not None
        given = task.truth.moves[-1]
        assert isinstance(given, Give)
        form, value = compare(task.truth.answer, given.text)
        assert form.passed, task.id
        assert value is not None, task.id
        assert value.passed, task.id


def test_every_sector_has_its_words() -> None:
    """A website's brand, names and choices are of one sector."""
    site = made(Shop, 3)
    (sector,) = (each for each in Shop.whole.variants.values() if each.suffixes == site.spec.suffixes)
    assert set(site.items.options["category"]) == set(sector.options["category"])
    assert {site.spec_for(seed).suffixes for seed in range(200)} == {
        each.suffixes for each in Shop.whole.variants.values()
    }
    for record in site.items.records:
        category = record.fields["category"].text
        assert sector.follows is not None
        assert record.name.endswith(sector.follows["category"][category])


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.family)
@pytest.mark.parametrize("seed", SEEDS)
def test_filters_and_orders_hold(family: type[SpecifiedWebsite], seed: int) -> None:
    site = made(family, seed)
    for facet in site.finder.facets:
        for value, text in facet.options:
            found = site.find(**{facet.name: value})
            assert all(record.fields[facet.name].text == text for record in found)
    for value, _ in site.finder.sort.options[1:]:
        of, _, way = value.rpartition("-")
        ranks = [record.rank(of) for record in site.find(sort=value)]
        assert ranks == sorted(ranks, reverse=way == "down")


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.family)
def test_no_link_leads_nowhere(family: type[SpecifiedWebsite], visitor: Any) -> None:
    guest, seen, of_kind = visitor(made(family)), {"/"}, Counter[str]()
    queue = ["/"]
    while queue:
        url = queue.pop()
        assert guest.ask(url).status == 200, url
        for link in sorted(guest.links(url) - seen):
            first, *others = link.partition("?")[0][1:].split("/")
            kind = f"{first} {len(others)}"
            if of_kind[kind] < 4:
                of_kind[kind] += 1
                seen.add(link)
                queue.append(link)
    assert len(seen) > 15


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.family)
def test_no_two_things_have_one_name(family: type[SpecifiedWebsite]) -> None:
    for seed in range(12):
        site = made(family, seed)
        for sheet in (site.items, *site.groups.values()):
            names = [slug(record.name) for record in sheet.records]
            assert len(set(names)) == len(names), site.brand


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.family)
def test_who_also_does_something_else_has_not_done_the_task(family: type[SpecifiedWebsite]) -> None:
    checked = [
        {check.key: check.value for fact in task.truth.facts for check in fact.state}
        for task in tasks_of(family, 1)
        if task.truth
    ]
    kinds = {"cart", "files", "saved", "sent"}
    assert all({key[0] for key in checks} >= kinds for checks in checked if checks)
    sending = [checks for checks in checked if checks.get(("sent",))]
    assert sending
    for checks in sending:
        ((form, by_item),) = checks["sent",].items()
        ((item, values),) = by_item.items()
        assert all(checks["sent", form, item, name] == value for name, value in values.items())


def test_a_form_is_refused_with_its_values_kept_and_then_taken(visitor: Any) -> None:
    site = made(Clinic)
    guest, record = visitor(site), site.items.records[0]
    address = site.address("appointment", slug(record.name))
    inputs = site.spec.forms["appointment"].inputs
    good = {of: (site.choices(given) or ["Ada Novak"])[0] for of, given in inputs.items()}
    for of in inputs:
        wrong = {**good, of: ""}
        answer = guest.ask(address, wrong)
        assert answer.status == 422
        body = answer.body.decode()
        assert "Please correct the errors below." in body
        assert all(value in body for value in wrong.values())
        assert site.report(guest.state)["sent"] == {}
    assert guest.ask(address, {**good, "time": "03:17"}).status == 422  # not offered
    assert guest.ask(f"{address}/done").status == 404  # nothing was sent
    url, text = guest.follow(address, good)
    assert url == f"{address}/done"
    assert site.report(guest.state)["sent"] == {"appointment": {record.name: good}}
    assert fold(site.reference("appointment", record.name, good)) in text
    assert guest.ask(site.address("appointment", "nobody")).status == 404
    assert guest.ask(site.address("letter", slug(record.name))).status == 404  # it is about no doctor


def test_what_is_saved_can_be_forgotten(visitor: Any) -> None:
    site = made(Bank)
    guest, (one, two) = visitor(site), site.items.records[:2]
    for record in (one, two, one):
        guest.follow(site.path("/~saved"), {"item": slug(record.name)})
    assert site.report(guest.state)["saved"] == {one.name: True, two.name: True}
    guest.follow(site.path("/~saved"), {"item": slug(one.name), "forget": "1"})
    assert site.report(guest.state)["saved"] == {two.name: True}
    assert guest.ask(site.path("/~saved"), {"item": "nothing"}).status == 404


def test_a_cart_adds_up_and_takes_no_odd_numbers(visitor: Any) -> None:
    site = made(Shop)
    guest, (one, two), cart = visitor(site), site.items.records[:2], site.path("/~cart")
    guest.follow(cart, {"item": slug(one.name), "count": "2"})
    _, text = guest.follow(cart, {"item": slug(two.name), "count": "3"})
    assert fold(site.money(2 * site.price(one) + 3 * site.price(two))) in text
    assert site.report(guest.state)["cart"] == {one.name: 2, two.name: 3}
    for form in (
        {"item": slug(one.name), "count": "-1"},
        {"item": slug(one.name), "count": "7"},
        {"count": "1"},
    ):
        assert guest.ask(cart, form).status == 404
    guest.follow(cart, {"item": slug(one.name), "count": "0"})
    assert site.report(guest.state)["cart"] == {two.name: 3}
    assert visitor(made(Clinic)).ask(made(Clinic).path("/~cart")).status == 404  # a clinic has none


def test_an_account_opens_for_its_user_alone(visitor: Any) -> None:
    site = made(Bank)
    guest, place = visitor(site), site.path("/~account")
    balance = site.account_sheet.records[0].fields["balance"].text
    for user, password in ((site.user, "guess-111"), ("nobody", site.password), ("", "")):
        assert guest.ask(place, {"user": user, "password": password}).status == 422
        assert balance not in guest.ask(place).body.decode()
    assert site.report(guest.state)["signed in"] is None
    _, text = guest.follow(place, {"user": site.user, "password": site.password})
    assert fold(balance) in text
    assert site.report(guest.state)["signed in"] == site.user


def test_items_lead_to_groups(visitor: Any) -> None:
    site = made(Shop)
    guest, record = visitor(site), site.items.records[0]
    ((group, related),) = site.related_records(record)
    assert site.group_href(group, related) in guest.links(site.href(record))
    assert site.group_href(group, related) in guest.links(site.directory(group))
    assert guest.ask(site.group_href(group, related)).status == 200
    for nowhere in (f"{site.directory(group)}/nobody", site.path("/~more/{group}", group="nothing")):
        assert guest.ask(nowhere).status == 404


def test_a_task_has_one_cart_and_one_sign_in_at_most() -> None:
    for task in tasks_of(Shop, 20):
        asks = [text for *_, text in task.rubric.facts() if "cart comes" in text or "is signed in" in text]
        assert len(asks) == len(set(asks)), task.id


def test_the_search_suggests_names(visitor: Any) -> None:
    site = made(Lettings)
    name = site.items.records[0].name
    said = visitor(site).ask(f"/suggest?q={name[:6].replace(' ', '+')}").body.decode()
    assert name in said
    assert site.href(site.items.records[0]) in said


# --- what a list proves -----------------------------------------------------------------------------------


def listed_as(layout: str, family: Any = Shop) -> Any:
    return next(site for seed in range(60) if (site := made(family, seed)).look.listing == layout)


def confirms(evidence: Evidence, guest: Any, url: str, *, without: str = "") -> bool:
    if not re.match(evidence.path, url):
        return False
    text = guest.follow(url)[1].replace(fold(without) or "\n", " ")
    return all(says(text, each) for each in evidence.texts)


@pytest.mark.parametrize("layout", ["grid", "rows", "table"])
def test_a_whole_filtered_list_in_any_order_shows_which_item_is_first(layout: str, visitor: Any) -> None:
    site = listed_as(layout)
    guest, rng = visitor(site), random.Random(3)
    options = [[{}, *({each.name: value} for value, _ in each.options)] for each in site.finder.facets]
    queries = [{**one, **two} for lists in combinations(options, 2) for one, two in product(*lists)]
    queries = [dict(each) for each in dict.fromkeys(tuple(each.items()) for each in queries)]
    tried = 0
    for part in (extreme(site, rng, 1) for _ in range(60)):
        if part is None or len(part.facts[0].evidence) == 1:
            continue
        (_, rows), (best,) = part.facts[0].evidence, part.facts[0].answer
        shown = [each for each in queries if confirms(rows, guest, site.finder.link(each, "q", ""))]
        chosen = min(shown, key=len)
        assert part.ask.endswith(f"among those that {_having(site, chosen)}")
        records = site.find(**chosen)
        assert {best, *part.facts[0].wrong} == {record.name for record in records}
        assert all(chosen.items() <= each.items() and site.find(**each) == records for each in shown)
        assert confirms(rows, guest, site.finder.link(chosen, "sort", site.finder.sort.options[1][0]))
        assert not confirms(rows, guest, site.finder.link(chosen, "q", best))  # the first alone
        for record in records:
            assert not confirms(rows, guest, site.finder.link(chosen, "q", ""), without=record.name)
        tried += 1
    assert tried > 5


@pytest.mark.parametrize("layout", ["grid", "rows", "table"])
def test_a_field_may_be_read_in_the_items_own_row_of_the_list(layout: str, visitor: Any) -> None:
    site = listed_as(layout)
    guest, (record, *records) = visitor(site), site.items.records
    other = next(
        each for each in records if all(each.fields[of] != record.fields[of] for of in site.card_fields())
    )
    row, others = (site.finder.link({}, "q", each.name) for each in (record, other))
    for field in site.items.labels:
        own, *views = field_fact(site, record, field).evidence
        assert confirms(own, guest, site.href(record))
        assert len(views) == (field in site.card_fields())
        for view in views:
            value = record.fields[field].text
            assert confirms(view, guest, row)
            assert not confirms(view, guest, others)
            for missing in (record.name, site.items.labels[field], value):
                assert not confirms(view, guest, row, without=missing), missing
            guest.follow(site.path("/~saved"), {"item": slug(record.name)})
            assert not confirms(view, guest, site.path("/~saved"))
            exchanged = Record(other.name, record.fields), Record(record.name, other.fields)
            lines = fold(" ".join(text for each in exchanged for text in row_view(site, each, field)))
            assert not all(says(lines, each) for each in view.texts)


# --- files that do not fit ----------------------------------------------------------------------------------


def beside(folder: Path, text: str) -> str:
    """A module with this specification beside it."""
    (folder / "spec.toml").write_text("\ufeff" + text, encoding="utf-8", errors="surrogateescape")
    (folder / "own_family.py").write_text("")
    return _module(folder / "own_family.py").__name__


def _module(path: Path) -> ModuleType:
    found = spec_from_file_location(path.stem, path)
    assert found is not None
    assert found.loader is not None
    module = module_from_spec(found)
    sys.modules[path.stem] = module
    found.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("low = 12", "low = 120", "price for an hour: low must be less than high"),
        (
            'having = "are of the type {value}"',
            'having = "are small"',
            "having must have the placeholder {value} and no other",
        ),
        ("count = [30, 40]", 'count = [1, 2]\nnaming = { kind = "list", first = ["a", "a"] }', '"a" twice'),
        ("card = true\nleast", "least", "an order needs card, least and most"),
        ('most = "highest"', "", "least and most belong together"),
        ('section = "price"', 'section = "prices"', 'fields.hour: there is no section "prices"'),
        (
            'said = "for {value}"',
            'said = "for a while"',
            '"for a while" must have the placeholder {value} and no other',
        ),
        (
            'ask = "rent the boat {item}"',
            'ask = "rent {boat}"',
            "may have the placeholder {item} and no other",
        ),
        ('kind = "day"', 'kind = "email"', "text inputs must come last"),
        ('noun = "number of seats"', 'nouns = "seats"', "unknown field `nouns` - at `$.fields.seats`"),
        ('"Raft", "Yacht"', '"Raft", "Raft"', "type of boat: an option stands there twice"),
        ('"2 hours", "half', '"1 hour", "half', "Hours: an option stands there twice"),
        ("low = 1\nhigh = 60", 'low = "1"\nhigh = 60', "got `str` - at `$.forms.rent.inputs.day.low`"),
        ('labels = ["Day"]', "labels = [1]", "got `int` - at `$.forms.rent.inputs.day.labels[0]`"),
        ('kind = "money"', 'kind = "gold"', "gold"),
        ("count = [30, 40]", "count = [40, 30]", "count: the smallest number must be at least 3"),
        ("count = [30, 40]", "count = [2, 2]", "count: the smallest number must be at least 3"),
        ("low = 1\nhigh = 60", "low = 60\nhigh = 1", "Day: low must be less than high"),
        ("high = 60", "high = 60_000_000", "Day: high must be at most 36500 days"),
        ('["Take the helm", "A boat for every lake"]', "[]", "`$.taglines`"),
        ("Canoe", "\udcff", "can't decode byte 0xff"),
    ],
)
def test_a_specification_that_does_not_fit_is_refused_by_file_and_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = (EXAMPLE / "spec.toml").read_text()
    assert old in text
    with pytest.raises(SitesError) as refused:
        load_beside(beside(tmp_path, text.replace(old, new, 1)), "spec.toml", Spec)
    assert str(tmp_path / "spec.toml") in refused.value.message
    assert message in refused.value.message


def test_two_kinds_of_pages_do_not_share_a_word(tmp_path: Path) -> None:
    name = beside(tmp_path, (EXAMPLE / "spec.toml").read_text().replace('"b"]', '"cart"]'))
    with pytest.raises(SitesError, match='"cart" stands for two kinds of pages'):
        spec_of(name)


def test_a_family_without_a_specification_says_where_it_should_be(tmp_path: Path) -> None:
    name = beside(tmp_path, "")
    (tmp_path / "spec.toml").unlink()
    with pytest.raises(SitesError, match=r"there is no .*spec\.toml"):
        load_beside(name, "spec.toml", Spec)


# --- in Chromium --------------------------------------------------------------------------------------------


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_the_example_of_the_documentation_is_a_sound_family(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    family = _module(EXAMPLE / "boats.py").Boats
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert await check_family(family, websites=1, tasks_per_website=3) == []
    assert "success 100.0%" in capsys.readouterr().err  # as in a terminal
    # A website that holds nothing of what it is sent is found out.
    monkeypatch.setattr(family, "report", lambda *_: {"sent": {}, "saved": {}})
    faults = await check_family(family, websites=1, tasks_per_website=1)
    assert any("expected success" in fault for fault in faults)


def test_days_are_chosen_in_a_calendar_on_some_websites() -> None:
    ways = set()
    for task in tasks_of(Clinic, 8):
        assert task.truth is not None
        ways.add(any(isinstance(move, Click) and move.name == "Next month" for move in task.truth.moves))
    assert ways == {True, False}


# --- files, charts, maps, sliders, frames ------------------------------------------------------------


def test_chosen_files_are_moved_and_no_others(visitor: Any) -> None:
    site = made(Bank)
    guest, place, (one, two, *_) = visitor(site), site.path("/~files"), site.files
    assert guest.ask(place, {f"file-{slug(one)}": "yes", "folder": "Elsewhere"}).status == 404
    assert site.report(guest.state)["files"] == {}
    folder = next(each for each in site.spec.files.folders if each != site.files[one])
    guest.follow(place, {f"file-{slug(one)}": "yes", "file-nothing": "yes", "folder": folder})
    assert site.report(guest.state)["files"] == {one: folder}
    body = guest.ask(place).body.decode()
    assert re.search(rf"<td>{one}</td><td>{folder}</td>", body)
    assert re.search(rf"<td>{two}</td><td>{site.files[two]}</td>", body)


def test_a_file_that_is_moved_back_counts_as_not_moved(visitor: Any) -> None:
    site = made(Bank)
    guest, place, (one, two, *_) = visitor(site), site.path("/~files"), site.files
    for folder in (*site.spec.files.folders, site.files[one]):
        guest.follow(place, {f"file-{slug(one)}": "yes", "folder": folder})
        assert site.report(guest.state)["files"] == ({} if folder == site.files[one] else {one: folder})
    folder = next(each for each in site.spec.files.folders if each != site.files[two])
    guest.follow(place, {f"file-{slug(two)}": "yes", "folder": folder})
    assert site.report(guest.state)["files"] == {two: folder}


def test_bars_and_pins_tell_nothing_before_they_are_chosen(visitor: Any) -> None:
    site = made(Lettings)
    guest, record = visitor(site), site.items.records[0]
    (value, *_) = site.chart(record).values()
    assert len({each.text for each in site.chart(record).values()}) == len(site.chart(record))
    assert fold(value.text) not in guest.follow(site.href(record))[1].split("click a bar")[0].split()
    _, text = guest.follow(site.path("/~map"))
    assert not any(fold(each.record.name) in text for each in site.pins)


def test_a_section_in_a_frame_stands_there_alone(visitor: Any) -> None:
    site = next(site for seed in range(20) if (site := made(Bank, seed)).framed)
    record = site.items.records[0]
    address = f"{site.href(record)}/in/{site.framed}"
    answer = visitor(site).ask(address)
    for of in site.in_section(site.framed):
        assert str(escape(record.fields[of].text)) in answer.body.decode()
    assert str(escape(record.fields[site.in_section(site.framed)[0]].text)) not in (
        visitor(site).ask(site.href(record)).body.decode()
    )
    assert visitor(site).ask(f"{site.href(record)}/in/nothing").status == 404
