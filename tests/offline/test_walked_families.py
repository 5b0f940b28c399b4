"""Websites whose tasks are played without a browser: every move is made on the HTML that the site sends.

The player below knows links, forms, dropdowns and required fields. It is what lets every task of several
websites be proven within seconds; the same tasks run in Chromium elsewhere.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any
from urllib.parse import parse_qsl, unquote, urlencode, urlsplit

import pytest

from webgym.core.task import Task
from webgym.core.truth import Back, Choose, Click, Fill, Give, Home, See
from webgym.offline.families.government import Government
from webgym.offline.families.jobs import Jobs
from webgym.offline.families.recipes import Recipes
from webgym.offline.look import look
from webgym.offline.parts import Place, write
from webgym.offline.seeds import number
from webgym.offline.website import State, Visit, Website

FAMILIES: tuple[type[Website], ...] = (Government, Jobs, Recipes)
SITES = 4


def make(family: type[Website], index: int) -> Website:
    seed = number("walk", family.family, index)
    brand, label = family.christen("Fernhill", seed)
    return family(seed=seed, brand=brand, label=label, look=look(seed))


def tasks_of(site: Website) -> list[Task]:
    place = Place(site.label, site.brand, site.host, site.start, site.domain, site.subdomain)
    return [task for assignment in site.assignments() for task in write(place, assignment)]


@dataclass
class Form:
    action: str
    method: str
    values: dict[str, str] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)
    options: dict[str, dict[str, str]] = field(default_factory=dict)
    required: set[str] = field(default_factory=set)
    sends_itself: set[str] = field(default_factory=set)
    buttons: list[tuple[str, str, str]] = field(default_factory=list)
    texts: set[str] = field(default_factory=set)
    radios: dict[str, tuple[str, str]] = field(default_factory=dict)


class Page(HTMLParser):
    """What a player needs to know of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.forms: list[Form] = []
        self.names: set[str] = set()
        self.parts: list[str] = []
        self.more: list[str] = []
        self._form: Form | None = None
        self._select = ""
        self._option: str | None = None
        self._control: list[str] | None = None
        self._button: dict[str, str | None] = {}
        self._silent = 0
        self.feed(html)
        self.text = " ".join(" ".join(self.parts).split()).casefold()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in ("script", "style", "title", "select"):
            self._silent += 1
        if tag == "a" and given.get("href"):
            self.links.add(given["href"] or "")
        if tag in ("a", "button", "summary"):
            self._control, self._button = [], given
        if given.get("data-do") == "more":
            self.more.append(given["data-url"] or "")
        if tag == "form":
            self._form = Form(given.get("action") or "", given.get("method") or "get")
            self.forms.append(self._form)
        if self._form is None:
            return
        name = given.get("name") or ""
        if tag in ("input", "select") and name:
            if given.get("type") in ("checkbox", "radio"):
                value = given.get("value") or "on"
                if "checked" in given:
                    self._form.values[name] = value
                if given.get("type") == "radio":
                    self._form.radios[(given.get("aria-label") or value).casefold()] = (name, value)
            else:
                self._form.values.setdefault(name, given.get("value") or "")
            self._form.labels[given.get("aria-label") or ""] = name
            if "required" in given:
                self._form.required.add(name)
            if "data-submit" in given:
                self._form.sends_itself.add(name)
            if given.get("type") in ("text", "search", "email", "password", "number", "date"):
                self._form.texts.add(name)
            self._select = name if tag == "select" else ""
        if tag == "option" and self._select:
            self._option = given.get("value") or ""
            if "selected" in given or not self._form.options.get(self._select):
                self._form.values[self._select] = self._option

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "style", "title", "select"):
            self._silent -= 1
        if tag in ("a", "button", "summary") and self._control is not None:
            name = " ".join((self._button.get("aria-label") or " ".join(self._control)).split())
            self.names.add(name.casefold())
            if tag == "button" and self._form is not None and "data-do" not in self._button:
                chosen = (self._button.get("name") or "", self._button.get("value") or "")
                self._form.buttons.append((name.casefold(), *chosen))
            self._control = None
        if tag == "form":
            self._form = None

    def handle_data(self, data: str) -> None:
        if self._option is not None and self._form is not None and data.strip():
            self._form.options.setdefault(self._select, {})[" ".join(data.split())] = self._option
            self._option = None
        if self._control is not None:
            self._control.append(data)
        if not self._silent:
            self.parts.append(data)


