"""The wheel: over what a page scrolls by a script of its own, and on a slow display."""

from __future__ import annotations

import asyncio

import psutil
import pytest
from tests.conftest import command_of

from webgym.browser import pointer
from webgym.browser.gestures import HoverAndScroll
from webgym.browser.page import Page
from webgym.core.action import LeftClick, Scroll, Side, Target

from .conftest import VIEWPORT, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

LINES = """<style>#box { width: 500px; height: 300px; overflow: hidden; position: relative }
#box div { position: absolute; height: 20px; width: 500px }</style><div id=box tabindex=0></div><script>
let top_ = 0, turns = 0;
const lines = new Map();
const draw = () => {
  for (let n = 0; n < 1000; n++) {
    const isShown = n * 20 > top_ - 20 && n * 20 < top_ + 300;
    if (isShown && !lines.has(n)) {
      const line = document.createElement('div');
      line.textContent = 'Line ' + n;
      box.append(line);
      lines.set(n, line);
    }
    if (!isShown && lines.has(n)) { lines.get(n).remove(); lines.delete(n); }
    if (isShown) lines.get(n).style.top = n * 20 - top_ + 'px';
  }
  document.title = top_ + ' ' + turns;
};
box.addEventListener('wheel', (event) => {
  event.preventDefault();
  turns += 1;
  top_ = Math.max(0, Math.min(1000 * 20 - 300, top_ + Math.sign(event.deltaY) * 50));
  requestAnimationFrame(draw);
}, { passive: false });
draw();
</script>"""


def at(x: float, y: float) -> Target:
    return Target(coordinate=(x / VIEWPORT[0] * 1000, y / VIEWPORT[1] * 1000))


def top(tab: Tab) -> int:
    assert tab.last is not None
    return int(tab.last.observation.title.split()[0])


@pytest.mark.parametrize("rest", ["", "<p style='height:3000px'>page</p>"], ids=["alone", "in a page"])
async def test_an_editor_that_moves_a_few_lines_a_turn_moves_by_its_page(
    site: Site, tab: Tab, rest: str
) -> None:
    await tab.goto(site.page(LINES + rest))
    await tab.step(Scroll("down", at(250, 150)))
    assert 180 <= top(tab) <= 260, "three quarters of its 300 pixels"
    before = top(tab)
    await tab.step(Scroll("up", at(250, 150)))
    assert top(tab) <= max(0, before - 180)


async def test_the_wheel_turns_over_the_focus_where_nothing_else_scrolls(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(LINES))
    await tab.step(LeftClick(at(250, 150)))
    await tab.step(Scroll("down"))
    assert 180 <= top(tab) <= 260


MAP = (
    "<div id=map style='width:800px;height:600px;overflow:hidden;position:relative'></div><script>"
    "let zoom = 1; let turns = 0;"
    "for (let n = 0; n < 48; n++) { const tile = document.createElement('i'); tile.textContent = n;"
    "tile.style = `position:absolute;width:100px;height:100px;left:${n % 8 * 100}px;"
    "top:${(n >> 3) * 100}px`; map.append(tile); }"
    "map.addEventListener('wheel', (event) => { event.preventDefault(); event.stopPropagation();"
    "zoom *= 1.2; turns += 1; for (const tile of map.children) tile.style.zoom = zoom;"
    "document.title = turns; }, { passive: false })</script>"
)
BELOW = "<p style='height:2000px'>below"


async def test_a_map_is_drawn_larger_once(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(MAP))
    look = await tab.step(Scroll("down", at(400, 300)))
    assert look.observation.title == "1"


async def test_a_map_in_the_middle_does_not_keep_from_what_is_below(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(MAP + BELOW))
    look = await tab.step(Scroll("down", at(400, 300)))
    assert (look.observation.title, look.observation.scroll[0]) == ("1", 0)
    look = await tab.step(Scroll("down"))
    assert (look.observation.title, look.observation.scroll[0]) == ("2", VIEWPORT[1] * 0.75)


async def test_a_page_that_scrolls_itself_later_is_scrolled_once(site: Site, tab: Tab) -> None:
    script = (
        "addEventListener('wheel', (event) => { event.preventDefault();"
        "setTimeout(() => scrollBy(0, event.deltaY), 200) }, { passive: false })"
    )
    await tab.goto(site.page(f"<script>{script}</script>{BELOW}"))
    look = await tab.step(Scroll("down"))
    assert look.observation.scroll[0] == VIEWPORT[1] * 0.75


@pytest.mark.parametrize(
    ("side", "style"),
    [
        ("up", "display:flex;flex-direction:column-reverse"),
        ("left", "display:flex;flex-direction:row-reverse"),
        ("left", "writing-mode:vertical-rl"),
        ("right", "direction:rtl;display:flex;flex-direction:row-reverse"),
    ],
)
async def test_a_box_that_begins_at_its_end_is_scrolled_from_there(
    site: Site, tab: Tab, side: Side, style: str
) -> None:
    rows = "<p style='flex:none;min-width:90px;min-height:90px'>row</p>" * 9
    report = "onscroll='document.title=scrollLeft+scrollTop'"
    await tab.goto(
        site.page(f"<div {report} style='width:200px;height:200px;overflow:auto;{style}'>{rows}</div>")
    )
    look = await tab.step(Scroll(side))
    assert abs(float(look.observation.title)) == 150


