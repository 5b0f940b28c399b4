"""Which pages keep robots out, and when that excuses an attempt, by rule."""

from __future__ import annotations

import hashlib
from typing import Any

import msgspec
import pytest

from webgym.core.action import Action, Answer, GoBack, LeftClick, Navigate, Scroll, Target, Type, Wait
from webgym.core.observation import Element, Notice, Observation
from webgym.core.outcome import Ending
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode, Reply, Step
from webgym.core.verdict import Judgement
from webgym.judge.blocking import GUARDS, blocking_host, challenge, find_block


def look(text: str | None = "", **more: Any) -> Observation:
    fields: dict[str, Any] = {"url": "https://shop.example/", "title": "Shop", "status": 200}
    name = hashlib.sha256(repr((text, more)).encode()).hexdigest()
    return Observation(screenshot=name, viewport=(1280, 768), text=text, **fields | more)


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
    # Forms with a CAPTCHA in them: a sign-up, a search of a library, by words and by fields.
    look("Create an account. E-mail. Password. I'm not a robot. Please complete the CAPTCHA.", title="Join"),
    look(
        "Reserve a room. I'm not a robot. Please complete the CAPTCHA.",
        elements=tuple(
            Element(number, "textbox", name, (0, 0, 9, 9))
            for number, name in enumerate(("Name", "Guests"), 1)
        ),
    ),
    look("Log in to see this page. Access denied", status=401),
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


HOME = "https://shop.example/"
ITEM = "https://shop.example/p/1"
ENGINE = "https://search.example/?q=mug"
CLICK = LeftClick(Target(coordinate=(500, 500)))
SEARCH = Type(Target(coordinate=(500, 100)), "mug")
WAIT = Wait(5)

TASK = Task(
    id="shop/mug",
    instruction="What does the Red Mug cost?",
    website=HOME,
    domain="Lifestyle & Leisure",
    subdomain="Shopping",
    rubric=Rubric((FactGroup(1, "The mug", ("its price is found",)),)),
    source="made-up",
)


def wall(url: str = HOME, **more: Any) -> Observation:
    """A challenge at this address."""
    return look("Verify you are human", url=url, title="Just a moment...", **{"status": 403} | more)


def page(url: str = HOME, text: str = "Welcome. Red Mug $9.00", **more: Any) -> Observation:
    return look(text, url=url, **more)


def trip(*turns: Observation | tuple[Action, Observation], answer: str | None = None) -> Episode:
    """An attempt: the first page, then what was done and the page that followed."""
    looks = [turn if isinstance(turn, Observation) else turn[1] for turn in turns]
    acts: list[Action] = [turn[0] for turn in turns if isinstance(turn, tuple)]
    last: tuple[Action, ...] = () if answer is None else (Answer(answer),)
    steps = tuple(
        Step(index, looks[index], (), Reply("...", "test"), action)
        for index, action in enumerate((*acts, *last))
    )
    ending = Ending.BUDGET_SPENT if answer is None else Ending.ANSWERED
    final = looks[-1] if answer is None else None
    return Episode("shop/mug#0.0", TASK.id, 0, 0, 1, "test", 0.0, 1.0, steps, ending, final, answer)


AGAIN = (Navigate(HOME), wall())


@pytest.mark.parametrize("page", BLOCKED)
def test_challenges_are_known(page: Observation) -> None:
    assert challenge(page), page


@pytest.mark.parametrize("page", NOT_BLOCKED)
def test_other_pages_are_none(page: Observation) -> None:
    assert not challenge(page), page


ANSWER = "The Red Mug costs $12."

