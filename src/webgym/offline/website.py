"""The base class of websites of the offline web: hostname, look, pages, and a state per visitor.

A website is a pure function of (seed, visitor's state, request): it does not use the clock or the operating
system, so the same seed gives the same bytes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from functools import cached_property, lru_cache
from itertools import chain
from typing import Any, ClassVar, Final, Literal, TypeAlias, TypeVar
from urllib.parse import quote, urlencode

import jinja2

from webgym.offline.look import Look, draw
from webgym.offline.parts import Assignment, Expected
from webgym.offline.seeds import pick

Split: TypeAlias = Literal["train", "test"]

State: TypeAlias = dict[str, Any]
"""The state of a website for a visitor: JSON values only."""

TODAY = date(2026, 5, 11)
"""The current date on the offline web (a Monday), independent of the clock."""

TOP_LEVEL_DOMAIN = "webgym.test"

Behaviour: TypeAlias = Literal["good", "blocks", "down", "slow", "nags", "forgets"]
"""The behaviour of a website.

``good``: works; ``blocks``: a bot challenge that cannot be passed; ``down``: its hostname does not resolve;
``slow``: every page takes seconds; ``nags``: popups and dialogs; ``forgets``: its server loses the visitors'
state.
"""


@dataclass(frozen=True)
class Visit:
    """A request, as passed to page functions.

    Attributes:
        method: ``GET`` or ``POST``.
        path: decoded path.
        query: query parameters; the last value of a repeated key.
        lists: all values of every query parameter or form field, in order.
        form: form fields; empty for ``GET``.
        state: the website's state for this visitor, which pages may modify.
    """

    method: str
    path: str
    query: Mapping[str, str]
    lists: Mapping[str, list[str]]
    form: Mapping[str, str]
    state: State

    def url(self, **changes: object) -> str:
        """This page's path with some query parameters changed; ``None`` or ``""`` removes one."""
        query = {k: v for k, v in self.query.items() if k not in changes}
        query |= {k: str(v) for k, v in changes.items() if v not in (None, "")}
        return f"{quote(self.path)}?{urlencode(query)}" if query else quote(self.path)


@dataclass(frozen=True)
class Response:
    """The response of a page function."""

    body: bytes
    status: int = 200
    media_type: str = "text/html; charset=utf-8"
    location: str | None = None


def redirect(to: str) -> Response:
    """A redirect with status 303, the response to an accepted form."""
    return Response(b"", status=303, location=to)


def json_response(value: object, status: int = 200) -> Response:
    """A JSON response, for scripts of pages."""
    return Response(json.dumps(value).encode(), status, "application/json")


_LONG_NUMBER: Final = re.compile(r"\d{100}")
"""Requests with such numbers are refused: no page needs them, and Python does not parse thousands of
digits."""

PageFunction: TypeAlias = Callable[..., Response]
F = TypeVar("F", bound=PageFunction)


def page(pattern: str, *, method: str = "GET") -> Callable[[F], F]:
    """Mark a method of a website as the page at ``pattern``.

    ``{name}`` matches one path segment, which is passed as an argument. ``~name`` stands for the website's
    own word (see :attr:`Website.paths`), so that addresses differ between websites.
    """

    def mark(function: F) -> F:
        function.__dict__.setdefault("routes", []).append((method, pattern))
        return function

    return mark


@dataclass(frozen=True)
class Route:
    """An HTTP method, a pattern of paths, and the name of the page function."""

    method: str
    pattern: str
    function: str


