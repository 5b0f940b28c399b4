"""Marks against the document's own truth.

Pages of many cases are generated from a seed. An oracle in the page, which shares no code with ours, finds
out by hit tests on a fine grid which elements can be clicked, and where; marks must agree with it.
"""

from __future__ import annotations

import io
import itertools
import operator
import random
from collections.abc import Iterable
from typing import Any

import msgspec
import pytest
from PIL import Image, ImageChops, ImageColor

from webgym.browser.observe import capture
from webgym.core.action import LeftClick, Scroll
from webgym.core.observation import Element

from .conftest import MODES, VIEWPORT, Open, Site, Tab, one_in

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

STEP = 5
"""Pixels between the oracle's hit tests."""

ORACLE = """
(() => {
  const down = (x, y) => {
    let [root, left, top] = [document, 0, 0];
    for (;;) {
      const element = root.elementFromPoint(x - left, y - top);
      if (!element) return null;
      const inner = element.shadowRoot;
      if (inner && inner !== root && inner.elementFromPoint(x - left, y - top) !== element) {
        root = inner;
      } else if (element.localName === 'iframe' && element.contentDocument) {
        const box = element.getBoundingClientRect();
        left += box.left + element.clientLeft;
        top += box.top + element.clientTop;
        root = element.contentDocument;
      } else return element;
    }
  };
  const owner = (element) => {
    for (let node = element; node; node = node.assignedSlot || node.parentNode || node.host)
      if (node.dataset && node.dataset.case) return node.dataset.case;
    return null;
  };
  const seen = {};
  for (let y = STEP / 2; y < innerHeight; y += STEP)
    for (let x = STEP / 2; x < innerWidth; x += STEP) {
      const element = down(x, y);
      const name = element && owner(element);
      if (name) (seen[name] = seen[name] || []).push([x, y]);
    }
  return seen;
})()
""".replace("STEP", str(STEP))

OWNER_AT = """
((points) => points.map(([x, y]) => {
  let root = document;
  let element = null;
  for (;;) {
    element = root.elementFromPoint(x, y);
    if (element && element.shadowRoot && element.shadowRoot !== root
        && element.shadowRoot.elementFromPoint(x, y) !== element) root = element.shadowRoot;
    else if (element && element.localName === 'iframe' && element.contentDocument) {
      const box = element.getBoundingClientRect();
      [x, y] = [x - box.left - element.clientLeft, y - box.top - element.clientTop];
      root = element.contentDocument;
    } else break;
  }
  for (let node = element; node; node = node.assignedSlot || node.parentNode || node.host)
    if (node.dataset && node.dataset.case) return node.dataset.case;
  return null;
}))(POINTS)
"""

Point = tuple[float, float]


class _Value(msgspec.Struct):
    value: Any = None


class _Result(msgspec.Struct):
    result: _Value


async def evaluate(tab: Tab, expression: str) -> Any:
    """In the page's own world, which our scripts do not touch."""
    page = tab.slot.page
    params = {"expression": expression, "returnByValue": True}
    done = await page.session.call("Runtime.evaluate", params, reply=_Result, seconds=30)
    return done.result.value


# --- pages --------------------------------------------------------------------------------------------

MARKED = "data-case={n} aria-label={n}"
BUTTON = "<button {m} style='{style}'>{n}</button>"

