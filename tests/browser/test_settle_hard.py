"""A handful of the hard pages: what is looked at is final. `python -m benchmarks.settle` has all of them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import AbstractContextManager
from typing import Any

import psutil
import pytest
import pytest_asyncio
from benchmarks.settle.hardweb import PAGES, HardSite
from benchmarks.settle.trials import SettleBench, run_trial
from starlette.requests import Request
from starlette.responses import Response

from webgym.browser.cdp import Connection
from webgym.browser.config import BrowserConfig
from webgym.browser.memory import process_type
from webgym.browser.slot import Slot
from webgym.browser.timers import TRACE_SECONDS
from webgym.core.action import LeftClick, Navigate, Press, Target

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


@pytest.fixture
def tab(new_tab: Tab) -> Tab:
    """A new one: how long a page is waited for is told from a tab's beginning."""
    return new_tab


NOWHERE = LeftClick(Target(coordinate=(990, 990)))
BUTTON = LeftClick(Target(coordinate=(100, 50)))
PACE = 0.6
SHORT = BrowserConfig(long_poll_seconds=0.6, silent_timer_seconds=0.2)


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def hard() -> AsyncIterator[HardSite]:
    async with HardSite() as site:
        yield site


def origin(hard: HardSite) -> str:
    return f"http://127.0.0.1:{hard.port}"


def reason(tab: Tab) -> str:
    assert tab.last is not None
    return tab.last.observation.settled


QUICK = (
    "app-typeahead chat component-dialog frames idle-callback redirect-script-late socket-reply worker"
).split()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(page.name, marks=() if page.name in QUICK else pytest.mark.slow)
        for page in PAGES.values()
        if page.group != "late" and "OTHER" not in page.body
    ],
)
async def test_what_is_looked_at_is_final(name: str, hard: HardSite, shared_slot: Slot) -> None:
    page = PAGES[name]
    pace = 1.0 if page.group == "fleeting" else PACE  # what is fleeting is told by its time
    trial = await run_trial(shared_slot, page, "ours", origin(hard), pace, SettleBench())
    assert trial.is_final, trial


@pytest.mark.parametrize("name", ["spinner-css", "clock-fast"])
async def test_what_never_ends_is_waited_for_once(name: str, hard: HardSite, tab: Tab) -> None:
    await tab.goto(PAGES[name].url(origin(hard)))
    await tab.step(BUTTON)
    settled = []
    for _ in range(2):
        await tab.step(NOWHERE)
        settled.append(reason(tab))
    assert "unchanged" in settled, settled
    assert set(settled) <= {"unchanged", "quiet", "long_poll"}, settled


async def test_answers_that_nobody_reads_hide_no_later_ones(site: Site, tab: Tab) -> None:
    async def answer(request: Request) -> Response:
        await asyncio.sleep(float(request.query_params["seconds"]))
        return Response("arrived", headers={"Cache-Control": "no-store"})  # others are read for the script

    site.on("/api", answer)
    await tab.goto(
        site.page(
            "<p id=out>nothing</p><button onclick=ask()>Ask</button>"
            "<script>const kept = fetch('/api?seconds=0');"
            "const ask = async () => { out.textContent = await (await fetch('/api?seconds=0.5')).text() }"
            "</script>"
        )
    )
    assert reason(tab) == "quiet"
    for _ in range(2):
        await tab.step(LeftClick(tab.at("Ask")))
        assert "arrived" in tab.text


