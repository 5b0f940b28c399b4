"""What a page can make endless is cut before it is observed, and the observation says so."""

from __future__ import annotations

import time

import msgspec
import pytest

from webgym.browser import isolated_worlds
from webgym.browser.cdp_messages import Evaluated
from webgym.browser.config import BrowserConfig
from webgym.browser.document import ReadRequest
from webgym.browser.isolated_worlds import (
    ADDRESS_CHARACTERS,
    NAME_CHARACTERS,
    OBSERVED_ELEMENTS,
    TITLE_CHARACTERS,
    VALUE_CHARACTERS,
)
from webgym.core.action import LeftClick, Navigate, Type

from .conftest import Open, Site, Tab, one_in

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

MOST_BYTES = 500_000
SECONDS = 2.0
"""For a look at a page that is quiet already."""

LAID_OUT = {"select", "several", "textarea", "button", "placeholder", "elements"}
"""What the browser itself takes long to draw."""

HUGE = {
    "title": ("document.title = 'x'.repeat(20e6)", "the title"),
    "link": ("link.href = '/next?' + 'x'.repeat(30e6)", "an address"),
    "fragment": ("link.href = '#' + 'x'.repeat(30e6)", "an address"),
    "data": ("link.href = 'data:text/plain,' + 'x'.repeat(30e6)", "an address"),
    "hash": ("location.hash = 'x'.repeat(1.5e6)", "an address"),
    "name": ("link.ariaLabel = 'x '.repeat(15e6)", "the name of an element"),
    "select": ("choice.options[0].label = 'x'.repeat(3e5)", "what stands in a field"),
    "several": (
        "choice.multiple = true;"
        "for (let i = 0; i < 2e3; i++) choice.append(new Option('x'.repeat(99), i, true, true))",
        "what stands in a field",
    ),
    "textarea": ("area.value = 'x'.repeat(1e6)", "what stands in a field"),
    "button": ("button.value = 'x '.repeat(2e5)", "what stands in a field, the name of an element"),
    "placeholder": ("field.placeholder = 'x'.repeat(1e6)", "what stands in a field, the name of an element"),
    "fields": (
        "many.innerHTML = `<input value=${'x'.repeat(9e3)}>`.repeat(30)",
        "the text, what stands in a field",
    ),
    "elements": (
        "many.innerHTML = '<a href=/x style=\"float:left;width:8px;height:8px\"></a>'.repeat(2100)",
        "the list of elements",
    ),
}
PAGE = """
<a id=link href=/next>Next</a> <select id=choice><option>One<option>Two</select> <input id=field>
<input id=button type=button value=Press> <textarea id=area style='height:20px'></textarea><div id=many></div>
"""


@pytest.mark.parametrize("kind", one_in(3, HUGE))
async def test_what_is_too_long_is_cut_and_told(site: Site, tab: Tab, kind: str) -> None:
    script, told = HUGE[kind]
    await tab.goto(site.page(f"<title>Short</title>{PAGE}<script>{script}</script>"))
    start = time.monotonic()
    look = (await tab.step()).observation
    assert time.monotonic() - start < SECONDS or kind in LAID_OUT
    metadata = await tab.slot.metadata()
    assert len(msgspec.json.encode(look)) < MOST_BYTES
    assert tab.notices == [("shortened", told)]
    assert len(look.title) <= TITLE_CHARACTERS
    assert len(look.url) <= ADDRESS_CHARACTERS
    assert len(look.elements or ()) <= OBSERVED_ELEMENTS
    for element in look.elements or ():
        assert len(element.name) <= NAME_CHARACTERS
        assert len(element.href or "") <= ADDRESS_CHARACTERS
        assert len(element.value or "") <= VALUE_CHARACTERS
    assert (metadata.url, metadata.title) == (look.url, look.title)
    read = await tab.slot.read(ReadRequest(elements=True))
    assert (read.url, read.title) == (look.url, look.title)
    assert len(msgspec.json.encode(read)) < 2_000_000


