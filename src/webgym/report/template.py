"""The page around it all: one HTML document, its style and script inside it.

A Content-Security-Policy lets only our own script run, by its hash, and nothing be loaded from outside:
what a hostile page or reply may hold stays text even if we should fail to treat it as such.
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

_SCRIPTS = ("dom.js", "theme.js", "source.js", "table.js", "stage.js", "trajectory.js", "main.js")
CHUNK = 25
"""Trajectories that are packed together: more are smaller, and slower to look into."""
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
    """JSON that may stand inside a ``<script type="application/json">``: it cannot end the element."""
    text = msgspec.json.encode(value).decode()
    for character, escape in _UNSAFE.items():
        text = text.replace(character, escape)
    return Markup(text)  # noqa: S704 - no character that means anything to HTML is left


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
    """What every page has around it: style, script, and the policy that lets nothing else in.

    Args:
        title: of the document.
        scripts: of ``static/``, in order; one scope for all of them.
        settings: what the script finds as ``settings``.
        live: whether it may ask the server that it comes from.
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
        """The document from a template that extends ``base.html.j2``, but for its end."""
        return ENVIRONMENT.get_template(template).render(self._shown, **shown)

    @staticmethod
    def tail() -> str:
        """The end of the document."""
        return "</body>\n</html>\n"


class Page(Document):
    """The parts of a run's document, in order, so that they can be written as they are made.

    Args:
        title: of the document.
        live: whether a server stands behind it; else everything is in the file.
        refresh_seconds: how often a live page asks for what is new.
    """

    def __init__(self, title: str, *, live: bool, refresh_seconds: float = 0.0) -> None:
        settings = {"live": live, "refresh": refresh_seconds, "outcomes": outcome_words(), "chunk": CHUNK}
        super().__init__(title, _SCRIPTS, settings, live=live)
        self._live = live

    def head(self, overview: Markup, rows: Any, *, whole: bool = True, picture: str = "") -> str:
        """Everything up to the data: shown at once, while the rest is still being read.

        Args:
            overview: the figures.
            rows: of the table; of a live page, how many there are and the values of the filters.
            whole: whether nothing more is to come.
            picture: one of those that lie beside the file, by which the page finds out whether it was moved.
        """
        shown = {"overview": overview, "rows": inert(rows), "live": self._live, "whole": whole}
        return self.render("page.html.j2", picture=picture, **shown)

    @staticmethod
    def data(element_id: str, value: Any) -> str:
        """A piece of inert data."""
        return f'<script type="application/json" id="{element_id}">{inert(value)}</script>\n'

    @staticmethod
    def chunk(number: int, values: list[Any]) -> str:
        """Trajectories, packed: a sixth of their size, and unpacked when one of them is looked at."""
        packed = base64.b64encode(zlib.compress(msgspec.json.encode(values))).decode()
        return f'<script type="text/plain" id="c-{number}">{packed}</script>\n'

    @staticmethod
    def picture(name: str, data: str) -> str:
        """An embedded picture, by the name of its screenshot."""
        return f'<script type="text/plain" id="p-{name}">{data}</script>\n'