class Player:
    """Plays moves on a website and remembers what it saw."""

    def __init__(self, site: Website) -> None:
        self.site = site
        self.state: State = {}
        self.seen: list[tuple[str, str]] = []
        self.history: list[str] = []
        self.open("/")

    def request(self, method: str, url: str, form: dict[str, str]) -> str:
        for _ in range(4):
            parts = urlsplit(url)
            query = parse_qsl(parts.query, keep_blank_values=True)
            lists: dict[str, list[str]] = {}
            for key, value in (*query, *form.items()):
                lists.setdefault(key, []).append(value)
            path = unquote(parts.path)
            answer = self.site.handle(Visit(method, path, dict(query), lists, form, self.state))
            if answer.location is None:
                assert answer.status in (200, 422), f"{method} {url} gives {answer.status}"
                self.url = url
                return answer.body.decode()
            method, url, form = "GET", answer.location, {}
        raise AssertionError(f"{url} redirects forever")

    def show(self, html: str) -> None:
        self.page = Page(html)
        self.seen.append((self.url, self.page.text))

    def open(self, url: str) -> None:
        self.history.append(url)
        self.show(self.request("GET", url, {}))

    def send(self, form: Form, button: tuple[str, str] = ("", "")) -> None:
        for name in form.required:
            assert form.values.get(name), f"{name} is required at {self.url}"
        values = dict(form.values) | ({button[0]: button[1]} if button[0] else {})
        action = form.action or self.url
        if form.method == "post":
            self.show(self.request("POST", action, values))
        else:
            self.open(f"{urlsplit(action).path}?{urlencode(values)}")

    def field(self, label: str) -> tuple[Form, str]:
        for form in self.page.forms:
            if label in form.labels:
                return form, form.labels[label]
        raise AssertionError(f"no field {label!r} at {self.url}")

    def play(self, move: Any) -> None:
        match move:
            case Home():
                self.open("/")
            case Back():
                self.history.pop()
                self.open(self.history.pop())
            case Click(path=str(path)):
                if unquote(self.url) != unquote(path):
                    hrefs = {unquote(link): link for link in self.page.links}
                    assert unquote(path) in hrefs, f"no link to {path} at {self.url}"
                    self.open(path)
            case Click(name=str(name)):
                self.click(name)
            case Fill(field=label, text=text):
                form, name = self.field(label)
                form.values[name] = text
                if all(form.values.get(needed) for needed in form.required):
                    self.send(form)
            case Choose(field=label, option=option):
                form, name = self.field(label)
                assert option in form.options[name], f"{label} at {self.url} has no {option!r}"
                if form.values[name] != form.options[name][option]:
                    form.values[name] = form.options[name][option]
                    if name in form.sends_itself:
                        self.send(form)
            case See(texts=texts):
                for text in texts:
                    assert says(self.page.text, text), f"{text!r} is not at {self.url}"
            case Give():
                pass

    def click(self, name: str) -> None:
        for form in self.page.forms:
            if name.casefold() in form.radios:
                chosen, value = form.radios[name.casefold()]
                form.values[chosen] = value
                return
            for text, *button in form.buttons:
                if text == name.casefold():
                    self.send(form, (button[0], button[1]))
                    return
        if name == "Load more":
            self.seen.append((self.url, Page(self.request("GET", self.page.more[0], {})).text))
            more = Page(self.request("GET", self.page.more[0], {}))
            self.page.text += " " + more.text
            self.page.more, self.page.links = more.more, self.page.links | more.links
            self.url = self.history[-1]
            self.seen.append((self.url, self.page.text))
        elif name.startswith("Page ") or name == "Next":
            links = [link for link in self.page.links if re.search(r"[?&]page=\d+", link)]
            ahead = max(links, key=lambda link: int(re.findall(r"page=(\d+)", link)[0]))
            self.open(ahead)
        else:
            # An Enter before may have sent the form already; tabs and dialogs hide nothing from the player.
            sent = any(name.casefold() in Page(self.request("GET", u, {})).names for u in self.history[-2:])
            assert name.casefold() in self.page.names or sent, f"nothing called {name!r} at {self.url}"


def says(text: str, wanted: str) -> bool:
    inner = re.escape(" ".join(wanted.casefold().split()))
    return re.search(rf"(?<!\w){inner}(?!\w)", text) is not None


def solve(site: Website, task: Task) -> Player:
    assert task.truth is not None
    player = Player(site)
    for move in task.truth.moves:
        player.play(move)
    return player