KEPT_OUT = {
    "never let in, answered": trip(wall(), AGAIN, answer=ANSWER),
    "never let in, gave up": trip(wall(), AGAIN),
    "never let in anywhere": trip(wall(), (Navigate(ITEM), wall(ITEM)), (WAIT, wall(ITEM))),
    "without a challenge's words": trip(
        page(text="Forbidden", status=403), (Navigate(HOME), page(status=429))
    ),
    "on another host of the website": trip(
        wall(), (Navigate("https://m.shop.example"), wall("https://m.shop.example/"))
    ),
    "then away, and nothing found": trip(wall(), AGAIN, (Navigate(ENGINE), page(ENGINE)), answer=ANSWER),
    "a faulty and a blank page are no way in": trip(
        wall(), (Navigate(ITEM), page(ITEM, status=502)), (WAIT, page(ITEM, "", title="")), AGAIN
    ),
    "its challenge is at the guard's own address": trip(
        look("", url="https://geo.captcha-delivery.com/captcha/?x=1"),
        (Navigate(HOME), look("", url="https://geo.captcha-delivery.com/captcha/?x=2")),
    ),
    "where its front page led": trip(
        wall("https://shop-moved.example/"), (Navigate(HOME), wall("https://shop-moved.example/"))
    ),
    "its front page was opened more than once": trip(page(), *[(Navigate(HOME), page())] * 3, *[AGAIN] * 9),
    "its doors closed for good": trip(
        page(), (CLICK, page(ITEM)), (CLICK, wall("https://shop.example/p/2")), AGAIN, (WAIT, wall())
    ),
}

NOT_KEPT_OUT = {
    "one 403 after good pages": trip(
        page(),
        *[(CLICK, page(f"{HOME}p/{n}")) for n in range(8)],
        (CLICK, look("Access Denied", url=f"{HOME}admin", title="Access Denied", status=403)),
        answer=ANSWER,
    ),
    "closed after it had let the agent in, answered": trip(page(), AGAIN, AGAIN, answer=ANSWER),
    "a single refusal, answered at once": trip(wall(), answer=ANSWER),
    "waits at a challenge until the budget is spent": trip(wall(), *[(WAIT, wall())] * 9),
    "scrolls and clicks at a challenge": trip(
        wall(), (Scroll("down"), wall()), (CLICK, wall()), (GoBack(), wall())
    ),
    "the challenge reloads itself": trip(
        wall(), (WAIT, wall(f"{HOME}?__cf_chl_tk=1")), (WAIT, wall(f"{HOME}check"))
    ),
    "a challenge that passed": trip(wall(), (WAIT, page()), answer=ANSWER),
    "let in between two challenges": trip(wall(), AGAIN, (Navigate(ITEM), page(ITEM)), AGAIN, answer=ANSWER),
    "let in again at the end": trip(page(), AGAIN, AGAIN, (Navigate(ITEM), page(ITEM))),
    "a search engine's challenge": trip(
        page(),
        (Navigate(ENGINE), wall(ENGINE)),
        (Navigate("https://search.example/"), wall("https://search.example/")),
    ),
    "a search engine's challenge, answered": trip(
        page(),
        (Navigate("https://www.google.com/search?q=mug"), wall("https://www.google.com/sorry/index")),
        (Navigate("https://www.google.com/"), wall("https://www.google.com/sorry/index")),
        answer=ANSWER,
    ),
    "closed doors inside, its front page never tried again": trip(
        page(), *[(Navigate(f"{HOME}admin/{n}"), wall(f"{HOME}admin/{n}")) for n in range(9)]
    ),
    "a form that was refused at a page's own address": trip(
        page(),
        (CLICK, page(f"{HOME}search")),
        (GoBack(), page()),
        (SEARCH, wall(f"{HOME}search")),
        (CLICK, wall(f"{HOME}oops")),
    ),
    "it was hammered until it refused": trip(page(), *[(Navigate(HOME), page())] * 4, *[AGAIN] * 9),
    "a missing page is shown": trip(page(f"{HOME}a", status=404), AGAIN, AGAIN, answer=ANSWER),
    "a navigation that failed shows the old page": trip(
        wall(), (Navigate(ITEM), wall(notices=(Notice("navigation_failed", "reset"),)))
    ),
    "a sign-up form with a CAPTCHA": trip(
        page(f"{HOME}join", "E-mail Password I'm not a robot. Complete the CAPTCHA."),
        (Navigate(HOME), page(HOME, "E-mail Password I'm not a robot. Complete the CAPTCHA.")),
        answer=ANSWER,
    ),
}


