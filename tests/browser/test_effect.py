"""A click or a scroll that does nothing is said to, whatever moves beside it; one that does is not."""

from __future__ import annotations

import pytest

from webgym.browser.observe import EffectCheck
from webgym.browser.page import ActionResult
from webgym.core.action import LeftClick, RightClick, Scroll, Target, Wait

from .conftest import Open, Site, Tab, one_in

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


@pytest.fixture
def tab(new_tab: Tab) -> Tab:
    """A new one: what had an effect is told from what the tab's pages did before."""
    return new_tab


TITLE = "<h1 style='height:60px'>Nothing happens here</h1>"
HERE = Target(coordinate=(50, 50))
MOVES = {
    "nothing": "",
    "a clock": "<p id=c></p><script>setInterval(() => { c.textContent = Date.now() }, 150)</script>",
    "a chain of timers": "<p id=c></p><script>"
    "(function again() { c.textContent = Date.now(); setTimeout(again, 60) })()</script>",
    "frames": "<p id=c style='position:relative'>o</p><script>let n = 0;"
    "(function again() { c.style.left = n++ % 50 + 'px'; requestAnimationFrame(again) })()</script>",
    "a spinner": "<style>@keyframes t { to { transform: rotate(1turn) } }"
    "#s { width: 40px; height: 40px; border: 4px solid; border-top-color: red;"
    "animation: t 1s infinite }</style>"
    "<div id=s class=spinner></div>",
}


def kinds(tab: Tab) -> list[str]:
    return [kind for kind, _ in tab.notices]


@pytest.mark.parametrize("moves", one_in(2, MOVES))
async def test_what_does_nothing_is_told(site: Site, tab: Tab, moves: str) -> None:
    await tab.goto(site.page(TITLE + MOVES[moves]))
    await tab.step(Wait(0.5))  # what moves by itself is seen to
    for action in (LeftClick(HERE), RightClick(HERE), Scroll("down")):
        await tab.step(action)
        assert kinds(tab) == ["no_effect"], action
    [(_, text)] = tab.notices
    assert text == "nothing scrolled down"


DOES = {
    "a change": "<button id=b onclick=\"this.textContent = 'Done'\">Do</button>",
    "a late change": "<button id=b onclick=\"setTimeout(() => { this.textContent = 'Done' }, 400)\">"
    "Do</button>",
    "a plan": "<button id=b onclick=\"setTimeout(() => { this.textContent = 'Done' }, 60000)\">Do</button>",
    "a request": "<button id=b onclick=\"navigator.sendBeacon('/heard')\">Do</button>",
    "an address": "<button id=b onclick=\"history.pushState(0, '', '/there')\">Do</button>",
    "a focus": "<input id=b value=Do>",
    "a value": "<input id=b type=checkbox>",
    "a number by a script": "<span id=b onclick='q.value++'>+</span>"
    "<input id=q style=margin-top:90px value=1>",
    "all boxes by a script": "<span id=b onclick='for (const one of f) one.checked = true'>All</span>"
    "<form id=f style=margin-top:90px><input type=checkbox><input type=checkbox></form>",
    "a choice by a script": "<span id=b onclick='s.selectedIndex = 1'>Two</span>"
    "<select id=s style=margin-top:90px><option>One<option>Two</select>",
    "a style": "<style>nav ul { display: none } nav:hover ul { display: block }</style>"
    "<nav id=b>Menu<ul><li>Entry</ul></nav>",
    "a drawing": "<canvas id=b width=200 height=80></canvas><script>b.onclick = () =>"
    "b.getContext('2d').fillRect(0, 0, 100, 100)</script>",
    "a window": "<button id=b onclick=\"open('')\">Do</button>",
    "a dialog": "<button id=b onclick=\"alert('Hello')\">Do</button>",
    "a message": "<button id=b>Do</button><script>const { port1, port2 } = new MessageChannel();"
    "port2.onmessage = () => { b.textContent = 'Done' }; b.onclick = () => port1.postMessage(0)</script>",
    "a shadow": "<x-b id=b></x-b><script>const root = b.attachShadow({ mode: 'closed' });"
    "root.innerHTML = '<button style=width:200px;height:80px>Do</button>';"
    "root.firstChild.onclick = (e) => e.target.append('ne')</script>",
    "a scroll in a shadow": "<x-b id=b></x-b><script>const root = b.attachShadow({ mode: 'open' });"
    "root.innerHTML = '<button style=width:200px;height:80px>Do</button><p style=height:50px;overflow:auto>'"
    "+ '<br>row'.repeat(20) + '</p>';"
    "root.firstChild.onclick = () => root.lastChild.scrollBy(0, 90)</script>",
    "a style rule": "<button id=b>Do</button><style id=s></style><script>"
    "b.onclick = () => s.sheet.insertRule('#b { color: red }')</script>",
    "an animated drawing": "<svg id=b><rect width=200 height=80 fill=red>"
    "<set attributeName=fill to=green begin=click fill=freeze /></rect></svg>",
    "a state": "<style>x-b:state(on) { background: green }</style><x-b id=b>Do</x-b><script>"
    "customElements.define('x-b', class extends HTMLElement { constructor() { super();"
    "this.attachShadow({ mode: 'open' }).innerHTML = '<slot></slot>'; const inner = this.attachInternals();"
    "this.onclick = () => inner.states.add('on') } })</script>",
    "a list": "<select id=b><option>One<option>Two</select>",
}
PLACED = "<style>#b { position: absolute; left: 0; top: 0; min-width: 200px; min-height: 80px }</style>"


