"""The tasks of shops, played without a browser: every move is made on the HTML that the shop sends."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any
from urllib.parse import parse_qsl, unquote, urlencode, urlsplit

import pytest

from webgym.core.task import Task
from webgym.core.text import fold, says
from webgym.core.truth import Choose, Click, Fill, Give, Home, Move, See
from webgym.offline.families.shop import Shop
from webgym.offline.look import look
from webgym.offline.parts import Place, write
from webgym.offline.seeds import number
from webgym.offline.website import Response, State, Visit

SEEDS = 8


def make(index: int) -> Shop:
    seed = number("test", "shop", index)
    brand, label = Shop.christen("Fernhill", seed)
    return Shop(seed=seed, brand=brand, label=label, look=look(seed))


def tasks_of(shop: Shop) -> list[Task]:
    place = Place(shop.label, shop.brand, shop.host, shop.start, shop.domain, shop.subdomain)
    return [task for assignment in shop.assignments() for task in write(place, assignment)]


# --- a visitor without a browser -----------------------------------------------------------------------


@dataclass
class Control:
    """A link, button or field of a page."""

    tag: str
    kind: str
    name: str
    attributes: dict[str, str]
    form: str
    value: str = ""
    options: dict[str, str] = field(default_factory=dict)
    checked: bool = False


class Page(HTMLParser):
    """A page's text, controls and forms; what a closed dialog or section holds counts as text."""

    def __init__(self, url: str, body: bytes) -> None:
        super().__init__()
        self.url = url
        self.controls: list[Control] = []
        self.forms: dict[str, dict[str, str]] = {}
        self._form = ""
        self._open: Control | None = None
        self._option: str | None = None
        self._words: list[str] = []
        self._hidden = 0
        self.feed(body.decode())
        self.text = fold(" ".join(self._words))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        self._hidden += tag in ("script", "style", "title", "select")
        if tag == "form":
            self._form = given.get("id", f"form {len(self.forms)}")
            self.forms[self._form] = given
        elif tag in ("a", "button", "summary", "input", "select", "textarea"):
            control = Control(tag, given.get("type", ""), given.get("aria-label", ""), given,
                              given.get("form", self._form), given.get("value", ""))  # fmt: skip
            control.checked = "checked" in given
            self.controls.append(control)
            if control.kind not in ("checkbox", "hidden") and tag == "input":
                return
            self._open = control
        elif tag == "option" and self._open is not None:
            self._option = given.get("value")
            if self._option is None or "selected" in given or not self._open.options:
                self._open.value = self._option or self._open.value
            self._chosen = "selected" in given

    def handle_endtag(self, tag: str) -> None:
        self._hidden -= tag in ("script", "style", "title", "select")
        if tag == "form":
            self._form = ""
        elif tag in ("a", "button", "summary", "select", "textarea", "label"):
            self._open = None

    def handle_data(self, data: str) -> None:
        text = " ".join(data.split())
        if not self._hidden:
            self._words.append(data)
        if not text or self._open is None:
            return
        if self._open.tag == "select":
            value = text if self._option is None else self._option
            if self._chosen or not self._open.options:
                self._open.value = value
            self._open.options[text] = value
        elif "aria-label" not in self._open.attributes:
            self._open.name = f"{self._open.name} {text}".strip()

    def find(self, tags: set[str], name: str | None, path: str | None = None) -> Control:
        for control in self.controls:
            if control.tag in tags and (name is None or fold(control.name) == fold(name)):
                address = unquote(control.attributes.get("href", ""))
                if path is None or address == unquote(path):
                    return control
        raise AssertionError(f"{self.url} has no {name or path}: {[c.name for c in self.controls]}")


