"""What is hard to click or to type into, in both modes.

Frames of other origins and closed shadow roots have tests of their own, as have transformed pages
(``test_frames``, ``test_marks``), lists and keys (``test_actions``, ``test_typing``).
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import cycle

import pytest

from webgym.core.action import LeftClick, Scroll, Type

from .conftest import MODES, Open, Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


def by_turns(names: Iterable[str]) -> pytest.MarkDecorator:
    """One page in coordinates mode, the next one in marks mode."""
    return pytest.mark.parametrize(("mode", "name"), list(zip(cycle(["coordinates", "marks"]), names)))


SAID = "document.title = this.value ?? this.innerText"
SHADOW = (
    "<x-form><template shadowrootmode=open><slot></slot><div><template shadowrootmode=open>"
    "BODY</template></div></template></x-form><script>const SAY = (it) => { document.title = it }</script>"
)

CLICKED = {
    "a canvas": (
        "<canvas id=c aria-label=Go tabindex=0 width=200 height=100></canvas><script>"
        "c.onclick = (e) => { document.title = [e.offsetX, e.offsetY].map((at) => Math.round(at / 10)) }"
        "</script>",
        "10,5",
    ),
    "what only a cursor gives away": (
        "<div style='cursor:pointer;width:90px' onclick=\"document.title = 'hit'\">Go</div>",
        "hit",
    ),
    "an open root in an open root": (
        SHADOW.replace("BODY", "<button onclick=\"SAY('hit')\">Go</button>"),
        "hit",
    ),
    "what is slotted into an open root": (
        SHADOW.replace("</x-form>", "<button onclick=\"SAY('hit')\">Go</button></x-form>"),
        "hit",
    ),
    "a scroller in a scroller": (
        "<div id=a style='width:300px;height:150px;overflow:auto'><div style='height:400px'></div>"
        "<div id=b style='width:200px;height:100px;overflow:auto'><div style='height:200px'></div>"
        "<button style='display:block;height:60px' onclick=\"document.title = 'hit'\">Go</button>"
        "<div style='height:200px'></div></div><div style='height:400px'></div></div>"
        "<script>b.scrollTop = 170; a.scrollTop = 330</script>",
        "hit",
    ),
    "a page that reads from the right": (
        "<html dir=rtl><body><div style='width:2000px'>שלום<button onclick=\"document.title = 'hit'\">Go"
        "</button></div>",
        "hit",
    ),
    "a drawing": (
        "<svg width=200 height=100><g role=button aria-label=Go onclick=\"document.title = 'hit'\">"
        "<circle cx=60 cy=50 r=40 /></g></svg>",
        "hit",
    ),
    "a link of two lines": (
        "<div style='width:130px'>some words and <a href='#hit' onclick=\"document.title = 'hit'\" "
        "aria-label=Go>a link that wraps</a></div>",
        "hit",
    ),
}


@by_turns(CLICKED)
async def test_what_is_hard_to_click(site: Site, open_tab: Open, mode: str, name: str) -> None:
    body, title = CLICKED[name]
    tab = await open_tab(mode)
    await tab.goto(site.page(body))
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.title == title
    assert tab.notices == []


FIELDS = {
    "a paragraph in editable content": (
        f"<div contenteditable aria-label=F oninput='{SAID}'><p>old</p></div>",
        "שלום",
        "שלום",
    ),
    "an open root in an open root": (
        SHADOW.replace("BODY", "<input aria-label=F value=old oninput='SAY(this.value)'>"),
        "new",
        "new",
    ),
    "a frame": (
        f"<iframe srcdoc='<input aria-label=F value=old oninput=\"parent.{SAID}\">'></iframe>",
        "new",
        "new",
    ),
}


@MODES
@pytest.mark.parametrize(("field", "text", "title"), FIELDS.values(), ids=FIELDS.keys())
async def test_what_is_hard_to_type_into(
    site: Site, open_tab: Open, mode: str, field: str, text: str, title: str
) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(field))
    look = await tab.step(Type(tab.at("F"), text))
    assert look.observation.title == title
    assert tab.notices == []


@MODES
async def test_files_are_refused(site: Site, open_tab: Open, mode: str) -> None:
    tab = await open_tab(mode)
    await tab.goto(
        site.page(
            "<input type=file aria-label=Plain><label>Drawn<input type=file hidden></label>"
            "<button onclick='showOpenFilePicker()'>Picker</button>"
            '<input type=file multiple id=f hidden><button onclick="f.click()">Script</button>'
        )
    )
    refused = ("action_failed", "the page asked for a file; files cannot be uploaded")
    for name in ("Plain", "Drawn", "Picker", "Script"):
        await tab.step(LeftClick(tab.at(name)))
        assert tab.notices == [refused]
    await tab.step(Type(tab.at("Plain"), "/etc/passwd"))
    assert [kind for kind, _ in tab.notices][-1] == "action_failed"
    assert "files cannot be uploaded" in tab.notices[-1][1]


@MODES
async def test_the_wheel_in_nested_scrollers(site: Site, open_tab: Open, mode: str) -> None:
    """The one in the middle goes first; at its end the one around it."""
    rows = "".join(f"<p>Row {number}</p>" for number in range(30))
    tab = await open_tab(mode)
    await tab.goto(
        site.page(
            "<div style='position:fixed;inset:0;overflow:auto'><h1>Above</h1><div style='height:600px;"
            f"overflow:auto'>{rows}</div><div style='height:1500px'>Below</div></div>"
        )
    )
    assert {"Above", "Row 0"} <= set(tab.text)
    await tab.step(Scroll("down"))
    assert "Row 0" not in tab.text
    for _ in range(6):
        await tab.step(Scroll("down"))
    assert "Above" not in tab.text
    for _ in range(6):
        await tab.step(Scroll("up"))
    assert {"Above", "Row 0"} <= set(tab.text)
