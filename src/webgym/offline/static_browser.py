"""A browser without Chromium for static pages, whose links and buttons have known positions.

It has the same observations and actions as a browser slot, for websites whose elements are positioned by
``left`` and ``top``, such as the small websites. It renders nothing: pages with equal HTML count as equal
screenshots.
"""

from __future__ import annotations

import hashlib
import re
from functools import lru_cache
from html.parser import HTMLParser
from typing import NamedTuple
from urllib.parse import parse_qsl, unquote, urljoin, urlsplit

from webgym.core.action import GRID, BrowserAction, GoBack, LeftClick
from webgym.core.observation import Element, Observation
from webgym.offline.website import Response, State, Visit, Website

_PLACE = re.compile(r"left:(\d+)px;top:(\d+)px")
_SIDE = 32
_REDIRECTS = 5


class Control(NamedTuple):
    """An element that can be clicked: role, accessible name, box in CSS pixels, and target."""

    role: str
    name: str
    box: tuple[int, int, int, int]
    href: str
    is_post: bool


class Page(NamedTuple):
    """The contents of a page.

    Attributes:
        controls: elements that can be clicked.
        text: visible text, one line per element.
        signs: names of all visible signs, with their upper left corners, CSS pixels.
    """

    controls: tuple[Control, ...]
    text: str
    signs: tuple[tuple[str, tuple[int, int]], ...]


class StaticBrowser:
    """A visitor of one website.

    Args:
        site: the website.
        viewport: width and height, CSS pixels.

    Attributes:
        state: the website's state for this visitor.
    """

    def __init__(self, site: Website, viewport: tuple[int, int]) -> None:
        self.site = site
        self.state: State = {}
        self._viewport = viewport
        self._history: list[str] = []
        self._url = site.start
        self._response = Response(b"")
        self.open(site.start)

    @property
    def body(self) -> bytes:
        """The HTML of the current page."""
        return self._response.body

    def open(self, url: str, *, post: bool = False) -> None:
        """Go to an address of the website."""
        for _ in range(_REDIRECTS):
            parts = urlsplit(urljoin(self._url, url))
            query = dict(parse_qsl(parts.query, keep_blank_values=True))
            lists = {key: [value] for key, value in query.items()}
            method = "POST" if post else "GET"
            visit = Visit(method, unquote(parts.path), query, lists, {}, self.state)
            self._response = self.site.handle(visit)
            self._url = parts.geturl()
            if self._response.location is None:
                break
            url, post = self._response.location, False
        self._history.append(self._url)

    def act(self, action: BrowserAction) -> None:
        """Carry out an action. Actions without effect on a static page are ignored."""
        if isinstance(action, GoBack) and len(self._history) > 1:
            self._history.pop()
            self.open(self._history.pop())
        elif isinstance(action, LeftClick):
            hit = self._hit(action)
            if hit is not None:
                self.open(hit.href, post=hit.is_post)

    def _hit(self, action: LeftClick) -> Control | None:
        controls = read_page(self._response.body).controls
        if action.target.element is not None:
            return controls[action.target.element - 1]
        assert action.target.coordinate is not None
        at = [
            share / GRID * size for share, size in zip(action.target.coordinate, self._viewport, strict=True)
        ]
        inside = (
            control
            for control in controls
            if control.box[0] <= at[0] < control.box[0] + control.box[2]
            and control.box[1] <= at[1] < control.box[1] + control.box[3]
        )
        return next(inside, None)

    def observe(self) -> Observation:
        """The observation of the current page."""
        controls, text, _ = read_page(self._response.body)
        elements = tuple(
            Element(
                number=number,
                role=control.role,
                name=control.name,
                box=tuple(map(float, control.box)),  # type: ignore[arg-type]
                href=None if control.is_post else urljoin(self._url, control.href),
            )
            for number, control in enumerate(controls, start=1)
        )
        return Observation(
            screenshot=hashlib.sha256(self._response.body).hexdigest(),
            url=self._url,
            title=self.site.brand,
            viewport=self._viewport,
            status=self._response.status,
            scroll=(0.0, float(self._viewport[1])),
            text=text,
            elements=elements,
        )


@lru_cache(maxsize=4096)
def read_page(body: bytes) -> Page:
    """Parse a page of a small website."""
    reader = _Reader()
    reader.feed(body.decode())
    return Page(tuple(reader.controls), "\n".join(reader.lines), tuple(reader.signs))


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.controls: list[Control] = []
        self.lines: list[str] = []
        self.signs: list[tuple[str, tuple[int, int]]] = []
        self._action = ""
        self._silent = False
        self._place: tuple[int, int] | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        self._silent = tag in ("style", "title")
        if tag == "form":
            self._action = attributes["action"]
        if (position := _PLACE.search(attributes.get("style", ""))) is not None:
            place = int(position[1]), int(position[2])
            self._place = None if "aria-label" in attributes else place
            if "aria-label" in attributes:
                self.signs.append((attributes["aria-label"], place))
        if tag in ("a", "button"):
            assert position is not None, attributes
            is_link = tag == "a"
            href = attributes["href"] if is_link else self._action
            role = "link" if is_link else "button"
            box = (*place, _SIDE, _SIDE)
            self.controls.append(Control(role, attributes["aria-label"], box, href, not is_link))

    def handle_endtag(self, tag: str) -> None:
        del tag
        self._silent = False

    def handle_data(self, data: str) -> None:
        if data.strip() and not self._silent:
            self.lines.append(data.strip())
            if self._place is not None:
                self.signs.append((data.strip(), self._place))
                self._place = None