class Visitor:
    """Carries out moves on a website, and remembers every page."""

    def __init__(self, shop: Shop) -> None:
        self.shop = shop
        self.state: State = {}
        self.pages: list[Page] = []
        self.go("/")

    @property
    def page(self) -> Page:
        return self.pages[-1]

    def ask(self, method: str, url: str, form: list[tuple[str, str]] = []) -> Response:  # noqa: B006
        address = urlsplit(url)
        query = parse_qsl(address.query, keep_blank_values=True)
        lists: dict[str, list[str]] = {}
        for key, value in (*query, *form):
            lists.setdefault(key, []).append(value)
        return self.shop.handle(
            Visit(method, unquote(address.path), dict(query), lists, dict(form), self.state)
        )

    def go(self, url: str, method: str = "GET", form: list[tuple[str, str]] = []) -> None:  # noqa: B006
        answer = self.ask(method, url, form)
        while answer.location is not None:
            url = answer.location
            answer = self.ask("GET", url)
        assert answer.status == 200, f"{method} {url} answers {answer.status}"
        self.pages.append(Page(url, answer.body))

    def submit(self, form: str, button: Control | None = None) -> None:
        page = self.page
        fields = [c for c in page.controls if c.form == form and c.attributes.get("name")]
        for control in fields:
            assert control.value or "required" not in control.attributes, f"{control.name} is required"
        sent = [
            (c.attributes["name"], c.value)
            for c in fields
            if (c.tag != "button" or c is button) and (c.kind != "checkbox" or c.checked)
        ]
        action, method = page.forms[form]["action"], page.forms[form].get("method", "get")
        if method == "post":
            self.go(action, "POST", sent)
        else:
            self.go(f"{action}?{urlencode(sent)}")

    def complete(self, form: str) -> bool:
        return all(c.value for c in self.page.controls if c.form == form and "required" in c.attributes)

    def play(self, move: Move) -> None:
        match move:
            case Home():
                self.go("/")
            case See(texts=texts):
                for text in texts:
                    assert says(self.page.text, text), f"{self.page.url} does not show {text!r}"
            case Fill(field=name, text=text):
                control = self.page.find({"input", "textarea"}, name)
                control.value = text
                if control.tag == "input" and self.complete(control.form):
                    self.submit(control.form)
            case Choose(field=name, option=option):
                control = self.page.find({"select"}, name)
                control.value = control.options[option]
                if "data-submit" in control.attributes:
                    self.submit(control.form)
            case Click(name=name, role=role, path=path):
                self.click(name, role, path)
            case _:
                assert isinstance(move, Give)

    def click(self, name: str | None, role: str | None, path: str | None) -> None:
        kinds = {"link": {"a"}, "checkbox": {"input"}, "button": {"button"}}
        control = self.page.find(kinds.get(role or "", {"a", "button", "summary"}), name, path)
        if control.tag == "a":
            self.go(control.attributes["href"])
        elif control.tag == "input":
            control.checked = not control.checked
            if "data-submit" in control.attributes:
                self.submit(control.form)
        elif control.attributes.get("data-do") == "more":
            url, text = self.page.url, self.page.text
            self.go(control.attributes["data-url"])
            self.page.url, self.page.text = url, f"{text} {self.page.text}"
        elif control.tag == "button" and "data-do" not in control.attributes:
            self.submit(control.form, control)


def look_up(state: Any, key: tuple[str, ...]) -> Any:
    for name in key:
        state = state.get(name) if isinstance(state, dict) else None
    return state


# --- tasks -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", range(SEEDS))
def test_every_task_is_solved_by_its_moves(index: int) -> None:
    shop = make(index)
    for task in tasks_of(shop):
        assert task.truth is not None
        if task.parent_id is not None:
            continue  # made of the same parts
        visitor = Visitor(shop)
        for move in task.truth.moves:
            try:
                visitor.play(move)
            except (AssertionError, KeyError) as error:
                raise AssertionError(f"{task.id}: {move}: {error}") from error
        state = shop.report(visitor.state)
        for fact in task.truth.facts:
            where = f"{task.id}: fact {fact.group}.{fact.index}"
            assert any(
                re.match(evidence.path, page.url) and all(says(page.text, text) for text in evidence.texts)
                for page in visitor.pages
                for evidence in fact.evidence
            ), f"{where}: {fact.evidence}"
            for check in fact.state:
                assert look_up(state, check.key) == check.value, where
                assert look_up(shop.report({}), check.key) != check.value, where


@pytest.mark.parametrize("index", range(SEEDS))
def test_answers_say_what_they_must_and_questions_do_not(index: int) -> None:
    for task in tasks_of(make(index)):
        assert task.truth is not None
        given = task.truth.moves[-1]
        assert isinstance(given, Give)
        for options in task.truth.answer.required:
            assert any(says(fold(given.text), option) for option in options), task.id
        for wrong in task.truth.answer.forbidden:
            assert not says(fold(given.text), wrong), task.id
        facts = fold(" ".join(text for _, _, text in task.rubric.facts()))
        for options in task.truth.answer.required:
            in_question = says(fold(task.instruction), options[0])
            assert in_question or len(options[0]) < 3 or not says(facts, options[0]), task.id


@pytest.mark.parametrize("index", range(SEEDS))
def test_the_front_page_alone_proves_nothing(index: int) -> None:
    shop = make(index)
    front = Visitor(shop).page
    for task in tasks_of(shop):
        assert task.truth is not None
        for fact in task.truth.facts:
            for evidence in fact.evidence:
                seen = re.match(evidence.path, "/") and all(says(front.text, text) for text in evidence.texts)
                assert not seen, (task.id, evidence)


def test_tasks_are_many_and_of_all_difficulties() -> None:
    tasks = [task for index in range(SEEDS) for task in tasks_of(make(index))]
    # Brands may repeat between seeds here; on the offline web they do not.
    levels = Counter(task.level for task in tasks)
    assert set(range(1, 9)) <= {task.difficulty for task in tasks}
    assert 0.6 < levels["easy"] / len(tasks) < 0.85
    assert levels["hard"] / len(tasks) > 0.03
    for index in range(SEEDS):
        own = tasks_of(make(index))
        assert len({task.id for task in own}) == len(own)
        assert sum(task.parent_id is None for task in own) >= 15
        assert sum(task.parent_id is not None for task in own) >= 10
