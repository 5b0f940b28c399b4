from __future__ import annotations

import asyncio
import hashlib
import io

import pytest
from PIL import Image, ImageChops
from starlette.requests import Request
from starlette.responses import Response

from webgym.browser import observe
from webgym.browser.config import BrowserConfig
from webgym.browser.page import Page
from webgym.core.action import LeftClick, Scroll, Target
from webgym.core.observation import Element

from .conftest import VIEWPORT, Open, Site, Tab, batches

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


def names(tab: Tab) -> list[tuple[str, str]]:
    assert tab.last is not None
    return [(element.role, element.name) for element in tab.last.observation.elements or ()]


async def test_the_text_is_what_can_be_read_now(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            """
            <style>.cover { position: fixed; left: 0; top: 300px; width: 600px; height: 100px }
            .cover { background: #eee }
            .under { position: absolute; top: 330px }</style>
            <h1>Fernhill <em>Books</em></h1>
            <p>Price: <span>$5</span><span style="margin-left: 8px">each</span></p>
            <p>one<br>two</p>
            <ul><li>first<li>second</ul>
            <p style="display: none">not displayed</p><p style="visibility: hidden">hidden</p>
            <p style="opacity: 0">transparent</p>
            <div style="height: 10px; overflow: hidden"><br><br>clipped away</div>
            <div class=under>under a banner</div><div class=cover>Cookies?</div>
            <div style="position: absolute; top: 5000px">far below</div>
            <noscript>no script</noscript><script>var inScript</script>
            """
        )
    )
    assert tab.text == ["Fernhill Books", "Price: $5 each", "one", "two", "first", "second", "Cookies?"]


async def test_the_text_holds_what_controls_show_and_nobody_typed(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<input value=filled><input placeholder='Your name'><input type=password value=secret>"
            "<select><option>Red<option selected>Green</select><textarea>long note</textarea>"
            "<input type=submit value=Send><input type=checkbox value=x checked>"
            "<input type=checkbox role=switch value=''>"
            "<input type=submit> <input type=reset> <input type=submit value=''> <input type=file>"
            "<select size=2><option>Oak<option>Elm<option>Fir</select>"
            "<p>a <ruby>word<rt>sound</rt></ruby> and <math><mi>x</mi><mo>=</mo><mn>2</mn></math></p>"
        )
    )
    shown = "Your name Green Send Submit Reset Choose File No file chosen"
    assert tab.text == [shown, "Oak", "Elm", "a word sound and x = 2"]
    assert ("button", "Choose File") in names(tab)


