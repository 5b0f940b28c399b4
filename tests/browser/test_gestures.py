"""Gestures on real pages: what they do to the page, and what is said where they cannot."""

from __future__ import annotations

import pytest

from webgym.browser.document import Document, DocumentElement, ReadRequest
from webgym.browser.gestures import Choose, Click, Fill, HoverAndScroll, HoverOver, ScrollElement, Wheel
from webgym.core.action import LeftClick, Press, Target

from .conftest import VIEWPORT, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

KEYS = """
<p id=log>.</p>
<script>addEventListener('keydown', (e) => log.append(e.key + '/' + e.code + ' '))</script>"""


async def whole(tab: Tab) -> Document:
    return await tab.slot.read(ReadRequest(lines=100, elements=True, meta=True))


async def element(tab: Tab, name: str) -> DocumentElement:
    elements = (await whole(tab)).elements
    found = [one for one in elements if one.name == name]
    assert found, f"no {name!r} among {[(one.tag, one.name) for one in elements]}"
    return found[0]


def at(x: float, y: float) -> Target:
    return Target(coordinate=(x / VIEWPORT[0] * 1000, y / VIEWPORT[1] * 1000))


def title(tab: Tab) -> str:
    assert tab.last is not None
    return tab.last.observation.title


async def test_an_element_out_of_sight_is_scrolled_to_and_clicked(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page("<div style='height:3000px'>top</div><button onclick=\"document.title='hit'\">Far</button>")
    )
    far = await element(tab, "Far")
    assert far.boxes[0][1] > 2000, "it is known, and known to be below"
    await tab.step(Click(Target(element=far.number)))
    assert title(tab) == "hit"
    assert tab.find("Far").number == far.number, "the same number in a look"


async def test_an_element_in_a_frame_far_down(site: Site, tab: Tab) -> None:
    site.page(
        "<div style='height:900px'></div><button onclick=\"top.document.title='framed'\">In</button>", "/in"
    )
    await tab.goto(
        site.page("<div style='height:2000px'></div><iframe src=/in width=300 height=200></iframe>")
    )
    await tab.step(Click(Target(element=(await element(tab, "In")).number)))
    assert title(tab) == "framed"


async def test_a_number_that_no_element_has(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<button>One</button>"))
    none = Target(element=999)
    for gesture in (Click(none), HoverOver(none), ScrollElement(999, "down"), Choose(999)):
        await tab.step(gesture)
        [(kind, text)] = tab.notices
        assert kind == "action_failed"
        assert "999" in text


async def test_an_element_that_left_the_document(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<button onclick='this.remove()'>Once</button>"))
    once = await element(tab, "Once")
    await tab.step(Click(Target(element=once.number)))
    assert tab.notices == []
    await tab.step(Click(Target(element=once.number)))
    assert "no element" in tab.notices[0][1]


async def test_hovering(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<style>ul { display: none } div:hover ul { display: block }</style>"
            "<div style='width:200px'><button>Menu</button><ul><li>Entry</ul></div>"
        )
    )
    await tab.step(HoverOver(Target(element=(await element(tab, "Menu")).number)))
    assert "Entry" in tab.text
    await tab.step(HoverOver(at(700, 500)))
    assert "Entry" not in tab.text


async def test_scrolling_what_lies_under_the_mouse(site: Site, tab: Tab) -> None:
    rows = "".join(f"<p>Row {number}</p>" for number in range(60))
    await tab.goto(
        site.page(
            f"<div id=box style='height:200px;width:300px;overflow:auto'>{rows}</div>"
            "<p style='height:3000px'>page</p><script>onscroll = () => document.title = scrollY;"
            "box.onscroll = () => document.title = 'box ' + box.scrollTop</script>"
        )
    )
    await tab.step(HoverAndScroll(at(100, 100)))
    assert title(tab) == "box 160", "four fifths of the box"
    await tab.step(HoverAndScroll(at(100, 100), "up"))
    assert title(tab) == "box 0"
    await tab.step(HoverAndScroll(at(600, 500)))
    assert title(tab) == "100", "a little of the page, where nothing else scrolls"
    await tab.step(Wheel(718))
    assert title(tab) == "818"
    await tab.step(Wheel(-200))
    assert title(tab) == "618"


async def test_the_wheel_over_a_page_whose_parts_scroll_alone(site: Site, tab: Tab) -> None:
    rows = "".join(f"<p>Row {number}</p>" for number in range(100))
    await tab.goto(site.page(f"<div style='position:fixed;inset:0;overflow:auto'>{rows}</div>"))
    await tab.step(Wheel(700))
    assert "Row 0" not in tab.text


async def test_scrolling_an_element(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<div id=box tabindex=0 aria-label=Box style='height:200px;width:300px;overflow:auto'>"
            "<div style='width:2000px;height:2000px'><button>Inner</button></div></div><script>"
            "box.onscroll = () => document.title = box.scrollLeft + ' ' + box.scrollTop</script>"
        )
    )
    box = await element(tab, "Box")
    assert box.scrolls
    inner = await element(tab, "Inner")
    for number, side in ((box.number, "down"), (inner.number, "right")):
        await tab.step(ScrollElement(number, side))  # type: ignore[arg-type]
    across, down = map(int, title(tab).split())
    assert across > 250
    assert down > 150
    await tab.step(ScrollElement(box.number, "left"))
    await tab.step(ScrollElement(box.number, "up"))
    assert title(tab) == "0 0"
    await tab.goto(site.page("<button>Alone</button>"))
    await tab.step(ScrollElement((await element(tab, "Alone")).number, "down"))
    assert "nothing scrolls" in tab.notices[0][1]


