"""The picture that is taken during the wait for a quiet page is the one that the page gives after it."""

from __future__ import annotations

import hashlib
from typing import Any

import pytest

from webgym.browser.config import BrowserConfig
from webgym.browser.observe import EarlyScreenshot
from webgym.browser.page import Page
from webgym.core.action import LeftClick, Mode, Scroll, Target

from .conftest import MODES, Open, Site, Tab, batches

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

HERE = Target(coordinate=(50, 50))
AWAY = Target(coordinate=(900, 900))
PLACED = "<style>#b { position: absolute; left: 0; top: 0; width: 200px; height: 80px }</style>"
LONG = "".join(f"<p><a href=#{n}>Line {n}</a> and <button>button {n}</button></p>" for n in range(60))


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Of each step that might have an early picture, whether it was used."""
    found: list[bool] = []
    end = EarlyScreenshot.end

    async def noted(self: EarlyScreenshot, settled: str) -> None:
        await end(self, settled)
        found.append(self.result is not None)

    monkeypatch.setattr(EarlyScreenshot, "end", noted)
    return found


async def rested(tab: Tab) -> str:
    """The name of the picture that a page gives which is left alone for a while."""
    await tab.slot.page.rest(0.25)
    return hashlib.sha256(await tab.slot.screenshot()).hexdigest()


@MODES
async def test_what_is_quiet_at_once_is_pictured_during_the_wait(
    site: Site, open_tab: Open, ended: list[bool], mode: Mode
) -> None:
    tab = await open_tab(mode=mode)
    await tab.goto(site.page(LONG))
    ended.clear()
    for action in (LeftClick(AWAY), Scroll("down"), LeftClick(AWAY), Scroll("up")) * 4:
        early = await tab.step(action)
        late = await tab.step()
        assert early.image == late.image
        assert early.observation.elements == late.observation.elements
        assert early.observation.scroll == late.observation.scroll
        if sum(ended) >= 3:
            break
    assert sum(ended) >= 3  # a machine that is starved may be late


async def test_a_page_that_is_busy_for_a_moment_is_pictured_too(
    site: Site, open_tab: Open, ended: list[bool]
) -> None:
    tab = await open_tab()
    await tab.goto(
        site.page(
            "<button id=b style='width:200px;height:80px'>Do</button><script>"
            "const { port1, port2 } = new MessageChannel();"
            "port2.onmessage = () => { const end = performance.now() + 15;"
            "while (performance.now() < end); };"
            "b.onclick = () => port1.postMessage(0)</script>"
        )
    )
    ended.clear()
    for _ in range(12):
        await tab.step(LeftClick(HERE))
        if any(ended):
            break
    assert any(ended)  # a machine that is starved may be late


BUSY = "{ const end = performance.now() + 400; while (performance.now() < end); }"
LATE = {
    "a message after messages": "<input id=b type=checkbox><script>"
    "const { port1, port2 } = new MessageChannel(); let end = 0;"
    "port2.onmessage = () => performance.now() < end ? port1.postMessage(0) : b.checked = true;"
    "b.onclick = () => { end = performance.now() + 60; port1.postMessage(0); return false }</script>",
    "a rule after messages": "<style>#b { background: #fff }</style><div id=b>Do</div><script>"
    "const { port1, port2 } = new MessageChannel(); let end = 0;"
    "port2.onmessage = () => performance.now() < end ? port1.postMessage(0)"
    " : document.styleSheets[0].insertRule('#b { background: red !important }');"
    "b.onclick = () => { end = performance.now() + 60; port1.postMessage(0) }</script>",
    "a change at once": "<button id=b onclick=\"this.textContent = 'Done'\">Do</button>",
    "a timer": "<canvas id=b></canvas><script>b.onclick = () => setTimeout(() =>"
    "b.getContext('2d').fillRect(0, 0, 90, 90), 50)</script>",
    "frames": "<canvas id=b></canvas><script>let left = 9; const draw = () => { if (left--)"
    "{ b.getContext('2d').fillRect(0, 0, 10, 90 - 9 * left); requestAnimationFrame(draw) } };"
    "b.onclick = draw</script>",
    "frames after frames": "<button id=b>Do</button><script>"
    "const later = (left) => left ? requestAnimationFrame(() => later(left - 1)) : b.textContent = 'Done';"
    "b.onclick = () => later(4)</script>",
    "a transition": "<style>#b { transition: width .3s } #b:hover { width: 600px }</style>"
    "<button id=b>Do</button>",
    "a picture": "<button id=b>Do</button><script>const c = document.createElement('canvas');"
    "c.width = c.height = 2000; const pen = c.getContext('2d'); for (let n = 0; n < 2000; n++)"
    "{ pen.fillStyle = `hsl(${n} 80% 50%)`; pen.fillRect(n, n * 7 % 2000, 40, 300) }"
    "const url = c.toDataURL(); b.onclick = () => document.body.insertAdjacentHTML('beforeend',"
    "`<img style='position:absolute;left:300px;top:0;width:600px' src='${url}'>`)</script>",
    "a dialog": "<button id=b onclick=d.showModal()>Do</button><dialog id=d>Hello</dialog>",
    "a popover": "<button id=b popovertarget=d>Do</button><div id=d popover>Hello</div>",
    "a list": "<select id=b><option>One<option>Two</select>",
    "a link within the page": f"<a id=b href=#n>Do</a>{LONG}<h1 id=n>There</h1>",
}


@pytest.mark.parametrize("pages", batches(2, LATE))
async def test_what_a_click_brings_is_in_the_picture(site: Site, tab: Tab, pages: list[str]) -> None:
    for page in pages:
        await tab.goto(site.page(PLACED + LATE[page]))
        seen = await tab.step(LeftClick(HERE))
        assert seen.observation.screenshot == await rested(tab), page


@pytest.mark.parametrize(
    "late", ["a message after messages", "a rule after messages", "a picture", "frames after frames"]
)
async def test_what_a_click_brings_to_a_calm_page_is_in_the_picture(site: Site, tab: Tab, late: str) -> None:
    await tab.goto(site.page(PLACED + LATE[late]))
    for _ in range(20):  # a machine that is starved may be late
        await tab.step(LeftClick(AWAY))
        if tab.slot.page.is_calm:
            break
    assert tab.slot.page.is_calm
    seen = await tab.step(LeftClick(HERE))
    assert seen.observation.screenshot == await rested(tab)


async def test_a_page_that_cannot_say_whether_it_is_quiet_gives_its_picture_later(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes to it after the time in which the early picture would have been asked for."""
    tab = await open_tab("marks", BrowserConfig(busy_seconds=0.2))
    run = Page.run

    async def delayed(self: Page, function: str, *given: Any, **more: Any) -> Any:
        if function == "beginEarly":
            self.session.send("Runtime.evaluate", {"expression": BUSY})
        return await run(self, function, *given, **more)

    monkeypatch.setattr(Page, "run", delayed)
    await tab.goto(site.page(LONG))
    for _ in range(3):
        seen = await tab.step(LeftClick(AWAY))
        assert seen.observation.elements
        assert seen.observation.screenshot == (await tab.step()).observation.screenshot