CASES: dict[str, str] = {
    "plain": BUTTON,
    "link": "<a {m} href=#x style='{style}'>a link of several words that wraps</a>",
    "block in a link": "<a {m} href=#x><div style='{style}'>block</div></a>",
    "float in a link": "<a {m} href=#x><span style='float:left;{style}'>f</span></a>",
    "cursor": "<div {m} style='cursor:pointer;{style}'>div</div>",
    "covered": BUTTON + "<i style='position:absolute;inset:0;background:#ddd'></i>",
    "half covered": BUTTON + "<i style='position:absolute;inset:0 50% 0 0;background:#ddd'></i>",
    "covered below": BUTTON + "<i style='position:absolute;inset:{a}px 0 0 0;background:#ddd'></i>",
    "under glass": BUTTON + "<i style='position:absolute;inset:0'></i>",
    "under what lets through": BUTTON + "<i style='position:absolute;inset:0;pointer-events:none'></i>",
    "transparent": "<button {m} style='opacity:0;{style}'>x</button>",
    "in transparent": "<div style='opacity:0'>" + BUTTON + "</div>",
    "hidden": "<button {m} style='visibility:hidden;{style}'>x</button>",
    "seen in hidden": "<div style='visibility:hidden'><button {m} "
    "style='visibility:visible;{style}'>x</button></div>",
    "not displayed": "<div hidden>" + BUTTON + "</div>",
    "not there for the mouse": "<button {m} style='pointer-events:none;{style}'>x</button>",
    "clipped": "<div style='clip-path:inset(0 {a}px 0 0)'>" + BUTTON + "</div>",
    "round": "<button {m} style='clip-path:circle(40%);{style}'>x</button>",
    "cut off": "<div style='width:{a}px;height:40px;overflow:hidden'>" + BUTTON + "</div>",
    "cut away": "<div style='width:60px;height:20px;overflow:hidden'><p style='height:60px;margin:0'></p>"
    + BUTTON + "</div>",
    "out of the flow": "<div style='width:30px;height:20px;overflow:hidden'>"
    "<button {m} style='position:absolute;top:30px;{style}'>x</button></div>",
    "in a scroller": "<div class=scroller style='width:120px;height:50px;overflow:auto'>"
    "<p style='height:{a}px;margin:0'></p>" + BUTTON + "<p style='height:200px'></p></div>",
    "contents": "<button {m} style='display:contents'><span style='display:block;{style}'>x</span></button>",
    "inert": "<div inert>" + BUTTON + "</div>",
    "disabled": "<button disabled {m} style='{style}'>x</button>",
    "in disabled": "<fieldset disabled style='margin:0;padding:0;border:0'>" + BUTTON + "</fieldset>",
    "aria-disabled": "<a href=#x aria-disabled=true {m} style='{style}'>x</a>",
    "no size": "<button {m} style='width:0;height:0;padding:0;border:0'></button>",
    "turned": "<button {m} style='transform:rotate({a}deg);{style}'>x</button>",
    "scaled": "<button {m} style='transform:scale(.5);{style}'>x</button>",
    "zoomed": "<div style='zoom:1.3'>" + BUTTON + "</div>",
    "behind": "<div style='background:#eee;width:130px;height:90px'>"
    "<button {m} style='position:absolute;left:0;top:0;z-index:-1;{style}'>x</button></div>",
    "sticky": "<div style='height:80px;overflow:auto'><div style='position:sticky;top:0'>" + BUTTON
    + "</div><p style='height:300px'></p></div>",
    "closed details": "<details><summary>s</summary>" + BUTTON + "</details>",
    "open details": "<details open><summary>s</summary>" + BUTTON + "</details>",
    "in a popover": "<div popover=manual class=pop style='inset:auto;left:{x}px;top:{y}px;margin:0;padding:0;"
    "border:0'>" + BUTTON + "</div>",
    "skipped content": "<div style='content-visibility:hidden;width:90px;height:40px'>" + BUTTON + "</div>",
    "slotted": "<x-open><template shadowrootmode=open><div style='padding:3px'><slot></slot></div></template>"
    + BUTTON + "</x-open>",
    "in a shadow": "<x-open><template shadowrootmode=open>" + BUTTON + "</template></x-open>",
    "not slotted": "<x-open><template shadowrootmode=open><p>shadow</p></template>" + BUTTON + "</x-open>",
    "framed": "<iframe srcdoc=\"<style>*{{margin:0}}</style>" + BUTTON
    + "\" style='width:110px;height:60px;border:{b}px solid'></iframe>",
    "framed and cut": "<div style='width:60px;height:40px;overflow:hidden'>"
    "<iframe srcdoc=\"<style>*{{margin:0}}</style>"
    + BUTTON
    + "\" style='width:110px;height:60px;border:0'></iframe></div>",
    "drawing": "<svg width=90 height=50><a {m} href=#x><rect width=80 height=40 /></a></svg>",
    "area": "<img usemap=#{n} width=90 height=60 src=\"data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg'/>\">"
    "<map name={n}><area {m} href=#x coords='{b},{b},70,400'></map>",
    "round area": "<img usemap=#{n} width=90 height=60 style='zoom:1.2' "
    "src=\"data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg'/>\">"
    "<map name={n}><area {m} href=#x shape=circle coords='45 30 20'></map>",
    "canvas": "<canvas {m} tabindex=0 width=80 height=40></canvas>",
    "text field": "<input {m} style='{style}'>",
    "editable": "<div contenteditable {m} style='{style}'>edit</div>",
    "beyond the edge": "<button {m} style='position:fixed;right:{c}px;bottom:{c}px;"
    "{style}'>x</button>",
    "far away": "<button {m} style='position:absolute;left:-5000px;{style}'>x</button>",
}  # fmt: skip

