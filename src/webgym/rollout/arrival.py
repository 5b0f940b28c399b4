"""What the environment finds at a website's start page, before the agent acts.

Whether a website refuses, is dead or wants an account is its own state and no agent's doing. Status, errors
of the network and types of form fields say most of it; names and words say which pages are parked or do not
serve this region (``dead_pages.toml``). Consent and pay walls are pages like others: the agent's business.
"""

from __future__ import annotations

import tomllib
from functools import cache
from http import HTTPStatus
from importlib.resources import files
from typing import Any, Final, Literal, NamedTuple
from urllib.parse import urlsplit

from webgym.core.observation import Observation
from webgym.core.text import fold
from webgym.core.trajectory import DeadCode
from webgym.core.websites import host_or_text, site_or_text
from webgym.judge.blocking import refusal_of

_GONE: Final = frozenset({"ERR_NAME_NOT_RESOLVED"})
_TLS: Final = ("ERR_SSL_", "ERR_CERT_", "ERR_BAD_SSL_")
_SILENT: Final = (
    *(
        "ERR_CONNECTION_",
        "ERR_TIMED_OUT",
        "ERR_EMPTY_RESPONSE",
        "ERR_ADDRESS_UNREACHABLE",
        "ERR_DNS_TIMED_OUT",
    ),
    *("ERR_NAME_RESOLUTION_FAILED", "ERR_INVALID_HTTP_RESPONSE", "ERR_HTTP2_", "ERR_TOO_MANY_REDIRECTS"),
    *("ERR_CONTENT_LENGTH_MISMATCH", "ERR_INCOMPLETE_CHUNKED", "ERR_RESPONSE_HEADERS_"),
)
"""Beginnings of Chromium's names of errors. Others, such as of a machine without a network, are our own."""

_NOTICE_CHARS: Final = 600
"""Longest page that is nothing but a notice, characters."""


class Finding(NamedTuple):
    """What one look at the start page shows.

    Attributes:
        is_refused: whether it is a refusal.
        dead: why there is no page; empty if there is one, or if the reason may be our own.
        why: what is wrong, for people; empty if nothing is.
    """

    is_refused: bool = False
    dead: DeadCode | Literal[""] = ""
    why: str = ""

    @property
    def is_open(self) -> bool:
        """Whether the agent may begin."""
        return not self.why

    @property
    def state(self) -> Literal["open", "refused", "dead"] | None:
        """The website's state; ``None`` if the failure may be our own."""
        if self.is_refused:
            return "refused"
        return "open" if self.is_open else "dead" if self.dead else None

    @property
    def is_of_page(self) -> bool:
        """Whether a page says so, and not a failed connection."""
        return self.is_refused or self.is_lasting or self.dead == "server_error"

    @property
    def is_lasting(self) -> bool:
        """Whether another look would show the same."""
        return self.dead in ("region", "parked")


def finding_of(url: str, seen: Observation) -> Finding:
    """What a start page that came shows.

    Args:
        url: the address that was asked for.
        seen: the page.
    """
    words, text = _words(), fold(f"{seen.title} {seen.text or ''}")
    status, is_notice = seen.status or 0, len(text) <= _NOTICE_CHARS

    def said(kind: str) -> str:
        return next((f'"{word}"' for word in words[kind] if is_notice and word in text), "")

    is_region = status == HTTPStatus.UNAVAILABLE_FOR_LEGAL_REASONS
    if why := f"status {status}" if is_region else said("region"):
        return Finding(dead="region", why=why)
    if why := refusal_of(seen):
        return Finding(is_refused=True, why=why)
    if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        return Finding(dead="server_error", why=f"status {status}")
    parking = {site_or_text(host) for host in (seen.url, *seen.bytes)}.intersection(words["parking_sites"])
    is_parked = parking and site_or_text(url) not in parking
    if why := f"it is parked at {min(parking)}" if is_parked else said("parked"):
        return Finding(dead="parked", why=why)
    return Finding()


def dead_by_error(error: str) -> DeadCode | Literal[""]:
    """Why a start page did not come; empty if that says nothing about its website.

    Args:
        error: Chromium's name of the error of the network.
    """
    if error in _GONE:
        return "name_gone"
    if error.startswith(_TLS):
        return "tls"
    return "no_answer" if error.startswith(_SILENT) else ""


def has_login_wall(url: str, seen: Observation) -> bool:
    """Whether a start page asks for an account: by status, or because it leads to a form for a log-in."""
    is_elsewhere = _place(url) != _place(seen.url)
    return seen.status == HTTPStatus.UNAUTHORIZED or (seen.has_login and is_elsewhere)


def _place(url: str) -> tuple[str, str]:
    return host_or_text(url), urlsplit(url).path.rstrip("/")


@cache
def _words() -> dict[str, Any]:
    return tomllib.loads(files("webgym.rollout").joinpath("dead_pages.toml").read_text())
