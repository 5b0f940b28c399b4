"""What has opened over other elements can be closed by a click beside it, in marks mode too."""

from __future__ import annotations

import pytest

from webgym.core.action import LeftClick, Scroll

from .conftest import MODES, Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

BESIDE = "beside what has opened"
PAGE = """
<style>
  button, #p { position: absolute; left: 100px; width: 120px; height: 30px }
  #a { top: 100px } #b { top: 140px } #p { top: 135px; width: 300px; height: 120px; background: #ccc }
</style>
<button id=a>Open</button><button id=b onclick="document.title = 'sent'">Send</button>
<div id=p hidden><a href=#one>One</a></div>
<script>
  a.onclick = () => { p.hidden = false };
  LISTENER
</script>
"""
CLOSES = "{}.addEventListener('mousedown', (event) => {{ if (!p.contains(event.target)) p.hidden = true }})"
DOCUMENT, BODY = CLOSES.format("document"), CLOSES.format("document.body")


def names(tab: Tab) -> list[str]:
    assert tab.last is not None
    return [element.name for element in tab.last.observation.elements or ()]


@MODES
@pytest.mark.parametrize("listener", [DOCUMENT, BODY.replace("document.body", "document.documentElement")])
async def test_a_click_beside_what_has_opened(site: Site, open_tab: Open, mode: str, listener: str) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(PAGE.replace("LISTENER", listener)))
    assert names(tab) == ["Open", "Send"]
    await tab.step(LeftClick(tab.at("Open")))
    assert names(tab) == ["Open", "One", BESIDE]
    await tab.step()
    assert names(tab) == ["Open", "One", BESIDE], "as long as it is open"
    await tab.step(LeftClick(tab.at(BESIDE)))
    assert names(tab) == ["Open", "Send"]
    look = await tab.step(LeftClick(tab.at("Send")))
    assert look.observation.title == "sent"


@pytest.mark.parametrize(
    ("off", "on"),
    [
        ("[a, b].forEach((one) => { one.inert = true })", "[a, b].forEach((one) => { one.inert = false })"),
        ("document.body.style.pointerEvents = 'none'", "document.body.style.pointerEvents = ''"),
    ],
)
async def test_a_click_beside_what_keeps_the_mouse_from_all_else(
    site: Site, tab: Tab, off: str, on: str
) -> None:
    script = (
        f"<script>a.addEventListener('click', () => {{ {off} }});"
        "document.addEventListener('click', (event) => {"
        f"if (event.target !== a && !p.contains(event.target)) {{ {on}; p.hidden = true }} }})</script>"
    )
    page = PAGE.replace("LISTENER", "").replace("top: 135px;", "top: 300px; pointer-events: auto;")
    await tab.goto(site.page(page + script))
    await tab.step(LeftClick(tab.at("Open")))
    assert names(tab) == ["One", BESIDE]
    await tab.step(LeftClick(tab.at(BESIDE)))
    assert names(tab) == ["Open", "Send"]


@pytest.mark.parametrize("listener", ["v.onclick = () => { p.hidden = v.hidden = true }", ""])
async def test_a_click_on_what_lies_over_all_of_the_page(site: Site, tab: Tab, listener: str) -> None:
    veil = "<div id=v hidden style='position:fixed;inset:0'></div>"
    opens = "<script>a.addEventListener('click', () => { v.hidden = false })</script>"
    page = PAGE.replace("<div id=p", veil + "<div id=p").replace("LISTENER", listener)
    await tab.goto(site.page(page + opens))
    await tab.step(LeftClick(tab.at("Open")))
    assert names(tab) == (["One", BESIDE] if listener else ["One"])
    if listener:
        await tab.step(LeftClick(tab.at(BESIDE)))
        assert names(tab) == ["Open", "Send"]


async def test_nothing_beside_what_no_click_closes(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(PAGE.replace("LISTENER", "")))
    await tab.step(LeftClick(tab.at("Open")))
    assert names(tab) == ["Open", "One"]


async def test_nothing_beside_what_covers_nothing(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(PAGE.replace("LISTENER", DOCUMENT).replace("top: 135px", "top: 300px")))
    await tab.step(LeftClick(tab.at("Open")))
    assert names(tab) == ["Open", "Send", "One"]


async def test_nothing_beside_what_was_there_before(site: Site, tab: Tab) -> None:
    """A header under which the elements go when the page is scrolled."""
    header = "<style>#h { position: fixed; inset: 0 600px 260px 0; background: #ccc }</style>"
    rows = "".join(f"<p style='height:60px;margin:0'><button>Row {n}</button>" for n in range(80))
    listens = "<script>document.addEventListener('click', () => {})</script>"
    await tab.goto(site.page(f"{header}<div id=h></div><div style='height:520px'></div>{rows}{listens}"))
    assert "Row 0" in names(tab)
    await tab.step(Scroll("down"))
    assert "Row 0" not in names(tab)
    assert BESIDE not in names(tab)


async def test_nothing_beside_an_open_list(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<select aria-label=Size style='width:300px'><option>S<option>M<option>L</select>"
            "<br><button>Send</button><script>document.addEventListener('click', () => {})</script>"
        )
    )
    await tab.step(LeftClick(tab.at("Size")))
    assert "Send" not in names(tab)
    assert BESIDE not in names(tab)


async def test_no_place_where_elements_are_all_around(site: Site, tab: Tab) -> None:
    around = "<button style='left:0;top:0;width:100vw;height:100vh;z-index:-1'>Around</button>"
    await tab.goto(site.page(PAGE.replace("LISTENER", DOCUMENT) + around))
    await tab.step(LeftClick(tab.at("Open")))
    assert "One" in names(tab)
    assert BESIDE not in names(tab)
