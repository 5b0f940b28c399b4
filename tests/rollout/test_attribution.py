"""Who caused the end of an attempt: real browsers, a website that fails, agents that look for a way out."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack
from typing import Any, TypeAlias

import msgspec
import pytest
from aiohttp import web
from benchmarks.stand_ins import serving_app
from tests.faults.test_processes import kill, members
from tests.rollout.test_summary import task

from webgym.agent.agent import AgentTraits
from webgym.browser.config import BrowserConfig
from webgym.browser.slot import Slot
from webgym.core.action import Action, Answer, GoBack, LeftClick, Navigate, Target, Wait
from webgym.core.errors import WebGymError
from webgym.core.observation import Observation
from webgym.core.outcome import Ending
from webgym.core.trajectory import Reply, Step
from webgym.rollout.config import AttemptConfig
from webgym.rollout.driver import EpisodeContext, EpisodeDriver, NoStore
from webgym.rollout.plan import Planned
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ServerConfig
from webgym.server.worker import RunningServer, running_server

pytestmark = pytest.mark.browser

Deed: TypeAlias = Action | Callable[[Slot], Coroutine[Any, Any, None] | None]

SHOP = "http://shop.example/"
MIDDLE = LeftClick(Target(coordinate=(500, 500)))
CLICKED = "<a href='/next' style='position:fixed;inset:0'>Next</a>"


class Website:
    """May be stopped and started again."""

    def __init__(self) -> None:
        self.port = 0
        self.breaks_off = 0
        """How many more requests for another page than the first get no answer."""
        self.delay = 0.0
        """Seconds until the next page that is asked for comes."""
        self.asked: Callable[[str], None] = lambda path: None
        """Called when a page is asked for, before it answers."""
        self.pages = {"/": f"<title>Shop</title>{CLICKED}", "/next": "<title>Next</title><p>there</p>"}
        self._stack: AsyncExitStack | None = None

    async def start(self) -> None:
        app = web.Application()
        app.router.add_get("/{path:.*}", self._page)
        self._stack = AsyncExitStack()
        self.port = await self._stack.enter_async_context(serving_app(app, self.port))

    async def stop(self) -> None:
        if self._stack is not None:
            await self._stack.aclose()
        self._stack = None

    async def _page(self, request: web.Request) -> web.Response:
        if self.breaks_off and request.path != "/":
            self.breaks_off -= 1
            assert request.transport is not None
            request.transport.abort()
        self.asked(request.path)
        delay, self.delay = self.delay, 0.0
        await asyncio.sleep(delay)
        if (page := self.pages.get(request.path)) is None:
            return web.Response(status=404)
        return web.Response(text=f"<!doctype html>{page}", content_type="text/html")


@pytest.fixture
async def website() -> AsyncIterator[Website]:
    website = Website()
    await website.start()
    yield website
    await website.stop()


class Bench:
    """Attempts at the website's task, action by action."""

    def __init__(self, server: RunningServer, client: BrowserClient) -> None:
        self._server, self._client = server, client
        self.website = SHOP
        self.probes = 0

    def slot(self, session: Session) -> Slot:
        grant = session.grant
        return self._server.service.leases.check(grant.session_id, grant.secret, str(grant.generation)).slot

    async def attempt(self, *actions: Deed, budget: int = 60) -> tuple[EpisodeDriver, list[Observation]]:
        """The attempt, and what it observed. What is no action is called with its slot, between steps."""
        context = EpisodeContext(
            store=NoStore(), config=AttemptConfig(budget_easy=budget), site_state=None, seed=0
        )
        known = msgspec.structs.replace(task("t", 1), website=self.website)
        driver = EpisodeDriver(context, Planned(known, 0), AgentTraits("p", "coordinates"))
        session = await self._client.open(driver.options())
        probe = session.probe

        async def counted(url: str) -> Any:
            self.probes += 1
            return await probe(url)

        session.probe = counted  # type: ignore[method-assign]
        seen = [(await driver.start(session)).observation]
        try:
            for action in actions:
                if callable(action):
                    result = action(self.slot(session))
                    if asyncio.iscoroutine(result):
                        await result
                    continue
                step = Step(len(driver.steps), seen[-1], (), Reply("", "p"), action)
                if (view := await driver.take(step)) is not None:
                    seen.append(view.observation)
        except WebGymError as error:
            driver.fail(error)
        finally:
            await driver.conclude()
            await session.close()
        return driver, seen


