"""Websites that refuse, are dead or want something, in real browsers; and what agents make of those."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack
from typing import Any, NamedTuple

import msgspec
import pytest
import pytest_asyncio
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.types import Receive, Scope, Send
from tests.browser.test_tab import free_port
from tests.browser.test_web import certified, raw, says
from tests.rollout.test_attempt import ACTS, Pages, Says, answers, context_of
from tests.rollout.test_attempt import made as attempted
from tests.rollout.test_summary import task
from tests.serving import serving

from webgym.browser.config import BrowserConfig
from webgym.core.action import BrowserAction, Navigate
from webgym.core.errors import JudgeError
from webgym.core.outcome import Outcome, outcome_of
from webgym.core.trajectory import Episode, Trajectory
from webgym.core.verdict import Verdict
from webgym.judge.blocking import find_block
from webgym.rollout.attempt import Attempt
from webgym.rollout.driver import NoStore
from webgym.rollout.plan import Planned
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.server.client import BrowserClient
from webgym.server.config import ServerConfig
from webgym.server.messages import View
from webgym.server.worker import running_server

LOGIN = "<form action=/in><label>E-mail <input autocomplete=username></label><button>Next</button></form>"
SIGN_IN = LOGIN.replace("<button>", "<input type=password><button>")
SHOP = "<h1>Welcome</h1><p>Red Mug $9.00</p>" + "<p>A page with much on it.</p>" * 9


class Form(NamedTuple):
    """What a website answers, and what that is.

    Attributes:
        body, status, title: of its start page; an address in place of a body is one that it leads to.
        state, code, wall: of the :class:`~webgym.core.trajectory.Arrival`.
    """

    body: str
    status: int = 200
    title: str = "Shop"
    state: str = "open"
    code: str = ""
    wall: bool = False


def refused(body: str, status: int, title: str = "") -> Form:
    return Form(body, status, title, "refused")


def dead(code: str, body: str = "", status: int = 200) -> Form:
    return Form(body, status, "", "dead", code)


FORMS = {
    "forbidden": refused("Forbidden", 403),
    "too-many": refused("Slow down", 429),
    "cloudflare": refused("Enable JavaScript and cookies to continue", 403, "Just a moment..."),
    "cloudflare-old": refused("Checking your browser before accessing the shop.", 503, "Just a moment..."),
    "cloudflare-200": refused(
        "Verifying you are human. This may take a few seconds.", 200, "Just a moment..."
    ),
    "akamai": refused(
        "You don't have permission to access this server. Reference #18.1f", 403, "Access Denied"
    ),
    "datadome": refused("Please enable JS and disable any ad blocker", 403),
    "human": refused("Press & Hold to confirm you are a human.", 200, "Access to this page has been denied"),
    "imperva": refused(
        "As you were browsing something about your browser made us think you were a bot.",
        200,
        "Pardon Our Interruption",
    ),
    "aws": refused("Let's confirm you are human. Begin", 405, "Human Verification"),
    "captcha": refused("I'm not a robot. Complete the CAPTCHA to go on.", 200),
    "error": dead("server_error", "Internal Server Error", 500),
    "gateway": dead("server_error", "502 Bad Gateway", 502),
    "maintenance": dead("server_error", "We are back soon.", 503),
    "legal": dead("region", "Unavailable", 451),
    "region": dead("region", "Sorry, this shop isn&rsquo;t available in your country.", 200),
    "cloudfront": dead("region", "The distribution is configured to block access from your country.", 403),
    "parked": dead("parked", "<h1>parked.forms.test</h1>This domain is for sale! Make an offer."),
    "parked-elsewhere": dead("parked", "http://www.hugedomains.com/domain_profile.cfm?d=x"),
    "parked-by-script": dead("parked", "<img src='http://img.sedoparking.com/x.png'>"),
    "gone": dead("name_gone"),
    "leads-nowhere": dead("name_gone", "http://gone.forms.test/"),
    "tls": dead("tls"),
    "closed": dead("no_answer"),
    "reset": dead("no_answer"),
    "empty": dead("no_answer"),
    "silent": dead("no_answer"),
    "members": Form(SIGN_IN, 401, wall=True),
    "login": Form("/login", wall=True),
    "login-elsewhere": Form("http://accounts.forms.test/first", wall=True),
    "login-in-the-header": Form(SHOP + SIGN_IN),
    "consent": Form("<dialog open>We use cookies. <button>Accept all</button></dialog>" + SHOP),
    "paywall": Form(SHOP + "<p>Subscribe to read on. Already a subscriber? Log in.</p>"),
    "not-found": Form("<h1>Page not found</h1>", 404),
    "passes": Form(SHOP),
    "shop": Form(SHOP),
}


class Websites:
    """All of them at one port, told apart by their names."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.asked: dict[str, int] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self.response(Request(scope))(scope, receive, send)

    def response(self, request: Request) -> Response:
        name, path = (request.url.hostname or "").partition(".")[0], request.url.path
        if path == "/favicon.ico":
            return Response("", 404)
        self.asked[name] = self.asked.get(name, 0) + 1
        if path in ("/login", "/first"):
            return HTMLResponse(SIGN_IN if path == "/login" else LOGIN)
        if name == "passes" and self.asked[name] == 1:
            return HTMLResponse("Checking your browser", 403)
        form = FORMS.get(name, Form(SHOP))
        if form.body.startswith(("/", "http:")):
            return RedirectResponse(form.body)
        return HTMLResponse(f"<!doctype html><title>{form.title}</title>{form.body}", form.status)