@pytest.mark.parametrize(
    "move",
    ["box.scrollTop = at", "list.style.transform = `translateY(${-at}px)`"],
    ids=["scrolled", "moved in a third of a second"],
)
async def test_a_box_that_a_script_scrolls_moves_by_what_it_shows(site: Site, tab: Tab, move: str) -> None:
    rows = "".join(f"<p style='margin:0;height:20px'>row {number}</p>" for number in range(90))
    script = (
        "let at = 0; box.addEventListener('wheel', (event) => { event.preventDefault();"
        f"at = Math.max(0, at + event.deltaY); {move}; document.title = at }}, {{ passive: false }})"
    )
    await tab.goto(
        site.page(
            "<div id=box style='width:300px;height:200px;overflow:hidden'>"
            f"<div id=list style='transition:transform .3s'>{rows}</div></div><script>{script}</script>"
            f"{BELOW}"
        )
    )
    look = await tab.step(Scroll("down", at(100, 100)))
    assert (look.observation.title, look.observation.scroll[0]) == ("150", 0)


def hold_display_after(event: str, monkeypatch: pytest.MonkeyPatch, delay: float = 0) -> None:
    """Stop the process that draws for 0.3 s after this mouse event, or these seconds later."""
    children = psutil.Process().children(recursive=True)
    displays = [child for child in children if "--type=gpu-process" in command_of(child)]
    assert displays
    send = pointer.mouse

    def go_on() -> None:
        for display in displays:
            display.resume()

    def hold() -> None:
        for display in displays:
            display.suspend()
        asyncio.get_running_loop().call_later(0.3, go_on)

    async def mouse(page: Page, kind: str, point: tuple[float, float], **more: object) -> None:
        await send(page, kind, point, **more)
        if kind == event:
            if delay:
                asyncio.get_running_loop().call_later(delay, hold)
            else:
                hold()

    monkeypatch.setattr(pointer, "mouse", mouse)


@pytest.mark.parametrize("place", ["page", "frame", "gesture"])
async def test_what_a_slow_display_scrolls_late_is_seen(
    site: Site, tab: Tab, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    """The compositor scrolls with its next frame, which other work on the machine can hold up."""
    url = site.page("<p style='margin-bottom:600px'>top</p><p style='margin-bottom:3000px'>middle</p>")
    if place == "frame":
        url = site.page(f"<iframe style='width:700px;height:550px' src='{site.elsewhere(url)}'></iframe>")
    await tab.goto(url)
    hold_display_after("mouseWheel", monkeypatch)
    where = at(300, 200)
    await tab.step(HoverAndScroll(where, "down") if place == "gesture" else Scroll("down", where))
    assert tab.text == ["middle"]


_SEEN = "new IntersectionObserver(() => (p.textContent = 'seen')).observe(p)"
_BOX = """<p id=p style='margin:0;height:300px'>before</p><script>
    onmouseup = () => { %s }
</script>"""


@pytest.mark.parametrize(
    ("reaction", "place"),
    [
        (_SEEN, "page"),
        ("onscroll = () => (p.textContent = 'seen'); scrollTo(0, 9)", "page"),
        ("requestAnimationFrame(() => (p.textContent = 'seen'))", "frame"),
    ],
    ids=["observer", "scroll", "frame"],
)
async def test_what_a_page_makes_of_a_late_frame_is_seen(
    site: Site, tab: Tab, monkeypatch: pytest.MonkeyPatch, reaction: str, place: str
) -> None:
    url = site.page(_BOX % reaction + "<div style='height:3000px'>")
    if place == "frame":
        url = site.page(f"<iframe style='width:700px;height:550px' src='{site.elsewhere(url)}'></iframe>")
    await tab.goto(url)
    hold_display_after("mouseReleased", monkeypatch)
    await tab.step(LeftClick(at(300, 200)))
    assert tab.text == ["seen"]


_BUTTON = "p.innerHTML = '<button>seen</button>'"


@pytest.mark.parametrize(
    ("reaction", "seconds"),
    [
        (f"p.ontransitionend = () => ({_BUTTON}); p.style = 'transition: opacity 150ms; opacity: 0.5'", 0.12),
        (f"document.startViewTransition(() => ({_BUTTON}))", 0.2),
    ],
    ids=["told", "uncovered"],
)
async def test_what_a_late_end_of_motion_brings_is_seen(
    site: Site, tab: Tab, monkeypatch: pytest.MonkeyPatch, reaction: str, seconds: float
) -> None:
    await tab.goto(site.page(_BOX % reaction))
    hold_display_after("mouseReleased", monkeypatch, seconds)
    await tab.step(LeftClick(at(300, 200)))
    assert tab.find("seen", "button").name == "seen"
