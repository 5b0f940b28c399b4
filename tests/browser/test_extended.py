"""The extended actions on real pages: what each does, and what is said where it cannot."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from webgym.browser.cdp import Session
from webgym.browser.config import BrowserConfig
from webgym.core.action import (
    DoubleClick,
    Drag,
    Hold,
    Hover,
    LeftClick,
    Press,
    RightClick,
    Scroll,
    Target,
    Type,
    Upload,
)
from webgym.core.task import Attachment

from .conftest import MODES, VIEWPORT, Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

LOG = """<p id=log>.</p><script>
const say = (...words) => log.append(words.join(' ') + '; ');
</script>"""


def log(tab: Tab) -> list[str]:
    [line] = [line for line in tab.text if line.startswith(".")]
    return [part.strip() for part in line.lstrip(".").split(";") if part.strip()]


def at(x: float, y: float) -> Target:
    return Target(coordinate=(x / VIEWPORT[0] * 1000, y / VIEWPORT[1] * 1000))


@MODES
async def test_every_kind_of_click(site: Site, open_tab: Open, mode: str) -> None:
    tab = await open_tab(mode)
    await tab.goto(
        site.page(
            LOG + "<button id=b style='width:200px;height:80px'>Here</button><script>"
            "for (const name of ['click', 'dblclick', 'contextmenu', 'mouseenter']) b.addEventListener(name,"
            "(e) => say(e.type, [e.ctrlKey, e.altKey, e.shiftKey].map(Number).join('')));"
            "addEventListener('keydown', (e) => say(e.type, e.key));"
            "addEventListener('keyup', (e) => say(e.type, e.key));</script>"
        )
    )
    here = tab.at("Here")
    await tab.step(Hover(here))
    assert log(tab) == ["mouseenter 000"]
    await tab.step(DoubleClick(here))
    assert log(tab)[1:] == ["click 000", "click 000", "dblclick 000"]
    await tab.step(RightClick(here))
    assert log(tab)[4:] == ["contextmenu 000"]
    await tab.step(LeftClick(here, ("Control", "Shift")))
    held = ["keydown Control", "keydown Shift", "click 101", "keyup Shift", "keyup Control"]
    assert log(tab)[5:] == held
    await tab.step(LeftClick(here))
    assert log(tab)[10:] == ["click 000"], "the keys were let go"


async def test_a_number_of_an_earlier_picture_moves_nothing(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(site.page("<title>x</title><div style='height:1000px'></div><button>Far</button>"))
    await tab.step(Scroll("down"))
    far = tab.at("Far")
    await tab.step(Scroll("up"))
    look = await tab.step(Hover(far))
    assert [kind for kind, _ in tab.notices] == ["action_failed"]
    assert not look.observation.elements


async def test_ctrl_and_click_chooses_several(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<select multiple size=4 aria-label=Sizes><option>S<option>M<option>L</select>"
            "<script>onchange = (e) => document.title ="
            " [...e.target.selectedOptions].map((one) => one.value)</script>"
        )
    )
    await tab.step(LeftClick(tab.at("S", "option")))
    look = await tab.step(LeftClick(tab.at("L", "option"), ("Control",)))
    assert look.observation.title == "S,L"


@pytest.mark.parametrize("modifiers", [("Control",), ("Shift",)], ids=str)
async def test_a_link_that_is_opened_beside_opens_here(
    site: Site, tab: Tab, modifiers: tuple[str, ...]
) -> None:
    there = site.page("<title>There</title>")
    await tab.goto(site.page(f"<a href='{there}'>Link</a>"))
    look = await tab.step(LeftClick(tab.at("Link"), modifiers))  # type: ignore[arg-type]
    assert look.observation.title == "There"
    assert [kind for kind, _ in tab.notices] == ["popup"]


SORTED = (
    """<style>li, #bin { width: 200px; height: 40px; border: 1px solid }</style>
<ul id=list><li draggable=true>One<li draggable=true>Two</ul><div id=bin>Bin</div>"""
    + LOG
    + """<script>