@lru_cache(maxsize=1)
def _templates() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("webgym.offline"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["shortday"] = lambda value: f"{value.day} {value:%b %Y}"
    environment.filters["slug"] = slug
    return environment


@lru_cache(maxsize=1 << 16)  # called for every item when lists are filtered
def slug(text: str) -> str:
    """``text`` as a part of an address: ``"Blue Mug, 0.3 l"`` becomes ``"blue-mug-0-3-l"``."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


@dataclass
class Website:
    """Base class of all families.

    A family overrides :meth:`build` (generates its contents from ``self.seed``), :meth:`menu`, :meth:`report`
    and :meth:`assignments`, and marks its pages with :func:`page`.

    Attributes:
        seed: determines everything about the website.
        brand: its name, shown in the header.
        label: first part of its hostname.
        look: palette, fonts and layout.
        behaviour: whether and how it misbehaves.
        split: of its tasks.
        domain, subdomain: of the Mind2Web-2 taxonomy; set by :meth:`build`.
        tagline: slogan; set by :meth:`build`.
    """

    family: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]] = ("Online",)
    """Second words of brands."""
    routes: ClassVar[tuple[Route, ...]] = ()
    words: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """For every ``~name`` in a pattern, the words of which each website uses one."""

    seed: int
    brand: str
    label: str
    look: Look
    behaviour: Behaviour = "good"
    split: Split = "train"
    domain: str = field(default="", init=False)
    subdomain: str = field(default="", init=False)
    tagline: str = field(default="", init=False)
    paths: dict[str, str] = field(default_factory=dict, init=False)
    """This website's word for every ``~name``."""

    def __init_subclass__(cls) -> None:
        routes = [
            Route(method, pattern, name)
            for name in dir(cls)
            for method, pattern in getattr(getattr(cls, name), "routes", ())
            if callable(getattr(cls, name))
        ]
        # Patterns with fewer placeholders are more specific and are tried first.
        cls.routes = tuple(sorted(routes, key=lambda route: (route.pattern.count("{"), route.pattern)))

    def __post_init__(self) -> None:
        self.paths = {name: pick(options, self.seed, "path", name) for name, options in self.words.items()}
        self.build()

    # --- overridden by families -----------------------------------------------------------

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """Brand and hostname label of a new website: ``("Fernhill Books", "fernhill-books")``."""
        brand = f"{stem} {pick(cls.suffixes, seed, 'brand')}"
        return brand, slug(brand)

    @staticmethod
    def host_of(label: str) -> str:
        """The hostname for a label."""
        return f"{label}.{TOP_LEVEL_DOMAIN}"

    def build(self) -> None:
        """Generate the contents, and set domain, subdomain and tagline."""
        raise NotImplementedError

    def menu(self) -> list[tuple[str, str]]:
        """The main navigation: (text, path)."""
        return []

    def report(self, state: State) -> dict[str, Any]:
        """The state for a visitor, in the structure that :class:`StateCheck` refers to."""
        del state
        return {}

    def assignments(self) -> Iterable[Assignment]:
        """The tasks of this website, before decomposition."""
        return ()

    def expected_assignments(self) -> Iterable[Assignment]:
        """The tasks, with the expected end of a correct attempt on a website with this behaviour."""
        ends: dict[Behaviour, Expected] = {
            "blocks": "blocked",
            "down": "environment_error",
            "forgets": "judge_error",
        }
        for assignment in self.assignments():
            needs_state = any(fact.state for part in assignment.parts for fact in part.facts)
            if self.behaviour == "forgets" and not needs_state:
                continue
            yield replace(assignment, expects=ends.get(self.behaviour, "success"))

    # --- common to all websites -------------------------------------------------------------------

    @property
    def host(self) -> str:
        """The hostname."""
        return self.host_of(self.label)

    @property
    def start(self) -> str:
        """The URL of the front page."""
        return f"http://{self.host}/"

    def path(self, pattern: str, **values: object) -> str:
        """The address of a page of this website: ``path("/~product/{slug}", slug="blue-mug")``."""
        filled = re.sub(r"~(\w+)", lambda match: self.paths[match[1]], pattern)
        return re.sub(r"\{(\w+)\}", lambda match: quote(str(values[match[1]]), safe=""), filled)

    @cached_property
    def _compiled(self) -> list[tuple[str, re.Pattern[str], str]]:
        def regex(pattern: str) -> re.Pattern[str]:
            own = re.sub(r"~(\w+)", lambda match: self.paths[match[1]], pattern)
            parts = re.split(r"\{(\w+)\}", own)
            names = [f"(?P<{part}>[^/]+)" if i % 2 else re.escape(part) for i, part in enumerate(parts)]
            return re.compile("".join(names))

        return [(route.method, regex(route.pattern), route.function) for route in self.routes]

    def handle(self, visit: Visit) -> Response:
        """The response to a request."""
        values = (visit.path, *visit.query.values(), *visit.form.values(), *chain(*visit.lists.values()))
        if any(map(_LONG_NUMBER.search, values)):
            return self.missing(visit, 400)
        if self.behaviour == "blocks":
            return self.render("challenge.html", visit, status=403)
        allowed = False
        for method, regex, function in self._compiled:
            match = regex.fullmatch(visit.path)
            if match is None:
                continue
            if method == visit.method:
                response: Response = getattr(self, function)(visit, **match.groupdict())
                return response
            allowed = True
        if allowed:
            return self.missing(visit, 405)
        return self.missing(visit)

    def missing(self, visit: Visit, status: int = 404) -> Response:
        """The error page for an address without a page."""
        return self.render("missing.html", visit, status=status)

    def render(self, template: str, visit: Visit, *, status: int = 200, **values: object) -> Response:
        """Render a template; ``site``, ``visit``, ``look``, ``today`` and ``url`` are defined in it."""
        text = (
            _templates()
            .get_template(template)
            .render(site=self, visit=visit, look=self.look, today=TODAY, url=self.path, **values)
        )
        return Response(text.encode(), status)

    # --- pages of all websites ----------------------------------------------------------------

    @page("/picture/{kind}/{name}")
    def picture(self, visit: Visit, kind: str, name: str) -> Response:
        """An illustration, seeded by ``name``."""
        del visit
        drawn = draw(kind, name.removesuffix(".svg"), self.look)
        return Response(drawn.encode(), media_type="image/svg+xml")

    @page("/consent", method="POST")
    def consent(self, visit: Visit) -> Response:
        """Store the choice of the cookie banner, which is removed by the page's script."""
        visit.state["consent"] = visit.form.get("choice", "necessary")
        return Response(b"", status=204)

    def picture_url(self, kind: str, name: str) -> str:
        """The address of an illustration."""
        return f"/picture/{kind}/{quote(name, safe='')}.svg"