async def test_far_text_comes_into_view_by_scrolling(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<p>top</p><div style='height:800px'></div><p>bottom</p>"))
    assert tab.text == ["top"]
    await tab.step(Scroll("down"))
    assert tab.text == ["bottom"]


NAMED = """
<a href=/next>Next <img alt=page src=data:,></a>
<a>no link</a>
<button aria-label="Close dialog">x</button>
<button disabled>Not now</button>
<span id=city>City</span><input aria-labelledby=city>
<label for=mail>E-mail</label><input id=mail type=email value=a@b.c>
<label>Agree <input type=checkbox checked></label>
<label>Small <input type=radio name=size></label>
<input type=search placeholder="Search books">
<input type=number title=Count value=2>
<input type=submit value=Go>
<input type=hidden value=x>
<select aria-label=Colour><option>Red<option>Green</select>
<select aria-label=Toppings multiple><option>Ham<option selected>Olives</select>
<div role=tab tabindex=0>Details</div>
<div style="cursor: pointer">Card <b>one</b></div>
<div onclick="1">Row</div>
<summary>More</summary>
<svg width=90 height=20><a xlink:href=/next><text y=15>Old</text></a></svg>
<input type=reset>
<button aria-hidden=true>Hidden from some</button>
<div contenteditable aria-label=Post>text</div>
<div role=combobox tabindex=0 aria-label=Fruit><b>Fruit</b> Apple</div>
<div role=slider tabindex=0 aria-label=Volume aria-valuenow=30 style="height: 9px"></div>
<div onclick="1" aria-hidden=true>Other <i aria-hidden=true>x</i></div>
<div onmousedown="press()"
style="position: fixed; right: 9px; top: 9px; width: 20px; height: 20px; cursor: pointer">
<p style="position: absolute; width: 1px; height: 1px; clip-path: inset(50%); overflow: hidden">
<input type=range aria-label=Price value=70></p></div>
<span onclick="1">
<input type=checkbox checked style="opacity: 0; position: absolute; width: 0; height: 0">Drawn</span>
"""


async def test_elements_have_roles_names_and_values(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(NAMED))
    assert names(tab) == [
        ("link", "Next page"),
        ("button", "Close dialog"),
        ("textbox", "City"),
        ("textbox", "E-mail"),
        ("checkbox", "Agree"),
        ("radio", "Small"),
        ("searchbox", "Search books"),
        ("spinbutton", "Count"),
        ("button", "Go"),
        ("combobox", "Colour"),
        ("listbox", "Toppings"),
        ("option", "Ham"),
        ("option", "Olives"),
        ("tab", "Details"),
        ("button", "Card one"),
        ("button", "Row"),
        ("button", "More"),
        ("link", "Old"),
        ("button", "Reset"),
        ("button", "Hidden from some"),
        ("textbox", "Post"),
        ("combobox", "Fruit"),
        ("slider", "Volume"),
        ("button", "Other"),
        ("slider", "Price"),
        ("checkbox", "Drawn"),
    ]
    assert tab.find("Next page").href == tab.find("Old").href == site.url("/next")
    assert tab.find("E-mail").value == "a@b.c"
    assert tab.find("Agree").value == "true"
    assert tab.find("Small").value == "false"
    assert tab.find("Colour").value == "Red"
    assert tab.find("Olives").value == "true"
    values = [tab.find(name).value for name in ("Post", "Fruit", "Volume", "Price", "Drawn")]
    assert values == ["text", "Apple", "30", "70", "true"]


@pytest.mark.parametrize("hidden", ["position: absolute; opacity: 0; width: 0; height: 0", "display: none"])
async def test_a_hidden_box_is_clicked_by_its_label(site: Site, tab: Tab, hidden: str) -> None:
    await tab.goto(
        site.page(f"<style>input {{ {hidden} }}</style><label><input type=checkbox> Gift wrap</label>")
    )
    assert tab.find("Gift wrap").value == "false"
    await tab.step(LeftClick(tab.at("Gift wrap")))
    assert tab.find("Gift wrap").value == "true"


async def test_what_a_dialog_covers_is_left_out(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<button>Behind</button><p>background text</p>"
            "<div style='position:fixed;inset:0;background:#fff'><button>Front</button></div>"
        )
    )
    assert names(tab) == [("button", "Front")]
    assert tab.text == ["Front"]


async def test_shadow_roots_and_frames_are_part_of_the_page(site: Site, tab: Tab) -> None:
    inner = site.page("<button onclick=\"this.textContent = 'Done'\">Inner</button><p>inner text</p>")
    style = "width:300px;height:120px;border:7px solid;display:block;margin:11px"
    await tab.goto(
        site.page(
            f"<iframe src={inner} style='{style}'></iframe>"
            "<div id=host></div><script>"
            "const root = host.attachShadow({ mode: 'open' });"
            "root.innerHTML = '<button>Shadow</button><slot></slot><p>shadow text</p>';"
            "root.firstChild.onclick = (e) => { e.target.textContent = 'Clicked' };</script>"
        )
    )
    assert names(tab) == [("button", "Inner"), ("button", "Shadow")]
    assert "inner text" in tab.text
    assert "shadow text" in tab.text
    await tab.step(LeftClick(tab.at("Inner")))
    await tab.step(LeftClick(tab.at("Shadow")))
    assert names(tab) == [("button", "Done"), ("button", "Clicked")]


async def test_numbers_stay_with_their_elements(site: Site, tab: Tab) -> None:
    rows = "".join(f"<p style='height:120px'><a href=/{number}>Link {number}</a></p>" for number in range(30))
    await tab.goto(site.page(rows))
    first = {element.name: element.number for element in elements(tab)}
    await tab.step(Scroll("down"))
    second = {element.name: element.number for element in elements(tab)}
    await tab.step(Scroll("up"))
    third = {element.name: element.number for element in elements(tab)}
    common = first.keys() & second.keys()
    assert common
    assert second.keys() - first.keys()
    assert all(first[name] == second[name] for name in common)
    assert third == first
    assert len({*first.values(), *second.values()}) == len({*first, *second})