def held(state: Any, key: tuple[str, ...]) -> Any:
    for part in key:
        state = state.get(part) if isinstance(state, dict) else None
    return state


@pytest.fixture(scope="module", params=[(f, i) for f in FAMILIES for i in range(SITES)], ids=str)
def site(request: pytest.FixtureRequest) -> Website:
    family, index = request.param
    return make(family, index)


def test_every_task_is_solved_by_its_moves_and_shows_every_fact(site: Website) -> None:
    for task in tasks_of(site):
        if task.parent_id is not None:
            continue  # made of the same parts
        try:
            player = solve(site, task)
        except AssertionError as error:
            raise AssertionError(f"{task.id}: {error}") from error
        report = site.report(player.state)
        assert task.truth is not None
        for fact in task.truth.facts:
            place = f"{task.id} fact {fact.group}.{fact.index}"
            assert fact.evidence or fact.state, place
            if fact.evidence:
                assert any(
                    re.match(evidence.path, url) and all(says(text, wanted) for wanted in evidence.texts)
                    for evidence in fact.evidence
                    for url, text in player.seen
                ), f"{place}: {fact.evidence}"
            for check in fact.state:
                assert held(report, check.key) == check.value, place


def test_no_fact_is_shown_by_the_front_page_alone(site: Website) -> None:
    front = Player(site)
    for task in tasks_of(site):
        assert task.truth is not None
        for fact in task.truth.facts:
            assert (
                not all(held(site.report({}), check.key) == check.value for check in fact.state)
                or not fact.state
            )
            for evidence in fact.evidence:
                assert evidence.path
                assert not re.match(evidence.path, front.url), task.id


def test_the_given_answer_is_accepted_and_nothing_forbidden_is_in_it(site: Website) -> None:
    for task in tasks_of(site):
        assert task.truth is not None
        given = task.truth.moves[-1]
        assert isinstance(given, Give)
        text = " ".join(given.text.casefold().split())
        for options in task.truth.answer.required:
            assert any(says(text, option) for option in options), (task.id, options)
        for wrong in task.truth.answer.forbidden:
            assert not says(text, wrong), (task.id, wrong)


def test_tasks_have_unique_ids_and_a_spread_of_difficulties(site: Website) -> None:
    tasks = tasks_of(site)
    assert len({task.id for task in tasks}) == len(tasks)
    assert len({task.instruction for task in tasks}) == len(tasks)
    levels = Counter(task.level for task in tasks)
    assert len([task for task in tasks if task.parent_id is None]) >= 8
    assert len([task for task in tasks if task.parent_id is not None]) >= 12
    assert levels["easy"] / len(tasks) > 0.6
    assert levels["medium"]
    assert levels["hard"]


def test_rubrics_do_not_give_the_answer_away(site: Website) -> None:
    for task in tasks_of(site):
        assert task.truth is not None
        told = " ".join(task.instruction.casefold().split())
        for options in task.truth.answer.required:
            for _, _, fact in task.rubric.facts():
                if not says(told, options[0]) and not options[0].isdigit():
                    assert not says(fact.casefold(), options[0]), (task.id, options[0])


def crawl(site: Website, limit: int) -> Iterator[tuple[str, bytes]]:
    seen, ahead = {"/"}, ["/"]
    for _ in range(limit):
        if not ahead:
            return
        url = ahead.pop(0)
        parts = urlsplit(url)
        query = dict(parse_qsl(parts.query))
        answer = site.handle(Visit("GET", unquote(parts.path), query, {}, {}, {}))
        assert answer.status in (200, 303), f"{url} gives {answer.status}"
        yield url, answer.body
        for link in sorted(Page(answer.body.decode()).links if answer.status == 200 else ()):
            if link.startswith("/") and link not in seen:
                seen.add(link)
                ahead.append(link)


def test_every_link_leads_somewhere_and_the_same_seed_gives_the_same_bytes(site: Website) -> None:
    again = type(site)(seed=site.seed, brand=site.brand, label=site.label, look=site.look)
    pages = dict(crawl(site, 90))
    assert len(pages) > 30
    assert pages == dict(crawl(again, 90))


def test_websites_of_a_family_differ() -> None:
    for family in FAMILIES:
        fronts = {
            make(family, index).handle(Visit("GET", "/", {}, {}, {}, {})).body for index in range(SITES)
        }
        assert len(fronts) == SITES