@pytest.mark.parametrize("made", KEPT_OUT.values(), ids=KEPT_OUT)
def test_a_website_that_kept_the_agent_out_excuses_it(made: Episode) -> None:
    found = find_block(TASK, made)
    assert found.passed, found.reason
    assert len(found.steps) >= 2


@pytest.mark.parametrize("made", NOT_KEPT_OUT.values(), ids=NOT_KEPT_OUT)
def test_nothing_else_does(made: Episode) -> None:
    assert not find_block(TASK, made).passed


def test_a_deep_start_page_may_be_closed_where_the_website_is_not() -> None:
    maps = f"{HOME}maps"
    task = msgspec.structs.replace(TASK, website=maps)
    again = (Navigate(maps), wall(maps))
    assert "front page" in find_block(task, trip(wall(maps), again, again)).reason
    assert find_block(task, trip(wall(maps), again, AGAIN)).passed


def test_an_attempt_that_saw_nothing_was_not_blocked() -> None:
    made = msgspec.structs.replace(trip(wall()), steps=(), final=None)
    assert not find_block(TASK, made, suspect_last=True).passed


@pytest.mark.parametrize(
    "url", ["http://[", "http://a@[b@shop.example/", "javascript:1", "", "https://shop.example:x/"]
)
def test_an_agent_may_open_anything(url: str) -> None:
    assert find_block(TASK, trip(wall(), (Navigate(url), wall(notices=())), AGAIN)).passed


def unknown(url: str = HOME, ray: int = 1) -> Observation:
    """A challenge that no rule knows."""
    return look(f"Bitte beweisen Sie, dass Sie ein Mensch sind. Nummer {ray}", url=url, title="Kurz warten")


def test_a_suspicion_is_bounded_by_the_same_rules() -> None:
    """What a model may at most excuse: an attempt that saw nothing but such pages, asked for twice."""

    def may_be(made: Episode) -> bool:
        assert not find_block(TASK, made).passed
        return find_block(TASK, made, suspect_last=True).passed is True

    again = (Navigate(HOME), unknown(ray=2))
    assert may_be(trip(unknown(), again, answer=ANSWER))
    assert may_be(trip(wall(), again))
    assert may_be(trip(page(), (Navigate(ITEM), unknown(ITEM)), again))
    assert not may_be(trip(page(), (Navigate(ITEM), unknown(ITEM)), again, answer=ANSWER))
    assert not may_be(trip(unknown(), (WAIT, unknown(ray=3)), answer=ANSWER))
    assert not may_be(trip(page(), (Navigate(ENGINE), unknown(ENGINE)), (Navigate(ENGINE), unknown(ENGINE))))
    long = page(text="A page with much on it. " * 100)
    assert not may_be(trip(long, (Navigate(HOME), long), answer=ANSWER))


def test_guards_are_written_folded() -> None:
    for guard in GUARDS:
        assert all(text == text.casefold() for text in (*guard.titles, *guard.words))


@pytest.mark.parametrize(
    ("url", "host"),
    [
        ("https://m.shop.example/x", "m.shop.example"),
        ("https://www.shop.example/", "shop.example"),
        ("https://geo.captcha-delivery.com/captcha/?x=1", "shop.example"),
    ],
)
def test_the_host_that_blocks_is_the_one_that_refused_last(url: str, host: str) -> None:
    made = trip(page(), (Navigate(url), wall(url)))
    assert blocking_host("https://shop.example/", made, Judgement(True, "it refused", (0, 1))) == host
    assert blocking_host("https://shop.example/", made, Judgement(True, "a model says so")) == "shop.example"