async def test_the_text_and_the_lines_that_are_cut_off_are_bounded(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.isolated_worlds.TEXT_CHARACTERS", 50)
    tab = await open_tab(config=BrowserConfig(), text=True, cuts=True)
    line = "<p style='width:80px;overflow:hidden;white-space:nowrap'>Some words that do not fit</p>"
    look = await tab.goto(site.page(line * 10))
    assert len(look.observation.text or "") == 50
    assert len(look.observation.cuts) == 1
    assert tab.notices == [("shortened", "the text")]


async def test_frames_of_other_origins_are_bounded(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.isolated_worlds.TEXT_CHARACTERS", 50)
    monkeypatch.setattr("webgym.browser.isolated_worlds.VALUE_CHARACTERS", 9)
    monkeypatch.setattr("webgym.browser.isolated_worlds.OBSERVED_ELEMENTS", 3)
    tab = await open_tab(config=BrowserConfig())
    inner = f"<p>Seen</p><input value={'x' * 99}>{'<button>B</button>' * 5}<p>{'words ' * 30}</p>"
    await tab.goto(
        site.page(f"<iframe src={site.elsewhere(site.page(inner))} width=900 height=300></iframe>")
    )
    assert tab.text[0] == "Seen"
    assert len("".join(tab.text)) <= 50
    assert tab.last is not None
    assert [element.value for element in tab.last.observation.elements or ()] == ["x" * 9, None, None]
    assert tab.notices == [("shortened", "the text, what stands in a field, the list of elements")]


async def test_a_long_list_of_options_is_cut_and_told(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.isolated_worlds.LISTED_OPTIONS", 3)
    tab = await open_tab(config=BrowserConfig())
    options = "".join(f"<option>Size {number} {'x' * 999}" for number in range(50))
    await tab.goto(site.page(f"<select aria-label=Size>{options}</select>"))
    await tab.step(LeftClick(tab.at("Size")))
    assert tab.last is not None
    names = [one.name for one in tab.last.observation.elements or () if one.role == "option"]
    assert [(name[:6], len(name)) for name in names] == [(f"Size {number}", 200) for number in range(3)]
    assert tab.notices == [("shortened", "the name of an element, the open list of options")]
    await tab.step(Type(tab.at("Size"), "Size 40"))
    assert (tab.find("Size").value or "").startswith("Size 40")
    await tab.step(Type(tab.at("Size"), "Colour"))
    (told,) = [told for kind, told in tab.notices if kind != "shortened"]
    assert len(told) < 12 * (NAME_CHARACTERS + 10)


async def test_a_dialog_is_told_in_short(site: Site, tab: Tab) -> None:
    await tab.step(Navigate(site.page("<script>prompt('x'.repeat(1e6), 'y'.repeat(1e6))</script>")))
    ((kind, told),) = tab.notices
    assert (kind, len(told) < 1_000) == ("dialog", True)


async def test_boxes_out_of_view_leave_room_for_what_is_in_view(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.isolated_worlds.OBSERVED_ELEMENTS", 5)
    tab = await open_tab(config=BrowserConfig())
    boxes = "<div><input type=checkbox></div>" * 50
    await tab.goto(
        site.page(f"<div style='margin-top:-5000px;height:5000px'>{boxes}</div><button>Seen</button>")
    )
    assert tab.find("Seen").role == "button"


MEASURING = """
globalThis.measured = 0;
for (const [owner, name] of [[Range.prototype, 'getClientRects'], [Document.prototype, 'elementFromPoint']]) {
  const own = owner[name];
  owner[name] = function (...given) { measured += 1; return own.apply(this, given); };
}
"""
"""Counts how often our scripts have the browser go through all of a text."""


@pytest.mark.parametrize("style", ["", "white-space: pre-wrap"])
async def test_a_very_long_text_is_measured_a_few_times(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch, style: str
) -> None:
    monkeypatch.setattr(isolated_worlds, "_SCRIPT", MEASURING + isolated_worlds._SCRIPT)
    tab = await open_tab(viewport=(800, 600), text=True)
    await tab.goto(site.page(f"<body style='{style}'>{'words and more ' * 30_000}"))
    page = tab.slot.page
    world = {"contextId": page.worlds._worlds[page.target_id], "expression": "measured"}
    before = await page.session.call("Runtime.evaluate", world, reply=Evaluated, seconds=5)
    look = await tab.slot.observe()
    after = await page.session.call("Runtime.evaluate", world, reply=Evaluated, seconds=5)
    assert int(bytes(after.result.value)) - int(bytes(before.result.value)) < 300
    words = (look.observation.text or "").split()
    assert len(words) > 500
    assert set(words) <= {"words", "and", "more", "…"}


async def test_a_line_that_is_too_long_to_be_measured_is_told(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(f"<p>before</p><pre>{'x' * 2_500_000}</pre><p>after</p>"))
    assert tab.text == ["before", "after"]
    assert ("shortened", "the text") in tab.notices


async def test_a_screenshot_that_is_late_counts(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(screenshot_try_seconds=0.001, screenshot_seconds=3))
    await tab.goto(site.page("<p>here"))
    assert tab.text == ["here"]