def elements(tab: Tab) -> tuple[Element, ...]:
    assert tab.last is not None
    return tab.last.observation.elements or ()


async def test_boxes_are_where_the_page_says(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<style>* { margin: 0 }</style>"
            "<button style='position:absolute;left:100px;top:50px;width:80px;height:30px'>Whole</button>"
            "<button style='position:absolute;left:-40px;top:200px;width:100px;height:30px'>Cut</button>"
            "<div style='position:absolute;left:300px;top:300px;transform:rotate(90deg) scale(2);width:50px;"
            "height:20px' role=button>Turned</div>"
        )
    )
    assert tab.find("Whole").box == (100, 50, 80, 30)
    assert tab.find("Cut").box == (0, 200, 60, 30)
    assert tab.find("Turned").box == pytest.approx((305, 260, 40, 100))


async def test_marks_are_drawn_where_the_elements_are(site: Site, open_tab: Open) -> None:
    url = site.page(
        NAMED + "<script>new MutationObserver(() => { document.title = 'noticed' })"
        ".observe(document.body, { childList: true, subtree: true })</script>"
    )
    plain = await open_tab("coordinates")
    without = Image.open(io.BytesIO((await plain.goto(url)).image)).convert("RGB")
    boxes = [element.box for element in elements(plain)]
    marked = await open_tab("marks")
    look = await marked.goto(url)
    with_marks = Image.open(io.BytesIO(look.image)).convert("RGB")
    assert with_marks.size == VIEWPORT
    assert [element.box for element in elements(marked)] == boxes
    changed = ImageChops.difference(without, with_marks)
    for x, y, width, height in boxes:
        edge = changed.crop((int(x), int(y - 2), int(x + width), int(y)))
        assert edge.getbbox() is not None, f"no frame around {x, y, width, height}"
    assert look.observation.title == "", "the page did not notice"
    async with asyncio.timeout(100):  # the marks are gone afterwards, with the next frame of a busy machine
        while True:
            bare = Image.open(io.BytesIO(await marked.slot.screenshot())).convert("RGB")
            if ImageChops.difference(without, bare).getbbox() is None:
                break


async def test_the_same_page_gives_the_same_picture(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<input autofocus value=text><style>* { caret-color: red }</style>"))
    look = await tab.step()
    name = look.observation.screenshot
    assert name == hashlib.sha256(look.image).hexdigest()
    for _ in range(3):
        assert (await tab.step()).observation.screenshot == name


CARET = (255, 0, 255)
FIELD = (
    "<style>.f, iframe { position: fixed; inset: 0 auto auto 0; width: 300px; height: 100px; font-size: 60px;"
    "border: 0; outline: none } .f { caret-color: #f0f }</style>"
)
COMPONENT = f"<div id=h></div><script>h.attachShadow({{ mode: 'open' }}).innerHTML = `{FIELD}INSIDE`</script>"
FIELDS = {
    "a field": "<input class=f>",
    "a field for numbers": "<input type=number class=f>",
    "an area": "<textarea class=f></textarea>",
    "an editor": "<div contenteditable class=f>text</div>",
    "a field whose type changes": "<input class=f type=password onclick=\"type = 'text'\">",
    "a field in a component": COMPONENT.replace("INSIDE", "<input class=f>"),
    "an editor in a component": COMPONENT.replace("INSIDE", "<div contenteditable class=f>text</div>"),
    "a field in a frame": f'<iframe srcdoc="{FIELD}<input class=f>"></iframe>',
    "a document that is edited": f'<iframe id=i srcdoc="{FIELD}<body class=f>text"></iframe>'
    "<script>i.onload = () => { i.contentDocument.designMode = 'on' }</script>",
    "a field in a frame of another origin": "<iframe src=FIELD></iframe>",
}


@pytest.mark.parametrize("fields", batches(1, FIELDS))
async def test_carets_are_hidden(site: Site, tab: Tab, fields: list[str]) -> None:
    """They are shown for half a second after a click."""
    foreign = site.elsewhere(site.page(f"{FIELD}<input class=f>"))
    for field in fields:
        await tab.goto(site.page(FIELD + FIELDS[field].replace("FIELD", foreign)))
        for _ in range(2):
            look = await tab.step(LeftClick(Target(coordinate=(50, 50))))
            colours = Image.open(io.BytesIO(look.image)).convert("RGB").getcolors(1 << 20) or ()
            assert CARET not in {colour for _, colour in colours}, field


async def test_the_viewport_is_as_asked_for(site: Site, open_tab: Open) -> None:
    tab = await open_tab(viewport=(1280, 768))
    look = await tab.goto(site.page("<script>document.title = innerWidth + 'x' + innerHeight</script>"))
    assert look.observation.title == "1280x768"
    assert Image.open(io.BytesIO(look.image)).size == (1280, 768)


async def test_a_page_that_tampers_with_its_prototypes_is_still_seen(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<button>Plain</button><script>Element.prototype.getBoundingClientRect = () => { throw 1 };"
            "Document.prototype.elementFromPoint = () => null; window.webgym = 'mine';"
            "Array.prototype.map = () => { throw 2 }; window.getComputedStyle = null</script>"
        )
    )
    assert names(tab) == [("button", "Plain")]