@pytest.mark.parametrize("does", one_in(3, DOES))
async def test_what_does_something_is_not(site: Site, tab: Tab, does: str) -> None:
    await tab.goto(site.page(PLACED + DOES[does] + MOVES["a clock"]))
    await tab.step(LeftClick(HERE))
    assert "no_effect" not in kinds(tab)


async def test_a_scroll_has_an_effect_until_the_end(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<div style='height:1200px'></div>" + MOVES["a clock"]))
    await tab.step(Wait(0.5))
    seen = []
    for _ in range(4):
        await tab.step(Scroll("down"))
        seen.append(kinds(tab))
    assert seen == [[], [], ["no_effect"], ["no_effect"]]
    await tab.step(Scroll("up"))
    assert kinds(tab) == []


async def test_what_came_late_once_is_no_clock(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            PLACED + "<button id=b onclick=\"p.textContent = 'Done'\">Do</button>"
            "<p id=p style=margin-top:120px>o</p>"
            "<script>setTimeout(() => { p.textContent = 'late' }, 2500)</script>"
        )
    )
    await tab.step(Wait(2.6))
    assert "late" in tab.text
    await tab.step(LeftClick(HERE))
    assert kinds(tab) == []


async def test_an_open_list_scrolls_until_its_end(site: Site, tab: Tab) -> None:
    options = "".join(f"<option>City {number}" for number in range(60))
    await tab.goto(site.page(f"<label>City <select>{options}</select></label>"))
    await tab.step(LeftClick(tab.at("City")))
    seen = []
    for _ in range(6):
        await tab.step(Scroll("down"))
        seen.append(kinds(tab))
    assert seen[0] == []
    assert seen[-1] == ["no_effect"]


async def test_a_drawing_that_stays_the_same(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(site.page("<canvas width=400 height=300></canvas>"))
    await tab.step(LeftClick(HERE))
    assert kinds(tab) in ([], ["no_effect"]), "the mouse may have been drawn"
    await tab.step(LeftClick(HERE))
    assert kinds(tab) == ["no_effect"]


async def test_a_scroll_that_comes_after_its_effect_was_asked_for(
    site: Site, tab: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    end = EffectCheck.end

    async def asked_too_early(self: EffectCheck) -> None:
        tab.slot.page.result = ActionResult(changes=0, contents=(), effect="none", missed=False)
        await end(self)

    await tab.goto(site.page("<div style='height:3000px'>Long</div>"))
    monkeypatch.setattr(EffectCheck, "end", asked_too_early)
    look = await tab.step(Scroll("down"))
    assert look.observation.scroll[0] > 0
    assert kinds(tab) == []
    await tab.goto(site.page("<div>Short</div>"))
    await tab.step(Scroll("down"))
    assert kinds(tab) == ["no_effect"]
