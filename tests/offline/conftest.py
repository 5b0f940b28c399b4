"""A visitor without a browser: asks for pages, follows redirects, plays moves on the HTML that comes."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

import pytest

from webgym.core.text import fold
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
        frames = re.findall(r'<iframe src="([^"]+)"', answer.body.decode())
        return url, " ".join(map(text_of, [answer, *map(self.ask, frames)]))


@pytest.fixture
def visitor() -> Callable[[Website], Any]:
    """Makes visitors of websites."""
    return Visitor