let held;
addEventListener('dragstart', (e) => { held = e.target; e.dataTransfer.setData('text', held.textContent); });
bin.ondragover = (e) => e.preventDefault();
bin.ondrop = (e) => { e.preventDefault(); say('drop', e.dataTransfer.getData('text')); bin.append(held); };
addEventListener('dragend', () => say('end'));
</script>"""
)


async def test_what_html_makes_draggable_is_dragged(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(SORTED))
    await tab.step(Drag(at(100, 70), at(100, 130)))
    assert log(tab)[0] == "drop Two"
    assert "end" in log(tab)
    assert tab.text.index("Two") > tab.text.index("Bin")
    await tab.step(LeftClick(at(100, 30)))
    assert len(log(tab)) == 2, "nothing is held any more"


LONG = """<style>#a { position: absolute; left: 20px; top: 20px; width: 100px; height: 40px }</style>
<div id=a>Card</div><p id=s style="margin-top:200px">still</p><script>
let timer, isHeld;
a.onpointerdown = (e) => {
  a.setPointerCapture(e.pointerId);
  timer = setTimeout(() => { isHeld = true; s.textContent = 'held'; }, 250);
};
a.onpointermove = (e) => isHeld ? a.style.left = e.clientX - 50 + 'px' : e.buttons && clearTimeout(timer);
a.onpointerup = (e) => {
  clearTimeout(timer);
  if (isHeld) s.textContent += ' and dropped at ' + Math.round(e.clientX);
  isHeld = false;
};
</script>"""


async def test_holding_the_button_down(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(LONG))
    await tab.step(Drag(at(70, 40), at(470, 40)))
    assert tab.text[-1] == "still", "the list takes it for a scroll"
    await tab.step(Hold(at(70, 40), 0.1))
    assert tab.text[-1] == "still"
    await tab.step(Hold(at(70, 40), 0.4))
    assert tab.text[-1] == "held and dropped at 70"
    await tab.step(Drag(at(70, 40), at(470, 40), time=0.4))
    assert tab.text[-1] == "held and dropped at 470"


FORGED = (
    LOG
    + """<script>
addEventListener('mousemove', (e) => e.buttons && dispatchEvent(new Event('dragstart', { bubbles: true })));
addEventListener('mouseup', () => say('up'));
</script>"""
)


async def test_a_drag_that_only_the_page_speaks_of_is_none(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(FORGED))
    await tab.step(Drag(at(100, 70), at(100, 130)))
    assert log(tab) == ["up"]


@pytest.fixture
def not_handed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chromium says nothing of the drags that it intercepts."""
    on = Session.on

    def deaf(self: Session, event: str, *more: Any) -> Any:
        return on(self, event.replace("dragIntercepted", "none"), *more)

    monkeypatch.setattr(Session, "on", deaf)


@pytest.mark.usefixtures("not_handed_over")
async def test_a_drag_that_is_not_handed_over_ends_with_the_button_up(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(execute_seconds=2.0))
    await tab.goto(site.page(SORTED))
    await tab.step(Drag(at(100, 70), at(100, 130)))
    await tab.step(LeftClick(at(100, 30)))
    assert [entry for entry in log(tab) if entry.startswith("drop")] == []


async def test_what_follows_the_mouse_is_dragged(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<div id=knob style='position:absolute;left:50px;top:100px;width:40px;height:40px;"
            "background:#06c'></div><script>let from = null; let moves = 0;"
            "knob.onpointerdown = (e) => { from = [e.clientX - knob.offsetLeft, e.clientY - knob.offsetTop];"
            "knob.setPointerCapture(e.pointerId); };"
            "knob.onpointermove = (e) => { if (!from) return; moves += 1;"
            "knob.style.left = e.clientX - from[0] + 'px'; knob.style.top = e.clientY - from[1] + 'px'; };"
            "knob.onpointerup = () => { from = null; document.title ="
            "[knob.offsetLeft, knob.offsetTop, moves > 4] };</script>"
        )
    )
    look = await tab.step(Drag(at(70, 120), at(570, 320)))
    assert look.observation.title == "550,300,true"


