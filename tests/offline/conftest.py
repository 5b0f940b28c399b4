"""A visitor without a browser: asks for pages, follows redirects, plays moves on the HTML that comes."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qsl, unquote, urlencode, urlsplit

import pytest
from markupsafe import escape

from webgym.core.text import fold
from webgym.core.truth import Choose, Click, Fill, Move
from webgym.offline.website import Response, State, Visit, Website


def text_of(answer: Response) -> str:
    body = re.sub(r"(?s)<(script|style)\b.*?</\1>", " ", answer.body.decode())
    return fold(html.unescape(re.sub(r"<[^>]+>", " ", body)))


def links_of(answer: Response) -> set[str]:
    found = re.findall(r'(?:href|src|data-url)="(/[^"]*)"', answer.body.decode())
    return {html.unescape(link) for link in found if not link.startswith("/assets/")}


class Visitor:
    """Somebody on a website.

    Attributes:
        state: what the website remembers of this visitor.
    """

    def __init__(self, site: Website) -> None:
        self.site = site
        self.state: State = {}

    def links(self, url: str) -> set[str]:
        """Where the page at ``url`` leads."""
        return links_of(self.ask(url))

    def ask(self, url: str, form: dict[str, str] | None = None) -> Response:
        """What the website answers to one request; a form is posted."""
        parts = urlsplit(url)
        query = dict(parse_qsl(parts.query, keep_blank_values=True))
        lists = {key: [value] for key, value in {**query, **(form or {})}.items()}
        method = "GET" if form is None else "POST"
        return self.site.handle(Visit(method, unquote(parts.path), query, lists, form or {}, self.state))

    def follow(self, url: str, form: dict[str, str] | None = None) -> tuple[str, str]:
        """Address and text of the page that a request ends at."""
        answer = self.ask(url, form)
        while answer.location is not None:
            url = answer.location
            answer = self.ask(url)
        assert answer.status in (200, 422), (url, answer.status)
        return url, text_of(answer)

    def played(self, moves: tuple[Move, ...]) -> list[tuple[str, str]]:
        """What a browser without scripts would make of the moves: address and text of every page."""
        pages, values = [self.follow("/")], dict[str, str]()
        for move in moves:
            url = pages[-1][0]
            body = self.ask(url).body.decode()
            if isinstance(move, Click) and move.path is not None:
                assert str(escape(move.path)) in body, (url, move.path)
                there, values = self.follow(move.path), {}
            elif isinstance(move, Click):
                there = self._click(url, body, str(escape(move.name or "")), values)
            elif isinstance(move, Choose | Fill):
                there = self._enter(url, body, move, values)
            else:
                continue
            pages.append(there)
        return pages

    def _click(self, url: str, body: str, label: str, values: dict[str, str]) -> tuple[str, str]:
        name = re.escape(label)
        box = re.search(
            rf'<input type="checkbox" name="([^"]+)" value="([^"]+)"[^>]*aria-label="{name}"', body
        )
        if box is not None:
            values[box[1]] = box[2]
            return (
                self._send(url, body, box.start(), values)
                if "data-submit" in opening(body, box.end())
                else (url, "")
            )
        link = re.search(rf'(?:data-url|href)="([^"]+)"[^>]*?(?:aria-label="{name}">|>{name}<)', body)
        if link is not None:
            return self.follow(html.unescape(link[1]))
        button = re.search(rf">{name}</(?:button|summary)>", body)
        assert button is not None, (url, label)
        tag = opening(body, button.start())
        # Tabs, accordions and dialogs hide nothing from somebody who reads HTML.
        if "data-do" in tag or "<summary" in tag:
            return url, ""
        return self._send(url, body, button.start(), values)

    def _enter(self, url: str, body: str, move: Choose | Fill, values: dict[str, str]) -> tuple[str, str]:
        label = re.escape(str(escape(move.field)))
        tag = re.search(rf'<(?:select|input)[^>]*name="([^"]+)"[^>]*aria-label="{label}"[^>]*>', body)
        assert tag is not None, (url, move.field)
        if isinstance(move, Choose):
            options = body[tag.end() : body.index("</select>", tag.end())]
            option = re.search(rf'value="([^"]*)"[^>]*>{re.escape(str(escape(move.option)))}<', options)
            assert option is not None, (url, move.option)
            values[tag[1]] = html.unescape(option[1])
            if "data-submit" not in tag[0]:
                return url, ""
        else:
            values[tag[1]] = move.text
        return self._send(url, body, tag.start(), values)

    def _send(self, url: str, body: str, at: int, values: dict[str, str]) -> tuple[str, str]:
        """Send the form around a place in a page, unless a required field is still empty."""
        start = body.rindex("<form", 0, at)
        form = body[start : body.index("</form>", at)]
        tag = form[: form.index(">")]
        fields = {}
        for control in re.finditer(r"<(input|select)\b([^>]*)>", form):
            name = re.search(r'name="([^"]+)"', control[2])
            assert name is not None
            value = re.search(r'value="([^"]*)"', control[2])
            if control[1] == "select":
                options = form[control.end() : form.index("</select>", control.end())]
                value = re.search(r'value="([^"]*)" selected', options) or re.search(
                    r'value="([^"]*)"', options
                )
            if 'type="checkbox"' not in control[2] or " checked" in control[2]:
                fields[name[1]] = html.unescape(value[1]) if value else ""
            if name[1] in values:
                fields[name[1]] = values[name[1]]
            if " required" in control[2] and not fields.get(name[1]):
                return url, ""
        values.clear()
        action = re.search(r'action="([^"]*)"', tag)
        if 'method="post"' in tag:
            return self.follow(action[1] if action else url, fields)
        return self.follow(f"{action[1] if action else urlsplit(url).path}?{urlencode(fields)}")


def opening(body: str, at: int) -> str:
    """The opening tag that ends at a place in a page or after it."""
    start = body.rindex("<", 0, at)
    return body[start : body.index(">", start)]


@pytest.fixture
def visitor() -> Callable[[Website], Any]:
    """Makes visitors of websites."""
    return Visitor
