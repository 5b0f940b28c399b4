"""The HTML documents of all pages, with inline style and script.

A Content-Security-Policy allows only the page's own script, by its hash, and no external resources: even if
escaping failed somewhere, hostile text from a page or a reply would not be executed.
"""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import msgspec
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from webgym.core.outcome import Outcome
from webgym.report import charts, formatting

_SCRIPTS = ("dom.js", "theme.js", "list.js", "source.js", "stage.js", "trajectory.js", "main.js")
_PAGE = 100
"""Rows of a page of the list."""
CHUNK = 25
"""Number of trajectories that are compressed together: more take less space, but longer to open."""
_UNSAFE = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("webgym.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(
        charts=charts, formatting=formatting, outcomes=[outcome.value for outcome in Outcome]
    )
    return environment


ENVIRONMENT = _environment()


def inert(value: Any) -> Markup:
    """JSON for a ``<script type="application/json">``, escaped so that it cannot end the element."""
    text = msgspec.json.encode(value).decode()
    for character, escape in _UNSAFE.items():
        text = text.replace(character, escape)
    return Markup(text)  # noqa: S704 - no special characters of HTML are left


def outcome_words() -> dict[str, list[str]]:
    """Name and meaning of every outcome, for scripts."""
    return {
        outcome.value: [formatting.outcome_name(outcome), formatting.outcome_meaning(outcome)]
        for outcome in Outcome
    }


def _static(name: str) -> str:
    return files("webgym.report").joinpath("static", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


class Document:
    """An HTML document with style, script, and a Content-Security-Policy that allows nothing else.

    Args:
        title: of the document.
        scripts: file names in ``static/``, in order; they share one scope.
        settings: the value of ``settings`` in the scripts.
        live: whether scripts may send requests to the server of the document.
    """

    def __init__(self, title: str, scripts: Sequence[str], settings: Any, *, live: bool) -> None:
        code = "\n".join(_static(name) for name in scripts)
        script = f'(() => {{\n"use strict";\n{code}\n}})();'
        style = _static("report.css")
        self.policy = "; ".join(
            (
                "default-src 'none'",
                f"script-src 'sha256-{_hash(script)}'",
                f"style-src 'sha256-{_hash(style)}'",
                "style-src-attr 'unsafe-inline'",
                "img-src 'self' data: file:",
                "connect-src 'self'" if live else "connect-src 'none'",
                "base-uri 'none'",
                "form-action 'none'",
            )
        )
        self._shown: dict[str, Any] = {
            "title": title,
            "settings": inert(settings),
            "style": Markup(style),  # noqa: S704 - our own file
            "script": Markup(script),  # noqa: S704 - our own files
            "policy": self.policy,
        }

    def render(self, template: str, **shown: Any) -> str:
        """Render a template that extends ``base.html.j2``: the document without its end."""
        return ENVIRONMENT.get_template(template).render(self._shown, **shown)

    @staticmethod
    def tail() -> str:
        """The end of the document."""
        return "</body>\n</html>\n"


class Page(Document):
    """The parts of a run's document, in order, so that they can be written one by one.

    Args:
        title: of the document.
        live: whether it is served; otherwise the file contains all data.
        refresh_seconds: polling interval of a served page.
    """

    def __init__(self, title: str, *, live: bool, refresh_seconds: float = 0.0) -> None:
        settings = {
            "live": live,
            "refresh": refresh_seconds,
            "outcomes": outcome_words(),
            "chunk": CHUNK,
            "page": _PAGE,
        }
        super().__init__(title, _SCRIPTS, settings, live=live)
        self._live = live

    def head(self, overview: Markup, rows: Any, *, whole: bool = True, picture: str = "") -> str:
        """Everything up to the data, which browsers display while they read the rest.

        Args:
            overview: the figures as HTML.
            rows: of the table; for a served page, their number and the values of the filters.
            whole: whether the run is finished.
            picture: name of a screenshot in the run folder, by which the page detects that it was moved.
        """
        shown = {"overview": overview, "rows": inert(rows), "live": self._live, "whole": whole}
        return self.render("page.html.j2", picture=picture, **shown)

    @staticmethod
    def data(element_id: str, value: Any) -> str:
        """A script element with JSON data."""
        return f'<script type="application/json" id="{element_id}">{inert(value)}</script>\n'

    @staticmethod
    def chunk(number: int, values: list[Any]) -> str:
        """A script element with compressed trajectories, a sixth of their size; they are unpacked on
        demand."""
        packed = base64.b64encode(zlib.compress(msgspec.json.encode(values))).decode()
        return f'<script type="text/plain" id="c-{number}">{packed}</script>\n'

    @staticmethod
    def picture(name: str, data: str) -> str:
        """A script element with an embedded screenshot."""
        return f'<script type="text/plain" id="p-{name}">{data}</script>\n'