class Found(NamedTuple):
    """What came of one attempt at each, and how often its start page was asked for."""

    episodes: dict[str, Episode]
    asked: dict[str, int]
    rows: dict[str, Any]


async def never(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Answer nothing, for ever."""
    await reader.read()


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def found(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Found]:
    async with AsyncExitStack() as stack:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr("webgym.rollout.driver.INSIST_SECONDS", 0.1)
        websites = await stack.enter_async_context(serving(Websites, lambda it: it))
        silent = await stack.enter_async_context(raw(never))
        own = {
            "gone": "nowhere",
            "closed": f"127.0.0.1:{free_port()}",
            "tls": await stack.enter_async_context(raw(never, certified("tls.forms.test"))),
            "reset": await stack.enter_async_context(raw(says(b"", reset=True))),
            "empty": await stack.enter_async_context(raw(says(b""))),
            "silent": silent,
        }
        rules = [f"{name}.forms.test={place}" for name, place in own.items()]
        names = ("*.forms.test", "*.hugedomains.com", "*.sedoparking.com")
        rules += [f"{name}=127.0.0.1:{websites.port}" for name in names]
        browser = BrowserConfig(navigate_seconds=5, settle_seconds=2).allowing(*rules)
        server = await stack.enter_async_context(running_server(ServerConfig(slots=3, browser=browser)))
        client = await stack.enter_async_context(BrowserClient(server.url, token=server.token))
        context = context_of(Says(*[answers("$9.00")] * len(FORMS)), client, NoStore(), 3)
        episodes, slots = dict[str, Episode](), asyncio.Semaphore(3)
        health = SiteHealth(HealthConfig(file=tmp_path_factory.mktemp("health") / "sites.jsonl"))

        async def make(name: str) -> None:
            scheme = "https" if name == "tls" else "http"
            website = f"{scheme}://{name}.forms.test/"
            attempt = Attempt(context, Planned(task(name, 1, website=website), 0))
            async with slots:
                session = await client.open(attempt.options())
                await attempt.run(session)
                await session.close()
            episodes[name] = attempt.episode()
            health.note(website, Trajectory(episodes[name], Outcome.CANCELLED))

        async with asyncio.TaskGroup() as group:
            for name in FORMS:
                group.create_task(make(name))
        yield Found(episodes, websites.asked, {row.host: row for row in health.rows().values()})


pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest.mark.browser
@pytest.mark.parametrize("name", FORMS)
async def test_the_environment_finds_out_before_a_step_is_paid(found: Found, name: str) -> None:
    form, episode = FORMS[name], found.episodes[name]
    assert episode.arrival is not None
    assert (episode.arrival.state, episode.arrival.code) == (form.state, form.code), episode.failure
    assert episode.arrival.has_login_wall == form.wall
    assert len(episode.steps) == (form.state == "open")
    ends = {"refused": Outcome.BLOCKED, "dead": Outcome.ENVIRONMENT_ERROR}
    if form.state in ends:
        assert outcome_of(episode.ending, None) is ends[form.state]
        assert episode.failure is not None
        assert episode.failure.code == f"site_{form.code or form.state}"
    else:
        assert outcome_of(episode.ending, JudgeError("asked")) is Outcome.JUDGE_ERROR  # it is judged
    row = found.rows[f"{name}.forms.test"]
    assert (row.opened, row.refused, row.dead, row.code) == (
        *(int(form.state == state) for state in ("open", "refused", "dead")),
        form.code,
    )
    assert row.has_login_wall == form.wall


@pytest.mark.browser
async def test_a_refusal_is_asked_for_twice_and_a_notice_once(found: Found) -> None:
    assert found.asked["forbidden"] == found.asked["error"] == found.asked["passes"] == 2
    assert found.asked["legal"] == found.asked["parked"] == found.asked["shop"] == 1
    assert found.rows["shop.forms.test"].bytes > 0


# --- what agents do where the start page came -----------------------------------------------------------

HOME = "http://a.test/"


class Doors(Pages):
    """Lets the agent in so often, and refuses every page after that."""

    def __init__(self, open_for: int) -> None:
        super().__init__()
        self._open_for = open_for

    async def step(self, action: BrowserAction | None = None) -> View:
        view = await super().step(action)
        self._url = action.url if isinstance(action, Navigate) else getattr(self, "_url", HOME)
        is_open = self.looks <= self._open_for
        status, text = (200, "Welcome. Red Mug $9.00") if is_open else (403, "Forbidden")
        return View(
            msgspec.structs.replace(view.observation, url=self._url, status=status, text=text), view.image
        )


AGAIN = ACTS.replace('"wait", "time": 1', f'"navigate", "url": "{HOME}"')
AWAY = AGAIN.replace(HOME, "http://b.test/")
BEHAVIOURS: dict[str, Callable[[], list[str]]] = {
    "leaves at once": lambda: [AWAY] * 9,
    "answers at once": lambda: [answers("$12")],
    "waits": lambda: [ACTS] * 9,
    "asks again": lambda: [ACTS, *[AGAIN] * 8],
    "asks again, and answers": lambda: [ACTS, AGAIN, AGAIN, answers("$12")],
    "hammers": lambda: [AGAIN] * 9,
    "hammers, and answers": lambda: [*[AGAIN] * 8, answers("$12")],
}


@pytest.mark.parametrize("open_for", [1, 2, 6, 99])
@pytest.mark.parametrize("behaviour", BEHAVIOURS)
async def test_later_refusals_excuse_no_answer_and_no_hammering(behaviour: str, open_for: int) -> None:
    episode, _, _ = await attempted(Says(*BEHAVIOURS[behaviour]()), 9, pages=Doors(open_for))
    blocked = find_block(task("t", 1), episode)
    outcome = outcome_of(episode.ending, Verdict("test", 0, (), blocked))
    may_be_blocked = (behaviour == "asks again" and open_for < 6) or (behaviour == "hammers" and open_for < 5)
    expected = Outcome.FAILURE if "answers" in behaviour else Outcome.TRUNCATED
    assert outcome is (Outcome.BLOCKED if may_be_blocked else expected)