async def test_keys_arrive_as_the_page_expects_them(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(KEYS))
    for keys in (("Enter",), ("Control+b",), ("shift", "a"), ("?",), ("ArrowDown",), ("é",)):
        await tab.step(Press(keys))
    log = (await whole(tab)).text.lstrip(".").split()
    assert log == [
        "Enter/Enter",
        "Control/ControlLeft",
        "b/KeyB",
        "Shift/ShiftLeft",
        "A/KeyA",
        "?/Slash",
        "ArrowDown/ArrowDown",
        "é/",
    ]


async def test_keys_edit(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<input aria-label=Name value=old><input aria-label=Next>"))
    await tab.step(LeftClick(tab.at("Name")))
    for keys in (("Control+a",), ("Delete",), ("x",), ("Shift", "y"), ("Backspace",), ("Tab",), ("z",)):
        await tab.step(Press(keys))
    assert (tab.find("Name").value, tab.find("Next").value) == ("x", "z")


FILLS: dict[str, dict[str, object]] = {
    "old text": {},
    " text": {"delete_existing": True},
    "": {"text": "", "delete_existing": True},
    "old": {"text": ""},
}
"""By the value that a field with ``old`` has afterwards."""


@pytest.mark.parametrize(
    "field", ["<input value=old {}>", "<textarea {}>old</textarea>"], ids=["input", "textarea"]
)
async def test_filling_without_enter(site: Site, tab: Tab, field: str) -> None:
    fields = "".join(field.format(f"aria-label=Name{n}") for n in range(len(FILLS)))
    await tab.goto(
        site.page(
            f"<form action=/sent>{fields}</form><p id=seen></p>"
            "<script>oninput = (e) => seen.textContent = e.target.value</script>"
        )
    )
    for n, (value, gesture) in enumerate(FILLS.items()):
        number = (await element(tab, f"Name{n}")).number
        fill = {"text": " text", "press_enter": False, **gesture}
        await tab.step(Fill(Target(element=number), **fill))  # type: ignore[arg-type]
        assert tab.find(f"Name{n}").value == value
        assert tab.notices == []


async def test_filling_and_enter(site: Site, tab: Tab) -> None:
    site.page("<title>Sent</title>", "/sent")
    await tab.goto(site.page("<form action=/sent><input aria-label=Query></form>"))
    x, y, _, _ = tab.find("Query").box
    await tab.step(Fill(at(x + 5, y + 5), "boots"))
    assert title(tab) == "Sent"


async def test_filling_where_only_keys_are_heard(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(KEYS))
    await tab.step(Fill(at(600, 400), "Hi"))
    assert (await whole(tab)).text.lstrip(".").split() == ["H/KeyH", "i/KeyI", "Enter/Enter"]
    await tab.step(Fill(at(600, 400), "x" * 501))
    assert "200 key presses at most" in tab.notices[0][1]


DROPDOWN = (
    "<label>Colour <select><option>Red<option>Green<option disabled>Blue</select></label>"
    "<select multiple aria-label=Sizes><option>Small<option>Large</select>"
    "<script>onchange = (e) => document.title = e.target.value</script>"
)


@pytest.mark.parametrize(
    "by", [Choose, lambda number: Click(Target(element=number))], ids=["choose", "click"]
)
async def test_choosing_an_option_by_its_number(site: Site, tab: Tab, by: object) -> None:
    await tab.goto(site.page(DROPDOWN))
    assert callable(by)
    green = await element(tab, "Green")
    assert (green.tag, green.role, green.boxes) == ("option", "option", ())
    await tab.step(by(green.number))
    assert title(tab) == "Green"
    assert tab.find("Colour", "combobox").value == "Green"
    await tab.step(by((await element(tab, "Large")).number))
    assert title(tab) == "Large", "an option that is drawn in the page is clicked"
    assert "Blue" not in [one.name for one in (await whole(tab)).elements], "what is disabled is not offered"


async def test_reading_a_document(site: Site, tab: Tab) -> None:
    url = site.page(
        "<title>Boots</title><meta name=description content='Good boots'>"
        "<meta property=og:type content=product>"
        '<script type="application/ld+json">{"@type": "Product"}</script>'
        "<div itemscope itemtype=https://schema.org/Product><b itemprop=name>Boot</b>"
        "<span itemprop=offer itemscope itemtype=https://schema.org/Offer>"
        "<meta itemprop=price content=5></span>"
        "<i itemprop=colour>red</i><i itemprop=colour>blue</i></div>"
        "<h1>Boots</h1><p>line two</p><div style='height:4000px'></div><p>far below</p>"
        "<input type=search placeholder=Find><input type=hidden name=x>"
    )
    await tab.goto(url)
    document = await whole(tab)
    assert (document.url, document.title) == (url, "Boots")
    assert document.text.split("\n")[-1] == "far below"
    assert "Boots" in document.text
    assert document.meta["description"] == "Good boots"
    assert document.meta["og:type"] == "product"
    assert document.linked == ('{"@type": "Product"}',)
    [item] = document.items
    assert item["name"] == "Boot"
    assert item["offer"] == {"itemType": "https://schema.org/Offer", "price": "5"}
    assert item["colour"] == ["red", "blue"]
    [find] = document.elements
    assert (find.tag, find.type, find.role, find.name) == ("input", "search", "searchbox", "Find")
    first = await tab.slot.read(ReadRequest(lines=1))
    assert (first.text.count("\n"), first.elements, first.meta) == (0, (), {})


async def test_reading_a_blank_page(new_tab: Tab) -> None:
    document = await whole(new_tab)
    assert document == Document("about:blank")


async def test_what_was_copied_is_pasted_in_the_same_episode_alone(site: Site, new_tab: Tab) -> None:
    url = site.page("<input aria-label=Field value=secret>")

    async def paste() -> str | None:
        await new_tab.goto(url)
        await new_tab.step(Click(new_tab.at("Field")))
        await new_tab.step(Press(("Control+a",)))
        await new_tab.step(Press(("Delete",)))
        await new_tab.step(Press(("Control+v",)))
        return new_tab.find("Field").value

    await new_tab.goto(url)
    await new_tab.step(Click(new_tab.at("Field")))
    for keys in ("Control+a", "Control+c"):
        await new_tab.step(Press((keys,)))
    assert await paste() == "secret"
    await new_tab.slot.close()
    await new_tab.slot.open(new_tab.options)
    assert await paste() == ""
