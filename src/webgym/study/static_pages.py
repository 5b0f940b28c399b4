"""A browser without Chromium for static pages, whose links and buttons have known positions.

It has the same observations and actions as a browser slot, for websites whose elements are positioned by
``left`` and ``top``, such as the small websites. It renders nothing: pages with equal HTML count as equal
screenshots.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import lru_cache
from html.parser import HTMLParser
from typing import NamedTuple
from urllib.parse import SplitResult, parse_qsl, quote, unquote, urljoin, urlsplit

from webgym.core.action import GRID, BrowserAction, GoBack, LeftClick, Navigate, typed_addresses
from webgym.core.errors import ActionFailed, NavigationFailed
from webgym.core.observation import Element, Notice, Observation
from webgym.offline.website import TOP_LEVEL_DOMAIN, Response, State, Visit, Website

_PLACE = re.compile(r"left:(\d+)px;top:(\d+)px")
_SIDE = 32
_REDIRECTS = 5
_URL_CHARACTERS = "/?%:@!$&'()*+,;=~"


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
    """A visitor of websites.

    Args:
        site: the website that is opened first.
        viewport: width and height, CSS pixels.
        find: finds the website of a hostname; by default there is only ``site``.
        url: the address that is opened first; by default the website's start page.

    Attributes:
        states: the state of each website that was visited, by its hostname.
    """

    def __init__(
        self,
        site: Website,
        viewport: tuple[int, int],
        find: Callable[[str], Website | None] | None = None,
        url: str | None = None,
    ) -> None:
        self.states: dict[str, State] = {}
        self._find = find or {site.host: site}.get
        self._viewport = viewport
        self._history: list[str] = []
        self._notices: tuple[Notice, ...] = ()
        self._url = ""
        self._title = ""
        self._response: Response | None = None
        self.act(Navigate(url or site.start))

    @property
    def body(self) -> bytes:
        """The HTML of the current page; empty if it could not be opened."""
        return self._response.body if self._response else b""

    def act(self, action: BrowserAction) -> None:
        """Carry out an action. Actions without effect on a static page are ignored."""
        self._notices = ()
        try:
            if isinstance(action, Navigate):
                self._navigate(action.url)
            elif isinstance(action, GoBack) and len(self._history) > 1:
                self._history.pop()
                self._load(self._history[-1])
            elif isinstance(action, LeftClick) and (hit := self._hit(action)) is not None:
                self._open(urljoin(self._url, hit.href), post=hit.is_post)
        except NavigationFailed as error:
            self._notices = (Notice("navigation_failed", error.message),)
        except ActionFailed as error:
            self._notices = (Notice("action_failed", error.message),)

    def _navigate(self, url: str) -> None:
        addresses = typed_addresses(url)
        if not addresses:
            raise NavigationFailed(f'"{url}" was not opened: only http and https addresses are')
        for address in addresses:
            try:
                self._open(address)
            except NavigationFailed:
                if address == addresses[-1]:
                    raise
            else:
                break

    def _open(self, url: str, *, post: bool = False) -> None:
        try:
            address = _normalized(url).geturl()
        except ValueError as error:
            raise NavigationFailed(f"{url}: Page.navigate: Cannot navigate to invalid URL") from error
        is_reload = not post and address == self._url
        try:
            self._load(address, post=post)
        finally:
            if not is_reload:
                self._history.append(self._url)

    def _load(self, url: str, *, post: bool = False) -> None:
        for _ in range(_REDIRECTS):
            parts = _normalized(urljoin(self._url, url))
            self._url, self._title, self._response = parts.geturl(), "", None
            host = parts.hostname or ""
            if not host.endswith(f".{TOP_LEVEL_DOMAIN}"):
                raise NavigationFailed(f"{self._url}: net::ERR_NAME_NOT_RESOLVED")
            if parts.scheme != "http":
                raise NavigationFailed(f"{self._url}: net::ERR_SSL_PROTOCOL_ERROR")
            self._response = self._request(host, parts, "POST" if post else "GET")
            if self._response.location is None:
                break
            url, post = self._response.location, False

    def _request(self, host: str, parts: SplitResult, method: str) -> Response:
        site = self._find(host)
        if site is None:
            return Response(b"There is no website at this address.", 404)
        self._title = site.brand
        query = dict(parse_qsl(parts.query, keep_blank_values=True))
        lists = {key: [value] for key, value in query.items()}
        state = self.states.setdefault(host, {})
        return site.handle(Visit(method, unquote(parts.path), query, lists, {}, state))

    def _hit(self, action: LeftClick) -> Control | None:
        controls = read_page(self.body).controls
        if (number := action.target.element) is not None:
            if not 1 <= number <= len(controls):
                raise ActionFailed(f"there is no element {number} in the last observation")
            return controls[number - 1]
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
        controls, text, _ = read_page(self.body)
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
            screenshot=hashlib.sha256(self.body).hexdigest(),
            url=self._url,
            title=self._title,
            viewport=self._viewport,
            status=self._response.status if self._response else None,
            scroll=(0.0, float(self._viewport[1])),
            notices=self._notices,
            text=text,
            elements=elements,
        )


def _normalized(url: str) -> SplitResult:
    """An address as a browser writes it.

    Raises:
        ValueError: it is not valid.
    """
    parts = urlsplit(url)
    if not parts.hostname:
        raise ValueError(url)
    path, query = (quote(text, safe=_URL_CHARACTERS) for text in (parts.path or "/", parts.query))
    return parts._replace(netloc=parts.netloc.lower(), path=path, query=query)


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