async def test_a_slider_and_a_selection_are_dragged(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(
        site.page(
            "<input type=range min=0 max=100 value=0 aria-label=Volume style='width:400px;margin:0'>"
            "<p style='font:40px monospace;margin:0'>abcdef</p>"
        )
    )
    x, y, _, height = tab.find("Volume").box
    middle = y + height / 2
    await tab.step(Drag(at(x + 8, middle), at(x + 200, middle)))
    assert 45 <= float(tab.find("Volume").value or 0) <= 55


async def test_a_drag_passes_the_points_of_its_path(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<canvas id=c width=600 height=400 style='position:absolute;left:0;top:0'></canvas><script>"
            "let seen = null; addEventListener('mousedown', (e) => { seen = [[e.clientX, e.clientY]]; });"
            "addEventListener('mousemove', (e) => seen && seen.push([e.clientX, e.clientY]));"
            "addEventListener('mouseup', () => { document.title = JSON.stringify(seen); seen = null; });"
            "</script>"
        )
    )
    ring = [
        (300 + 80 * math.cos(turn), 200 + 80 * math.sin(turn))
        for turn in (math.tau * i / 12 for i in range(13))
    ]
    between = tuple(at(*point).coordinate or (0, 0) for point in ring[1:-1])
    look = await tab.step(Drag(at(*ring[0]), at(*ring[-1]), between))
    passed = json.loads(look.observation.title)
    assert all(77 < math.dist(point, (300, 200)) < 81.5 for point in passed), "nowhere off the ring"
    reached = [min(range(len(passed)), key=lambda i: math.dist(passed[i], point)) for point in ring[1:-1]]
    assert reached == sorted(set(reached)), "one after the other"
    assert all(math.dist(passed[i], point) < 2 for i, point in zip(reached, ring[1:-1], strict=True))


