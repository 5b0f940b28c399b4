"""Finds evidence that an agent could produce by typing instead of finding it.

Evidence must be the website's own words. Two rules ensure this: no evidence consists only of text that the
solution types, and no page repeats what a visitor typed, outside of the field itself, before the website has
accepted it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from urllib.parse import parse_qsl, unquote, urlencode, urljoin, urlsplit

from webgym.core.task import Task
from webgym.core.text import fold, says
from webgym.core.truth import Fill
from webgym.offline.website import Response, Visit, Website

_TYPED = "zqxvword"
"""A text that does not occur on any page."""

_TEXT_FIELDS = frozenset({"text", "search", "email", "password", "number", "tel", "url"})
_PAGES_OF_A_KIND = 2


def typed_proofs(task: Task) -> Iterator[str]:
    """A message for every evidence that consists of text that the solution types."""
    assert task.truth is not None
    typed = [fold(move.text) for move in task.truth.moves if isinstance(move, Fill)]
    for fact in task.truth.facts:
        for evidence in fact.evidence:
            if evidence.texts and all(any(says(text, wanted) for text in typed) for wanted in evidence.texts):
                quoted = ", ".join(f'"{text}"' for text in evidence.texts)
                yield f"{task.id}: fact {fact.group}.{fact.index} is proven by what an agent types: {quoted}"


def repeating_pages(site: Website) -> Iterator[str]:
    """A message for every form whose response repeats what was typed into it.

    Some pages of every kind are checked. A form that is accepted may redirect to a page with the submitted
    values.
    """
    forms: set[tuple[str, str, tuple[str, ...]]] = set()
    for page in _some_pages(site):
        for form in page.forms:
            shape = (form.method, _kind(form.action), tuple(sorted(form.texts)))
            if not form.texts or shape in forms:
                continue
            forms.add(shape)
            typed = dict.fromkeys(form.texts, _TYPED)
            responses = [_send(site, form, fields) for fields in ({**form.values, **typed}, typed)]
            if any(_TYPED in _Page(form.action, response).text.casefold() for response in responses):
                fields = ", ".join(sorted(form.texts))
                yield f"{site.host}: {form.action} repeats what is typed into {fields}"


def _kind(url: str) -> str:
    """The kind of page of an address: ``/p/12?page=2`` becomes ``/p/*``."""
    _, first, *others = urlsplit(url).path.split("/")
    return f"/{first}" + "/*" * bool(others) + (f"/{others[-1]}" if len(others) > 1 else "")


def _some_pages(site: Website) -> Iterator[_Page]:
    queue, kinds = ["/"], Counter({"/": 1})
    for url in queue:
        page = _Page(url, _request(site, url))
        yield page
        for link in page.links:
            kind = _kind(link)
            if kinds[kind] < _PAGES_OF_A_KIND and link not in queue:
                kinds[kind] += 1
                queue.append(link)


def _request(site: Website, url: str, posted: dict[str, str] | None = None) -> Response:
    """The response to a new visitor; redirects of GET requests are followed."""
    parts = urlsplit(url)
    query = dict(parse_qsl(parts.query, keep_blank_values=True))
    lists = {key: [value] for key, value in {**query, **(posted or {})}.items()}
    method = "GET" if posted is None else "POST"
    response = site.handle(Visit(method, unquote(parts.path), query, lists, posted or {}, {}))
    return _request(site, response.location) if response.location is not None and posted is None else response


def _send(site: Website, form: _Form, fields: dict[str, str]) -> Response:
    if form.method == "post":
        return _request(site, form.action, fields)
    return _request(site, f"{urlsplit(form.action).path}?{urlencode(fields)}")


class _Form:
    """A form: its action and method, default values, and names of text fields."""

    def __init__(self, action: str, method: str) -> None:
        self.action = action
        self.method = method
        self.values: dict[str, str] = {}
        self.texts: set[str] = set()


class _Page(HTMLParser):
    """Links, forms and text of a response, without the values of fields."""

    def __init__(self, url: str, response: Response) -> None:
        super().__init__()
        self.links: list[str] = []
        self.forms: list[_Form] = []
        self._parts: list[str] = []
        self._url = url
        self._silent = 0
        self._select = ""
        if response.media_type.startswith("text/html"):
            self.feed(response.body.decode())
        self.text = " ".join(self._parts)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        if tag in ("script", "style", "title", "textarea"):
            self._silent += 1
        if tag == "a" and attributes.get("href", "").startswith("/"):
            self.links.append(attributes["href"])
        if tag == "form":
            action = urljoin(self._url, attributes.get("action", "") or self._url)
            self.forms.append(_Form(action, attributes.get("method", "get").lower()))
        if self.forms:
            self._field(tag, attributes)

    def _field(self, tag: str, attributes: dict[str, str]) -> None:
        form, name = self.forms[-1], attributes.get("name", "")
        if tag == "textarea" or (tag == "input" and attributes.get("type", "text") in _TEXT_FIELDS):
            form.texts.add(name)
        elif tag == "input" and (
            attributes.get("type") not in ("checkbox", "radio") or "checked" in attributes
        ):
            form.values[name] = attributes.get("value", "")
        elif tag == "select":
            self._select = name
        elif tag == "option" and self._select and not form.values.get(self._select):
            form.values[self._select] = attributes.get("value", "")

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "style", "title", "textarea"):
            self._silent -= 1
        if tag == "select":
            self._select = ""

    def handle_data(self, data: str) -> None:
        if not self._silent:
            self._parts.append(data)