async def test_what_an_action_writes_letter_by_letter_is_read_to_its_end(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<p id=out></p><script>onclick = () => { let n = 0; const write = () => { out.append(++n + ' ');"
            "if (n < 60) setTimeout(write, 30) }; write() }</script>"
        )
    )
    await tab.step(NOWHERE)
    assert tab.text[0].endswith("59 60")


async def test_the_page_sees_nothing_of_it(site: Site, tab: Tab) -> None:
    own = "[setTimeout, requestAnimationFrame, requestIdleCallback, fetch, Worker, WebSocket]"
    await tab.goto(
        site.page(
            "<script>addEventListener('load', () => {"
            f"document.title = {own}.every((f) => /native code/.test(Function.prototype.toString.call(f)))"
            " && !('webgym' in window) })</script><p>text</p>"
        )
    )
    assert tab.last is not None
    assert tab.last.observation.title == "true"


# --- stopped processes ----------------------------------------------------------------------------------


@contextlib.contextmanager
def stopped(slot: Slot) -> Iterator[None]:
    """All processes of the slot are stopped for the block."""
    assert slot.process is not None
    os.killpg(slot.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.killpg(slot.process.pid, signal.SIGCONT)


@pytest.mark.parametrize("seconds", [0.15, 0.4])
async def test_a_frame_that_is_late_is_waited_for(seconds: float, site: Site, tab: Tab) -> None:
    """The page asks for frame after frame; the process that draws them has no time for a while."""
    await tab.goto(
        site.page(
            "<button>Go</button><p id=out>nothing</p><script>onkeydown = () => { let n = 12;"
            "const f = () => { --n ? requestAnimationFrame(f) : out.textContent = 'drawn' }; f() }</script>"
        )
    )
    assert tab.slot.process is not None
    [drawing] = [
        child.pid
        for child in psutil.Process(tab.slot.process.pid).children(recursive=True)
        if process_type(child.pid) == b"gpu-process"
    ]
    os.kill(drawing, signal.SIGSTOP)
    asyncio.get_running_loop().call_later(seconds, os.kill, drawing, signal.SIGCONT)
    await tab.step(Press(("x",)))
    assert "drawn" in tab.text


async def test_a_burst_after_a_stop_is_waited_out(site: Site, tab: Tab) -> None:
    """Timers came due while the page was stopped; each of them starts the next stage when it goes on."""
    await tab.goto(
        site.page(
            "<p id=out></p><script>const say = (text) => out.append(text + ' '); let isFirst = true;"
            "const burst = () => { say('one'); setTimeout(() => say('two'), 60) };"
            "onclick = () => { if (isFirst) setTimeout(burst, 2500);"
            "isFirst = false; say('zero') }</script>"
        )
    )
    await tab.step(NOWHERE)
    assert tab.text == ["zero"]
    with stopped(tab.slot):
        await asyncio.sleep(2.6)
    await tab.step(LeftClick(Target(coordinate=(990, 10))))
    assert sorted(tab.text[0].split()) == ["one", "two", "zero", "zero"]
    assert reason(tab) == "quiet"


@pytest.mark.parametrize("at", [0.05, 0.3])
async def test_a_stop_in_the_middle_of_settling_changes_nothing(at: float, site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<p id=out></p><script>onclick = () => setTimeout(() => { setTimeout(() => {"
            "out.textContent = 'done' }, 200) }, 200)</script>"
        )
    )
    step = asyncio.create_task(tab.step(NOWHERE))
    await asyncio.sleep(at)
    with stopped(tab.slot):
        await asyncio.sleep(0.7)
    await step
    assert tab.text == ["done"]
    assert reason(tab) == "quiet"


async def test_a_stop_while_the_timers_are_read_changes_nothing(
    site: Site, tab: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The trace comes too late, and what is set until the next one begins is in neither."""
    await tab.goto(
        site.page(
            "<p id=out></p><script>onclick = () => setTimeout(() => { setTimeout(() => {"
            "out.textContent = 'done' }, 600) }, 200)</script>"
        )
    )
    send = Connection.send
    stops: list[AbstractContextManager[None]] = []

    def sent(self: Connection, method: str, *rest: Any) -> int:
        if method == "Tracing.end" and not stops:
            stops.append(stopped(tab.slot))
            stops[0].__enter__()
            asyncio.get_running_loop().call_later(TRACE_SECONDS + 0.2, stops[0].__exit__, None, None, None)
        return send(self, method, *rest)

    monkeypatch.setattr(Connection, "send", sent)
    await tab.step(NOWHERE)
    assert (len(stops), tab.text, reason(tab)) == (1, ["done"], "quiet")


async def test_the_deadline_holds_for_a_stopped_page(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(settle_seconds=1.0))
    await tab.goto(site.page("<p>text</p><script>onclick = () => fetch('/nowhere')</script>"))
    act = asyncio.create_task(tab.slot.act(NOWHERE))
    await asyncio.sleep(0.02)
    with stopped(tab.slot):
        async with asyncio.timeout(BrowserConfig().execute_seconds + 5):
            await act
    await tab.step()
    assert tab.text == ["text"]


async def test_a_request_does_not_age_while_the_page_is_stopped(site: Site, open_tab: Open) -> None:
    answer = asyncio.Event()
    asked = asyncio.Event()

    async def late(_: Request) -> Response:
        asked.set()
        await answer.wait()
        await asyncio.sleep(0.3)
        return Response("arrived")

    site.on("/late", late)
    tab = await open_tab(config=SHORT)
    await tab.goto(
        site.page(
            "<p id=out>nothing</p><script>const go = async () => {"
            "out.textContent = await (await fetch('/late')).text() };"
            "onclick = () => setTimeout(go, 700)</script>"
        )
    )
    with tab.slot.awake():
        await tab.step(NOWHERE)
        await asked.wait()
    await asyncio.sleep(2 * SHORT.long_poll_seconds)
    answer.set()
    with tab.slot.awake():
        await tab.step(Navigate("about:nothing"))  # refused: nothing happens to the page
    assert tab.text == ["arrived"]
