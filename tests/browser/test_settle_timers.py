"""Timers that an action set off are waited for wherever they run, and what they bring is seen and learned."""

from __future__ import annotations

import asyncio

import pytest
from starlette.requests import Request
from starlette.responses import Response

from webgym.core.action import LeftClick, Target, Type

from .conftest import Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


@pytest.fixture
def tab(new_tab: Tab) -> Tab:
    """A new one: how long a page is waited for is told from a tab's beginning."""
    return new_tab


BUTTON = LeftClick(Target(coordinate=(100, 50)))
FIELD = Target(coordinate=(100, 300))
PLACED = """<style>
#b, #f { position: fixed; left: 0; width: 300px; height: 60px } #b { top: 0 } #f { top: 150px }
#out, #v { position: absolute; left: 0; top: 300px } #v { top: 350px }
iframe { position: fixed; left: 0; top: 0; width: 500px; height: 500px; border: 0 }
</style>"""
DELAYED = f"""{PLACED}<button id=b>Go</button><input id=f><p id=out>nothing</p><script>
let n = 0, timer;
const late = (text, ms) => {{
  clearTimeout(timer);
  timer = setTimeout(() => {{ out.textContent = text }}, ms);
}};
b.onclick = () => late('clicked ' + ++n, 300);
f.oninput = () => late('found ' + f.value, 300);
"""


async def test_timers_in_frames_of_other_origins(site: Site, tab: Tab) -> None:
    inner = site.elsewhere(site.page(f"{DELAYED}late('opened', 600)</script>"))
    await tab.goto(site.page(f"{PLACED}<iframe src='{inner}'></iframe>"))
    assert "opened" in tab.text
    for count in (1, 2, 3):
        await tab.step(BUTTON)
        assert f"clicked {count}" in tab.text
    for word in ("ships", "shores", "ferries"):
        await tab.step(Type(FIELD, word, enter=False))
        assert f"found {word}" in tab.text


async def test_a_frame_that_answers_by_a_timer(site: Site, tab: Tab) -> None:
    answer = "onmessage = (e) => setTimeout(() => e.source.postMessage(0, '*'), 300)"
    echo = site.elsewhere(site.page(f"<script>{answer}</script>"))
    await tab.goto(
        site.page(
            f"{PLACED}<iframe id=i style='top:400px' src='{echo}'></iframe>"
            "<button id=b>Go</button><p id=out>0</p>"
            "<script>b.onclick = () => i.contentWindow.postMessage(0, '*');"
            "onmessage = () => { out.textContent -= -1 }</script>"
        )
    )
    for count in (1, 2):
        await tab.step(BUTTON)
        assert str(count) in tab.text


async def test_a_timer_set_when_a_frame_has_loaded(site: Site, tab: Tab) -> None:
    waits = [0, 0, 0.2]

    async def saved(_: Request) -> Response:
        await asyncio.sleep(waits.pop(0))
        return Response("Saved", media_type="text/html")

    site.on("/saved", saved)
    late = "setTimeout(() => { out.textContent = 'sent ' + ++n }, 300)"
    await tab.goto(
        site.page(
            f"{PLACED}<script>let n = -1</script><p id=out></p>"
            "<form action=/saved target=i><button id=b>Go</button></form>"
            f"<iframe name=i style='top:400px' onload=\"{late}\"></iframe>"
        )
    )
    for count in (1, 2, 3):
        await tab.step(BUTTON)
        assert f"sent {count}" in tab.text


@pytest.mark.parametrize(
    "work",
    [
        "setTimeout(() => postMessage(0), 300)",
        "let n = 0; const go = () => { const end = Date.now() + 20; while (Date.now() < end); "
        "++n < 20 ? setTimeout(go, 10) : postMessage(0) }; go()",
    ],
    ids=["once", "in pieces"],
)
async def test_timers_in_workers(site: Site, tab: Tab, work: str) -> None:
    await tab.goto(
        site.page(
            f"{PLACED}<button id=b>Go</button><p id=out>0</p><script>"
            f"const worker = new Worker(URL.createObjectURL(new Blob([`onmessage = () => {{ {work} }}`])));"
            "worker.onmessage = () => { out.textContent -= -1 };"
            "b.onclick = () => worker.postMessage(0)</script>"
        )
    )
    for count in (1, 2, 3):
        await tab.step(BUTTON)
        assert str(count) in tab.text


async def test_timers_that_change_no_document(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            f"{PLACED}<button id=b>Go</button><canvas id=v width=300 height=200></canvas><script>let n = 0;"
            "b.onclick = () => setTimeout(() => { v.getContext('2d').fillRect(9 * n++, 0, 5, 50) }, 1500)"
            "</script>"
        )
    )
    for count in (1, 2, 3):
        look = await tab.step(BUTTON)
        await asyncio.sleep(0.3)
        assert look.image == await tab.slot.screenshot(), f"click {count}"


async def test_a_timer_that_is_late_is_named(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            f"{PLACED}<button id=b>Go</button><p id=out>text</p><script>const hide = () => {{}};"
            "b.onclick = () => { setTimeout(hide, 60000); setTimeout(hide, 8400) };"
            "out.onclick = () => { out.textContent = 'Saved'; setTimeout(hide, 5000) }</script>"
        )
    )
    await tab.step(BUTTON)
    assert tab.notices == [("still_loading", "a timer, due in 8 s")]
    await tab.step(LeftClick(Target(coordinate=(10, 510))))
    assert tab.notices == [], "it hides a message"