SCROLLED = {
    "what lies under the mouse": f"<style>p:hover {{ background: red }}</style>{LONG}",
    "what changes when it is seen": f"{LONG}<p id=c>not yet</p><script>new IntersectionObserver((seen) => {{"
    "if (seen[0].isIntersecting) c.textContent = 'seen' }).observe(c)</script>" + LONG,
    "what is drawn when it is seen": "<div style=height:900px></div><canvas id=c></canvas><script>"
    "new IntersectionObserver((seen) => { if (seen[0].isIntersecting)"
    "c.getContext('2d').fillRect(0, 0, 90, 90) }).observe(c)</script>" + LONG,
    "what is left out until it is seen": "<style>section { content-visibility: auto;"
    "contain-intrinsic-size: 100px 300px }</style>" + f"<section>{LONG[:2000]}</section>" * 9,
    "large pictures": "<div style=height:900px></div><img id=i style=width:900px>"
    f"{LONG}<script>const c = document.createElement('canvas'); c.width = c.height = 3000;"
    "const pen = c.getContext('2d'); for (let n = 0; n < 3000; n++)"
    "{ pen.fillStyle = `hsl(${n} 80% 50%)`; pen.fillRect(n, n * 7 % 3000, 40, 300) }"
    "i.src = c.toDataURL()</script>",
}


@pytest.mark.parametrize("pages", batches(2, SCROLLED))
async def test_what_a_scroll_shows_is_in_the_picture(site: Site, tab: Tab, pages: list[str]) -> None:
    for page in pages:
        await tab.goto(site.page(SCROLLED[page]))
        for direction in ("down", "up"):
            seen = await tab.step(Scroll(direction))
            assert seen.observation.screenshot == await rested(tab), (page, direction)


async def test_a_page_that_asks_for_no_frames_is_drawn_for_few(site: Site, tab: Tab) -> None:
    """To count frames asks for one, and whatever the page does next waits for it."""
    await tab.goto(
        site.page(
            f"{PLACED}<p id=b>Text</p><button style='position:absolute;top:200px;width:200px;height:80px'"
            " onclick='document.title = requestAnimationFrame(() => {})'>Count</button>"
        )
    )
    handles = []
    for _ in range(2):
        seen = await tab.step(LeftClick(Target(coordinate=(50, 400))))
        handles.append(int(seen.observation.title))
        for _ in range(4):
            await tab.step(LeftClick(HERE))
    assert handles[1] - handles[0] <= 30, "of five steps"