UNSEEN = {"transparent", "in transparent"}
"""What the mouse would reach, but no eye."""
OFF = {"disabled", "in disabled", "aria-disabled"}
ROUGH = {"round area", "half covered", "covered below", "clipped", "round", "turned", "beyond the edge"}
"""Seen in part, and not along the sides of a box: the middle of what is marked must be seen, no more."""
CELL = (150, 110)
PER_PAGE = 8 * 6


def generated(seed: int, kinds: Iterable[str]) -> tuple[str, dict[str, str]]:
    """A page of cells with a case each, and the kind of each case."""
    chance = random.Random(seed)
    cells, kind_of = [], {}
    for number, kind in enumerate(kinds):
        x, y = number % 8 * CELL[0] + 10, number // 8 * CELL[1] + 10
        name = f"c{number}"
        width, height, margin = chance.randint(40, 110), chance.randint(20, 60), chance.randint(0, 9)
        style = f"width:{width}px;height:{height}px;margin:{margin}px"
        case = CASES[kind].format(
            n=name,
            m=MARKED.format(n=name),
            style=style,
            x=x,
            y=y,
            a=chance.randint(15, 75),
            b=chance.randint(0, 6),
            c=-chance.randint(5, 25),
        )
        kind_of[name] = kind
        cells.append(
            f"<div class=cell style='left:{x}px;top:{y}px;z-index:{chance.randint(0, 3)}'>{case}</div>"
        )
    chance.shuffle(cells)
    body = "".join(cells)
    return (
        "<style>.cell{position:absolute;width:140px;height:100px;isolation:isolate}</style>"
        f"{body}<script>document.querySelectorAll('.pop').forEach((e) => e.showPopover());"
        f"document.querySelectorAll('.scroller').forEach((e) => {{ e.scrollTop = {chance.randint(0, 40)} }})"
        "</script>"
    ), kind_of


def elements(tab: Tab) -> tuple[Element, ...]:
    assert tab.last is not None
    return tab.last.observation.elements or ()


def middle(element: Element) -> Point:
    x, y, width, height = element.box
    return x + width / 2, y + height / 2


def inside(point: Point, box: tuple[float, float, float, float], slack: float = 0) -> bool:
    x, y, width, height = box
    return x - slack <= point[0] <= x + width + slack and y - slack <= point[1] <= y + height + slack


