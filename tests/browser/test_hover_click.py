"""A click where the page reacts to the mouse that comes, before the button goes down."""

from __future__ import annotations

import pytest

from webgym.core.action import LeftClick, Target

from .conftest import VIEWPORT, Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

STYLE = "<style>#a { position: absolute; left: 100px; top: 100px; width: 200px; height: 80px }</style>"
NEW = (
    "const b = document.createElement('button'); b.textContent = 'New'; b.style = 'width:200px;height:80px';"
)
HIT = "b.onclick = () => { document.title = 'hit' };"
PAGES = {
    "style": "<style>#a .on, #a:hover .off { display: none } #a:hover .on { display: block }"
    "img { width: 200px; height: 80px; background: #ccc }</style>"
    "<div id=a><img class=off alt=Off><img class=on alt=On onclick=\"document.title = 'hit'\"></div>",
    "script": f"<div id=a><button style='width:200px;height:80px'>Old</button></div><script>"
    f"a.onmouseenter = () => {{ {NEW} {HIT} a.replaceChildren(b); }}</script>",
    "frame": f"<div id=a><button style='width:200px;height:80px'>Old</button></div><script>"
    f"a.onmouseenter = () => requestAnimationFrame(() => {{ {NEW} {HIT} a.replaceChildren(b); }})</script>",
    "task": f"<div id=a><button style='width:200px;height:80px'>Old</button></div><script>"
    f"a.onmouseenter = () => setTimeout(() => {{ {NEW} {HIT} a.replaceChildren(b); }})</script>",
    "over": f"<div id=a><button style='width:200px;height:80px'>Old</button></div><script>let old = true;"
    f"a.onmouseover = () => {{ if (!old) return; old = false; setTimeout(() => {{ {NEW} {HIT}"
    f"a.replaceChildren(b); }}) }}</script>",
    "press": "<div id=a tabindex=0 style='background:#ccc'>Old</div><script>let down = false;"
    "a.onmousedown = () => requestAnimationFrame(() => { down = true });"
    "a.onmouseup = () => { if (down) document.title = 'hit' }</script>",
}


@pytest.mark.parametrize("page", PAGES)
async def test_a_click_where_the_mouse_changes_the_page(site: Site, open_tab: Open, page: str) -> None:
    tab = await open_tab()
    await tab.goto(site.page(STYLE + PAGES[page]))
    look = await tab.step(LeftClick(Target(coordinate=(200 / VIEWPORT[0] * 1000, 140 / VIEWPORT[1] * 1000))))
    assert look.observation.title == "hit"


async def test_a_click_follows_what_the_mouse_drives_away(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(
        site.page(
            "<style>#bar { height: 100px; background: #eee } #bar .sub { display: none; height: 150px }"
            "#bar:hover { display: flex; flex-direction: column } #bar:hover .sub { display: block }"
            "button { width: 200px; height: 60px; margin: 0 }</style>"
            "<div id=bar><div class=sub>More</div>"
            "<button onclick=\"document.title = 'hit'\">Below</button></div>"
        )
    )
    look = await tab.step(LeftClick(tab.at("Below")))
    assert look.observation.title == "hit"
    assert "More" in tab.text


async def test_every_event_of_a_click_comes_in_its_order(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<p id=log>.</p><script>for (const name of "
            "'pointermove mousemove pointerdown mousedown pointerup mouseup click'.split(' '))"
            "addEventListener(name, (e) => log.append(e.type + ' '))</script>"
        )
    )
    await tab.step(LeftClick(Target(coordinate=(500, 500))))
    expected = ".pointermove mousemove pointerdown mousedown pointerup mouseup click"
    assert tab.text == [expected]