async def test_keys_are_pressed_by_name(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<input aria-label=One value=abc><input aria-label=Two>"))
    await tab.step(LeftClick(tab.at("One")))
    await tab.step(Press(("Control+a",)))
    await tab.step(Press(("Backspace",)))
    await tab.step(Press(("Tab",)))
    await tab.step(Press(("x",)))
    assert (tab.find("One").value, tab.find("Two").value) == ("", "x")
    await tab.step(Press(("Bogus",)))
    [(kind, text)] = tab.notices
    assert kind == "action_failed"
    assert '"Bogus"' in text


async def test_typing_without_enter(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<form action=/sent><input aria-label=Name value=old></form>"))
    await tab.step(Type(tab.at("Name"), "new", enter=False))
    assert tab.find("Name").value == "new"


BOXES = (
    "<style>.box { width: 300px; height: 200px; overflow: auto; position: absolute; top: 50px }"
    ".box div { width: 1500px; height: 1500px }</style>"
    "<div class=box id=left><div>left</div></div><div class=box id=right style='left:600px'><div>right</div>"
    "</div><p style='height:3000px'></p><script>addEventListener('scroll', () => { document.title ="
    "[left.scrollLeft, left.scrollTop, right.scrollLeft, right.scrollTop, scrollY] }, true)</script>"
)


async def test_the_box_that_is_named_scrolls_to_every_side(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(BOXES))
    shown = 200 - 15  # without the scroll bar
    seen = []
    for action in (
        Scroll("down", at(700, 150)),
        Scroll("right", at(700, 150)),
        Scroll("right", at(100, 150)),
        Scroll("left", at(700, 150)),
        Scroll("up", at(700, 150)),
        Scroll("down", at(450, 400)),
    ):
        look = await tab.step(action)
        seen.append([float(part) for part in look.observation.title.split(",")])
    across, down = (300 - 15) * 0.75, shown * 0.75
    expected = [
        [0, 0, 0, down, 0],
        [0, 0, across, down, 0],
        [across, 0, across, down, 0],
        [across, 0, 0, down, 0],
        [across, 0, 0, 0, 0],
        [across, 0, 0, 0, VIEWPORT[1] * 0.75],
    ]
    for found, wanted in zip(seen, expected, strict=True):
        assert found == pytest.approx(wanted, abs=15)


FILES = (Attachment("cv.txt", text="Ann, baker"), Attachment("photo.png", data=b"\x89PNG"))
TAKES = (
    LOG
    + """<label>Plain <input type=file id=plain></label><label for=hidden>Hidden by its page</label>
<input type=file id=hidden multiple style="display:none"><button
onclick="setTimeout(() => other.click(), 30)">Other</button><input type=file id=other hidden>
<p>nothing here</p><script>
addEventListener('change', async (e) => {
  for (const file of e.target.files) say(e.target.id, file.name, file.size, (await file.text()).slice(-5));
});</script>"""
)


async def test_files_of_the_task_are_chosen(site: Site, open_tab: Open) -> None:
    tab = await open_tab(files=FILES)
    await tab.goto(site.page(TAKES))
    await tab.step(Upload(tab.at("Plain"), ("cv.txt",)))
    assert log(tab) == ["plain cv.txt 10 baker"]
    await tab.step(Upload(tab.at("Other"), ("cv.txt",)))
    assert log(tab)[1:] == ["other cv.txt 10 baker"]
    await tab.step(Upload(tab.at("Hidden by its page"), ("cv.txt", "photo.png")))
    assert [part.rsplit(" ", 1)[0] for part in log(tab)[2:]] == ["hidden cv.txt 10", "hidden photo.png 4"]
    assert tab.notices == []


DROPS = (
    LOG
    + """<style>div { width: 300px; height: 100px; border: 1px solid }</style><div id=zone>Drop here</div>
<div>Not here</div><iframe style='width:300px;height:100px' srcdoc="<body style='height:80px'><script>
ondragover = (e) => e.preventDefault();
ondrop = (e) => { e.preventDefault(); parent.log.append('frame ' + e.dataTransfer.files[0].name); };
</script>">
</iframe>
<script>
let entered = 0;
zone.ondragenter = () => entered++;
zone.ondragover = (e) => e.preventDefault();
zone.ondrop = async (e) => {
  e.preventDefault();
  for (const file of e.dataTransfer.files) say(entered, file.name, await file.text());
};</script>"""
)


async def test_files_of_the_task_are_dropped_where_none_is_asked_for(site: Site, open_tab: Open) -> None:
    tab = await open_tab(files=FILES)
    home = site.page(DROPS)
    await tab.goto(home)
    await tab.step(Upload(at(150, 90), ("cv.txt",)))
    assert log(tab) == ["1 cv.txt Ann, baker"]
    await tab.step(Upload(at(150, 300), ("photo.png",)))
    assert log(tab)[1:] == ["frame photo.png"]
    look = await tab.step(Upload(at(150, 200), ("cv.txt",)))
    assert tab.notices == [("action_failed", "nothing at this place asks for a file")]
    assert look.observation.url == home, "it was not opened"


async def test_no_other_files_are_chosen(site: Site, open_tab: Open) -> None:
    tab = await open_tab(files=FILES)
    await tab.goto(site.page(TAKES))
    for names, why in (
        (("/etc/passwd",), "no file"),
        (("../chromium.log",), "no file"),
        (("cv.txt", "photo.png"), "only one"),
    ):
        await tab.step(Upload(tab.at("Plain"), names))
        [(kind, text)] = tab.notices
        assert kind == "action_failed"
        assert why in text
    await tab.step(Upload(at(600, 600), ("cv.txt",)))
    assert "asks for a file" in tab.notices[0][1]
    await tab.step(LeftClick(tab.at("Plain")))
    assert "upload" in tab.notices[0][1]
    assert log(tab) == []
    await tab.slot.close()
    await tab.slot.open(tab.options.__class__(text=True, elements=True))
    await tab.goto(site.page(TAKES))
    await tab.step(Upload(tab.at("Plain"), ("cv.txt",)))
    assert "its files: none" in tab.notices[0][1], "the next episode has none of them"