async def compare(tab: Tab, kind_of: dict[str, str]) -> None:
    """The marks of the last look against the oracle."""
    truth: dict[str, list[Point]] = await evaluate(tab, ORACLE)
    found = {element.name: element for element in elements(tab) if element.name in kind_of}
    points = [middle(element) for element in found.values()]
    at = dict(
        zip(found, await evaluate(tab, OWNER_AT.replace("POINTS", str([[*p] for p in points]))), strict=True)
    )
    wrong = []
    for name, kind in kind_of.items():
        reached = truth.get(name, [])
        element = found.get(name)
        if element is None:
            if len(reached) * STEP**2 >= 120 and kind not in UNSEEN | OFF:
                wrong.append(f"{kind}: not numbered, though {len(reached)} points reach it")
            continue
        if kind in UNSEEN | OFF:
            wrong.append(f"{kind}: numbered at {element.box}, though it is not seen, or does nothing")
        if at[name] != name:
            wrong.append(f"{kind}: a click on the middle of {element.box} hits {at[name]}")
        x, y, width, height = element.box
        if x < 0 or y < 0 or x + width > VIEWPORT[0] or y + height > VIEWPORT[1]:
            wrong.append(f"{kind}: {element.box} leaves the viewport")
        if not reached:
            continue  # smaller than a step
        extent = [f(p[axis] for p in reached) for axis in (0, 1) for f in (min, max)]
        bounds = (extent[0], extent[2], extent[1] - extent[0], extent[3] - extent[2])
        corners = [(x + 1, y + 1), (x + width - 1, y + height - 1)]
        if kind not in ROUGH and not all(inside(corner, bounds, 2 * STEP) for corner in corners):
            wrong.append(f"{kind}: {element.box} is larger than what is seen, {bounds}")
        share = sum(inside(point, element.box, STEP) for point in reached) / len(reached)
        if share < 0.2:
            wrong.append(f"{kind}: {element.box} holds only {share:.0%} of what is seen, {bounds}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
async def test_boxes_agree_with_the_document(site: Site, open_tab: Open, seed: int) -> None:
    kinds = [*CASES, *random.Random(seed).choices([*CASES], k=PER_PAGE)]
    tab = await open_tab("marks")
    for page, some in enumerate((kinds[:PER_PAGE], kinds[PER_PAGE : 2 * PER_PAGE])):
        body, kind_of = generated(seed * 100 + page, some)
        await tab.goto(site.page(body))
        await compare(tab, kind_of)


# --- whole pages --------------------------------------------------------------------------------------

ZOOMED = {
    "zoomed": "html { zoom: 1.5 }",
    "zoomed out": "body { zoom: .67 }",
    "scaled": "body { transform: scale(.8); transform-origin: 0 0 }",
    "turned": "body { transform: rotate(-8deg); transform-origin: 0 0; margin: 150px 60px }",
    "in perspective": "body { transform: perspective(900px) rotateY(20deg); width: 900px; margin: 150px }",
    "right to left": "html { direction: rtl }",
    "vertical": "html { writing-mode: vertical-rl }",
    "filtered": "html { filter: invert(1); transform: translateX(40px) } body { backdrop-filter: blur(2px) }",
}


@MODES
@pytest.mark.parametrize("style", one_in(3, ZOOMED))
async def test_zoomed_and_turned_pages(site: Site, open_tab: Open, mode: str, style: str) -> None:
    names = [f"b{number}" for number in range(12)]
    buttons = "".join(
        f"<button data-case={name} aria-label={name} onclick='document.title += \" {name}\"'>button {name}"
        "</button><p>text</p>"
        for name in names
    )
    list_ = "<label>Size <select><option>S<option>M<option>L</select></label>"
    tab = await open_tab(mode)
    await tab.goto(site.page(f"<style>{ZOOMED[style]}</style>{list_}{buttons}"))
    await compare(tab, dict.fromkeys(names, "button"))
    seen = [element.name for element in elements(tab) if element.name in names]
    assert len(seen) >= 5
    for name in seen[:3]:
        look = await tab.step(LeftClick(tab.at(name)))
        assert look.observation.title.endswith(name)
    await tab.step(LeftClick(tab.at("Size")))
    await tab.step(LeftClick(tab.at("L", "option")))
    assert tab.find("Size").value == "L"


async def test_marks_lie_where_the_elements_are_on_a_zoomed_page(site: Site, open_tab: Open) -> None:
    url = site.page("<style>html { zoom: 1.5 }</style><p>text</p><button>One</button><button>Two</button>")
    tab = await open_tab("marks")
    look = await tab.goto(url)
    marked = Image.open(io.BytesIO(look.image)).convert("RGB")
    bare = Image.open(io.BytesIO(await tab.slot.screenshot())).convert("RGB")
    drawn = ImageChops.difference(marked, bare).getbbox()
    assert drawn is not None
    boxes = [element.box for element in elements(tab)]
    assert drawn[0] == pytest.approx(boxes[0][0] - 2, abs=2)
    assert drawn[3] == pytest.approx(boxes[0][1] + boxes[0][3] + 2, abs=2)


@MODES
async def test_what_a_sticky_header_covers(site: Site, open_tab: Open, mode: str) -> None:
    rows = "".join(
        f"<p style='height:60px;margin:0'><a href=#r{n} aria-label=r{n} data-case=r{n}>row {n}</a></p>"
        for n in range(60)
    )
    tab = await open_tab(mode)
    await tab.goto(
        site.page(
            "<style>body{margin:0} header{position:sticky;top:0;height:100px;background:#fff}</style>"
            f"<header><a href=#top aria-label=top data-case=top>Top</a></header>{rows}"
        )
    )
    await tab.step(Scroll("down"))
    await compare(tab, {"top": "link", **{f"r{n}": "link" for n in range(60)}})
    first = min((one for one in elements(tab) if one.name != "top"), key=lambda one: one.box[1])
    assert first.box[1] >= 95
    look = await tab.step(LeftClick(tab.at(first.name)))
    assert look.observation.url.endswith(f"#{first.name}")


async def test_a_modal_dialog_is_all_that_is_numbered(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(
        site.page(
            "<button>Behind</button><dialog id=a><button>Yes</button><button onclick='b.showModal()'>More"
            "</button></dialog><dialog id=b><button>Deep</button></dialog><script>a.showModal()</script>"
        )
    )
    assert [element.name for element in elements(tab)] == ["Yes", "More"]
    await tab.step(LeftClick(tab.at("More")))
    assert [element.name for element in elements(tab)] == ["Deep"]


LABELS = """
webgym.mark(webgym.observe({ elements: true }, {}).elements).map(
  ({ number, colour, left, top, right, bottom }) =>
    ({ box: [left, top, right, bottom], text: String(number), colour })
)
"""


def contrast_with_white(colour: str) -> float:
    channels = [part / 255 for part in ImageColor.getrgb(colour)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
    return 1.05 / (0.2126 * red + 0.7152 * green + 0.0722 * blue + 0.05)


def colour_of_edges(picture: Image.Image) -> tuple[int, int, int] | None:
    """The colour of all pixels at its edges; ``None`` if it is not one."""
    width, height = picture.size
    x, y = width - 1, height - 1
    edges = [(0, 0, width, 1), (0, y, width, height), (0, 0, 1, height), (x, 0, width, height)]
    found = {colour for edge in edges for _, colour in picture.crop(edge).getcolors() or ()}
    return next(iter(found)) if len(found) == 1 else None  # type: ignore[return-value]


async def test_labels_can_be_read(site: Site, open_tab: Open) -> None:
    nav = "".join(f"<a href=/{n}>Page {n}</a> " for n in range(60))
    days = "".join(
        "<tr>" + "".join(f"<td><a href=/d{r}.{c}>{r * 9 + c}</a>" for c in range(9)) for r in range(12)
    )
    edges = "".join(
        f"<button style='position:fixed;{place}'>x</button>"
        for place in ("right:0;bottom:0", "left:0;bottom:0", "right:0;top:40%", "right:0;top:0")
    )
    tab = await open_tab("marks")
    await tab.goto(site.page(f"{nav}<table style='font-size:20px'>{days}</table>{edges}"))
    page = tab.slot.page
    world = {"contextId": page.worlds._worlds[page.target_id], "expression": LABELS, "returnByValue": True}
    labels = (await page.session.call("Runtime.evaluate", world, reply=_Result, seconds=5)).result.value
    assert len(labels) == len(elements(tab)) > 150
    drawn = Image.open(io.BytesIO(await capture(page))).convert("RGB")
    at_corners = [drawn.getpixel((label["box"][0], label["box"][1])) for label in labels]
    colours = [ImageColor.getrgb(label["colour"]) for label in labels]
    assert sum(map(operator.eq, at_corners, colours)) >= len(labels) * 0.98
    assert all(contrast_with_white(label["colour"]) >= 4.5 for label in labels)
    shapes: dict[tuple[int, int, bytes], set[str]] = {}
    for label in labels:
        cut = drawn.crop(label["box"])
        spare = colour_of_edges(cut)
        if spare is None:
            continue  # another one lies over it
        assert spare == ImageColor.getrgb(label["colour"]), "no digit is cut off"
        written = cut.convert("L").point([255 * (level > 200) for level in range(256)])
        shapes.setdefault((*cut.size, written.tobytes()), set()).add(label["text"])
    assert sum(map(len, shapes.values())) >= len(labels) * 0.9
    assert all(len(texts) == 1 for texts in shapes.values()), "each number has a shape of its own"
    for label in labels:
        left, top, right, bottom = label["box"]
        assert min(left, top) >= 0
        assert (right <= VIEWPORT[0], bottom <= VIEWPORT[1]) == (True, True)
    overlaps = [
        (one["text"], other["text"])
        for one, other in itertools.combinations(labels, 2)
        if min(one["box"][2], other["box"][2]) - max(one["box"][0], other["box"][0]) > 1
        and min(one["box"][3], other["box"][3]) - max(one["box"][1], other["box"][1]) > 1
    ]
    assert len(overlaps) <= len(labels) * 0.02, overlaps