@pytest.fixture
async def bench(website: Website) -> AsyncIterator[Bench]:
    browser = BrowserConfig(execute_seconds=3, navigate_seconds=6, settle_seconds=3)
    address = f"127.0.0.1:{website.port}"
    browser = browser.allowing(
        f"shop.example={address}", f"other.example={address}", "dead.example=127.0.0.1:1", "127.0.0.1"
    )
    async with (
        running_server(ServerConfig(slots=1, browser=browser)) as server,
        BrowserClient(server.url, token=server.token) as client,
    ):
        yield Bench(server, client)


HOST = "shop.example"
CRAFTED = [
    address
    for dead in ("dead.example", "nowhere.invalid", "dead.example:81")
    for address in (
        f"http://{dead}/",
        f"http://{dead}/?u={SHOP}",
        f"http://{dead}/?u={HOST}",
        f"http://{dead}/{HOST}",
        f"http://{dead}/#{SHOP}",
        f"http://{dead}/#{HOST}",
        f"http://{HOST}@{dead}/",
        f"http://{HOST}:80@{dead}/",
        f"http://{HOST}.{dead}/",
        f"http://{dead}/ {SHOP}",
        f'http://{dead}/"{SHOP}',
        f"https://{dead}/({SHOP})",
    )
]


async def test_no_address_that_an_agent_types_is_a_way_out(bench: Bench) -> None:
    assert len(CRAFTED) == 36
    driver, seen = await bench.attempt(*map(Navigate, CRAFTED), Navigate("chrome://crash"), Answer("no"))
    assert driver.failure is None
    assert driver.ending is Ending.ANSWERED
    for address, each in zip([*CRAFTED, "chrome://crash"], seen[1:], strict=True):
        assert [notice.kind for notice in each.notices] == ["navigation_failed"], address
        assert all(fault.is_typed for fault in each.faults)
    assert bench.probes == 0


async def test_a_wrong_port_of_the_tasks_own_host_is_probed_once_and_judged(
    bench: Bench, website: Website
) -> None:
    bench.website = f"http://127.0.0.1:{website.port}/"
    driver, seen = await bench.attempt(*[Navigate("http://127.0.0.1:1/")] * 5, Answer("no"))
    assert driver.ending is Ending.ANSWERED
    assert seen[-1].faults
    assert bench.probes == 1  # before it is judged: its own website's last page did not come


async def test_going_back_to_an_address_that_failed_is_no_way_out(bench: Bench) -> None:
    away: list[Deed] = [Navigate("http://dead.example/"), Navigate(SHOP), GoBack(), GoBack()]
    driver, _ = await bench.attempt(*away, Answer("no"))
    assert driver.ending is Ending.ANSWERED


async def test_a_website_that_is_down_for_its_own_link_is_not_the_agents_failure(
    bench: Bench, website: Website
) -> None:
    driver, _ = await bench.attempt(lambda _: website.stop(), MIDDLE, Answer("no"))
    assert driver.ending is Ending.ENVIRONMENT_FAILED
    assert driver.failure is not None
    assert "ERR_CONNECTION_REFUSED; probed:" in driver.failure.message


async def test_a_website_that_is_there_again_at_the_probe_is_a_notice(bench: Bench, website: Website) -> None:
    website.breaks_off = 3  # Chromium tries again by itself
    driver, seen = await bench.attempt(MIDDLE, Navigate(SHOP), MIDDLE, Answer("no"))
    assert [notice.kind for notice in seen[1].notices] == ["navigation_failed"]
    assert (driver.ending, seen[-1].title, bench.probes) == (Ending.ANSWERED, "Next", 1)


async def test_what_an_agent_did_while_its_website_was_down_is_not_judged(
    bench: Bench, website: Website
) -> None:
    """An address that it typed is a step with a notice; but its last page never came."""
    driver, seen = await bench.attempt(lambda _: website.stop(), Navigate(SHOP + "next"), Answer("no"))
    assert [notice.kind for notice in seen[-1].notices] == ["navigation_failed"]
    assert driver.ending is Ending.ENVIRONMENT_FAILED
    await website.start()
    away: list[Deed] = [
        lambda _: website.stop(),
        Navigate(SHOP),
        lambda _: website.start(),
        Navigate(SHOP),
        Answer("no"),
    ]
    driver, _ = await bench.attempt(*away)
    assert driver.ending is Ending.ANSWERED


