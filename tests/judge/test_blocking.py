"""Which pages keep robots out, by rule."""

from __future__ import annotations

from typing import Any

import pytest

from webgym.core.observation import Observation
from webgym.judge.blocking import GUARDS, find_block


def look(text: str | None = "", **more: Any) -> Observation:
    fields: dict[str, Any] = {"url": "https://shop.example/", "title": "Shop", "status": 200}
    return Observation(screenshot="0" * 64, viewport=(1280, 768), text=text, **fields | more)


FINE = look("Welcome. Red Mug $9.00")

BLOCKED = [
    look("Verify you are human", status=403),
    look("Verifying you are human. This may take a few seconds.", title="Just a moment..."),
    look("Enable JavaScript and cookies to continue", title="Just a moment...", status=503),
    look("Sorry, you have been blocked. Cloudflare Ray ID: 8a", title="Attention Required! | Cloudflare"),
    look("", url="https://shop.example/?__cf_chl_rt_tk=abc"),
    look("", url="https://geo.captcha-delivery.com/captcha/?x=1"),
    look("Please enable JS and disable any ad blocker", status=403),
    look(
        "Press & Hold to confirm you are a human (and not a bot).",
        title="Access to this page has been denied",
    ),
    look(
        "You don't have permission to access this page on this server. Reference #18.1f",
        title="Access Denied",
        status=403,
    ),
    look(None, title="Access Denied", status=403),
    look("", url="https://www.google.com/sorry/index?continue=x", status=429),
    look(
        "As you were browsing something about your browser made us think you were a bot.",
        title="Pardon Our Interruption",
    ),
    look("Request unsuccessful. Incapsula incident ID: 12-34"),
    look("Let's confirm you are human. Begin", title="Human Verification", status=405),
    look("Too many requests", status=429),
    look("I'm not a robot. Complete the CAPTCHA to go on."),
]

NOT_BLOCKED = [
    FINE,
    look("404 Not Found", status=404),
    look("Page not found. Access denied is not what this says.", status=404),
    look("Internal Server Error", status=500),
    look("504 Gateway Time-out", status=504),
    look("No results found", status=200),
    look("Please log in to go on", status=401, title="Log in"),
    look("We use cookies. Accept all?"),
    look("How websites ask: are you a robot? An article."),
    look(
        "Are you a robot? I'm not a robot. "
        + "An article about how websites tell people from programs. " * 60
    ),
    look("Loading..."),
    look(None, title=""),
    look("Down for maintenance", status=503),
]


@pytest.mark.parametrize("page", BLOCKED)
def test_challenges_are_known(page: Observation) -> None:
    found = find_block([FINE, page])
    assert found.passed, page
    assert found.steps == (1,)


@pytest.mark.parametrize("page", NOT_BLOCKED)
def test_other_pages_are_none(page: Observation) -> None:
    assert not find_block([FINE, page]).passed, page


def test_a_refusal_that_persists_is_blocking() -> None:
    forbidden = look("Forbidden", status=403)
    assert find_block([FINE, forbidden, forbidden]).steps == (1, 2)
    assert not find_block([forbidden, FINE]).passed
    assert not find_block([forbidden]).passed
    assert find_block([look("", status=429), forbidden]).passed


@pytest.mark.parametrize("page", BLOCKED)
def test_a_challenge_that_was_left_behind_is_none(page: Observation) -> None:
    assert not find_block([page, FINE]).passed
    assert not find_block([]).passed


def test_guards_are_written_folded() -> None:
    for guard in GUARDS:
        assert all(text == text.casefold() for text in (*guard.titles, *guard.words))