ODD = {
    "svg": (
        "image/svg+xml",
        "<svg xmlns='http://www.w3.org/2000/svg'><a href='/x'><text y='20'>hi</text></a></svg>",
    ),
    "xml": ("text/xml", "<list><item>one</item></list>"),
    "json": ("application/json", '{"one": 1}'),
    "text": ("text/plain", "plain words"),
    "empty": ("text/html", "<script>document.documentElement.remove()</script>"),
    "deep": (
        "text/html",
        "<script>let e = document.body || document.documentElement;"
        "for (let i = 0; i < 5000; i++) { e.append(e = document.createElement('i')) }</script>",
    ),
}


@pytest.mark.parametrize(("media", "body"), ODD.values(), ids=ODD.keys())
async def test_odd_documents_are_looked_at(site: Site, open_tab: Open, media: str, body: str) -> None:
    async def answer(_: Request) -> Response:
        return Response(body, media_type=media)

    # To look at the deep one takes 1.5 s, and ten times as long on a machine that is starved.
    patient = BrowserConfig(screenshot_seconds=60, execute_seconds=60)
    tab = await open_tab("marks", patient if "5000" in body else None)
    look = await tab.goto(site.on("/odd", answer))
    assert look.observation.status == 200
    assert look.image.startswith(b"\x89PNG")
    assert tab.notices == []


async def test_what_is_drawn_again_in_part_looks_the_same(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<style>div { position: absolute; border-radius: 50%; background: #369 }</style>"
            "<div style='left:40.5px;top:40px;width:200px;height:160px'></div>"
            "<div id=patch hidden style='left:30px;top:120px;width:17px;height:13px;border-radius:0'></div>"
            "<script>onclick = () => { patch.hidden = !patch.hidden }</script>"
        )
    )
    assert tab.last is not None
    first, click = tab.last.observation.screenshot, LeftClick(Target(coordinate=(900, 900)))
    patched, again = [(await tab.step(click)).observation.screenshot for _ in range(2)]
    assert first == again != patched


async def test_a_page_that_is_replaced_while_it_is_looked_at(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Address, elements and picture are of one page: the next one."""
    tab = await open_tab("marks")
    there = site.page("<button>Other</button>")
    await tab.goto(site.page("<button>One</button>"))

    async def late(page: Page, _: int | None = None) -> bytes:
        monkeypatch.undo()
        loader = page.loader
        page.session.send("Runtime.evaluate", {"expression": f"location.href = {there!r}"})
        while page.loader == loader:
            await asyncio.sleep(0.01)
        return await observe.capture(page)

    monkeypatch.setattr(observe, "capture", late)
    seen = await tab.step()
    assert seen.observation.url == there
    assert [element.name for element in seen.observation.elements or ()] == ["Other"]
    assert seen.image == (await tab.step()).image