async def test_hammering_is_a_step_with_a_notice(website: Website) -> None:
    """What the limits of the egress policy refuse is neither the website's failure nor the environment's."""
    website.pages["/next"] = f"<title>Next</title>{CLICKED}{'y' * 9_000}"
    browser = BrowserConfig(navigate_seconds=6, settle_seconds=3).allowing(
        f"shop.example=127.0.0.1:{website.port}"
    )
    egress = browser.egress.model_copy(update={"session_bytes": 20_000})
    browser = browser.model_copy(update={"egress": egress})
    async with (
        running_server(ServerConfig(slots=1, browser=browser)) as server,
        BrowserClient(server.url, token=server.token) as client,
    ):
        bench = Bench(server, client)
        driver, seen = await bench.attempt(*[MIDDLE] * 5, Navigate(SHOP), Answer("no"))
    assert [notice.kind for notice in seen[-1].notices] == ["navigation_failed"]
    assert driver.ending is Ending.ANSWERED, driver.failure


@pytest.mark.parametrize("action", [Wait(1), MIDDLE])
async def test_a_lost_renderer_of_the_websites_page_is_the_environments(bench: Bench, action: Action) -> None:
    driver, _ = await bench.attempt(lambda slot: kill(slot, "renderer"), action, Answer("yes"))
    assert driver.ending is Ending.ENVIRONMENT_FAILED
    assert driver.failure is not None
    assert (driver.failure.code, SHOP in driver.failure.message) == ("browser_crashed", True)


async def test_a_page_that_is_lost_while_it_is_left_is_no_loss(bench: Bench) -> None:
    """Its renderer was lost between two steps; the address that the agent types then opens."""
    away: list[Deed] = [lambda slot: kill(slot, "renderer"), Navigate(SHOP + "next"), Answer("no")]
    driver, seen = await bench.attempt(*away)
    if driver.ending is Ending.ANSWERED:
        assert seen[-1].title == "Next", seen[-1]
    else:  # the loss was noticed first
        assert driver.ending is Ending.ENVIRONMENT_FAILED


async def test_a_page_that_is_lost_while_the_next_one_is_asked_for_is_no_loss(
    bench: Bench, website: Website
) -> None:
    """Chromium ignores a request for the page that it is already waiting for."""
    slots: list[Slot] = []

    def asked(path: str) -> None:
        if path == "/next" and slots:
            kill(slots.pop(), "renderer")
            website.delay = 1.0

    website.asked = asked
    driver, seen = await bench.attempt(slots.append, Navigate(SHOP + "next"), Answer("no"))
    assert [notice.kind for notice in seen[-1].notices] == ["crashed"]
    assert (driver.ending, seen[-1].title, slots) == (Ending.ANSWERED, "Next", [])


OTHER = Navigate("http://other.example/")


@pytest.mark.parametrize("away", [(Navigate(SHOP + "next"),), (OTHER,), (OTHER, MIDDLE)])
async def test_a_lost_renderer_of_a_page_that_the_agent_typed_or_went_on_to_is_a_step(
    bench: Bench, away: tuple[Action, ...]
) -> None:
    driver, seen = await bench.attempt(*away, lambda slot: kill(slot, "renderer"), Wait(1), Answer("no"))
    assert driver.ending is Ending.ANSWERED
    assert [notice.kind for notice in seen[-1].notices] == ["crashed"]


async def test_a_page_that_crashes_whenever_it_is_loaded_is_no_way_out(
    bench: Bench, website: Website
) -> None:
    """It is left, and the agent goes on; as a page of the website's own, it is the environment's failure."""
    website.pages["/crash"] = "<title>Crash</title><p>x</p>"

    async def crash(slot: Slot) -> None:
        page = slot.page
        revive = page.revive

        async def again(why: str) -> None:
            await revive(why)
            while not members(slot, "renderer"):  # a new process is called so a moment later
                await asyncio.sleep(0.01)
            kill(slot, "renderer")

        page.revive = again  # type: ignore[method-assign]
        kill(slot, "renderer")

    driver, seen = await bench.attempt(Navigate(SHOP + "crash"), crash, Wait(1), Navigate(SHOP), Answer("no"))
    assert driver.ending is Ending.ANSWERED, driver.failure
    assert [notice.kind for notice in seen[2].notices] == ["crashed", "crashed"]
    assert (seen[2].url, seen[3].title) == ("about:blank", "Shop")
    driver, _ = await bench.attempt(crash, Wait(1), Answer("no"))
    assert driver.ending is Ending.ENVIRONMENT_FAILED
