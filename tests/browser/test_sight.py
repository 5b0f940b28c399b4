"""Text counts as seen only if a person could see it, word by word."""

from __future__ import annotations

import pytest

from webgym.browser.config import BrowserConfig
from webgym.core.action import Scroll

from .conftest import VIEWPORT, Open, Site, Tab, batches

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


BOX = "width:100px;overflow:hidden;white-space:nowrap;"
DIALOG = "<dialog id=d style='{}'>seen</dialog><style>{}</style><script>d.showModal()</script>"
IN_COMPONENT = (
    "<script>document.querySelector('x-y').attachShadow({{mode: 'open'}}).innerHTML = "
    "'<b style=\"background:red\">{}</b>'</script>"
)

SLOTTED = "seen<x-y><template shadowrootmode={}>{}</template>{}</x-y>"

UNSEEN = {
    "clipped by a box": "<div style='width:60px;overflow:hidden;white-space:nowrap'>seen <b>hidden</b></div>",
    "half a word": (
        "<div style='width:70px;overflow:hidden;white-space:nowrap;font:16px monospace'>seen hidden</div>"
    ),
    "clipped by a box further out": (
        "<div style='width:60px;overflow:hidden'><div style='width:400px'>seen"
        "<span style='margin-left:100px'>hidden</span></div></div>"
    ),
    "below the edge of a box": "<div style='height:22px;overflow:hidden'>seen<br>hidden</div>",
    "further down in a box that scrolls": (
        "<div style='height:22px;overflow:auto'>seen<p style='margin-top:50px'>hidden</div>"
    ),
    "containment": (
        "<div style='contain:paint;width:60px;white-space:nowrap'>seen<span style='margin-left:90px'>"
        "hidden</div>"
    ),
    "ellipsis": (
        f"<div style='{BOX}text-overflow:ellipsis;font:16px monospace;width:108px'>seen hidden more</div>"
    ),
    "clamped lines": (
        "<div style='width:120px;display:-webkit-box;-webkit-box-orient:vertical;-webkit-line-clamp:1;"
        "overflow:hidden;font:16px/20px monospace'>seen hidden then more</div>"
    ),
    "clip-path: inset": "seen<div style='clip-path:inset(0 0 0 100%)'>hidden</div>",
    "clip-path: polygon": (
        "<div style='clip-path:polygon(0 0,60px 0,60px 100%,0 100%)'>seen"
        "<span style='margin-left:90px'>hidden</span></div>"
    ),
    "clip-path: circle": "seen<div style='clip-path:circle(3px at 600px 9px);width:700px'>hidden</div>",
    "a hint that takes no clicks, under something": (
        "seen<div style='position:relative'><input placeholder=hidden style='pointer-events:none'>"
        "<i style='position:absolute;inset:0;background:red'></i></div>"
    ),
    "a hint that takes no clicks, cut off": (
        "seen<div style='width:0;overflow:hidden'><input placeholder=hidden inert></div>"
    ),
    "clip": "seen<div style='position:absolute;clip:rect(0,0,0,0)'>hidden</div>",
    "for screen readers": (
        "seen<span style='position:absolute;width:1px;height:1px;overflow:hidden;"
        "clip-path:inset(50%)'>hidden</span>"
    ),
    "opacity": "seen<div style='opacity:.3'><p style='opacity:.2'>hidden</p></div>",
    "filter: opacity": "seen<div style='filter:opacity(2%)'>hidden</div>",
    "filter: blur": "seen<div style='filter:blur(6px)'>hidden</div>",
    "white on white": "seen<div style='color:#fff'>hidden</div>",
    "nearly white on white": "seen<div style='color:#f4f4f4'>hidden</div>",
    "the colour of a box around": (
        "<div style='background:rgb(20 30 40)'><p style='color:#fff'>"
        "seen<p style='color:rgb(20 30 40)'>hidden</div>"
    ),
    "a colour in other words": (
        "<div style='background:oklch(0.6 0.1 200);color:#000'>"
        "seen<p style='color:oklch(0.6 0.1 200)'>hidden</div>"
    ),
    "the colour of what lies below": (
        "seen<div style='position:relative;height:30px'><div style='position:absolute;inset:0;"
        "background:#000'>"
        "</div><span style='position:absolute;color:#000'>hidden</span></div>"
    ),
    "a transparent colour": "seen<div style='color:rgba(0,0,0,.03)'>hidden</div>",
    "a size of nothing": "seen<div style='font-size:0'>hidden</div>",
    "a tiny size": "seen<div style='font-size:2px'>hidden</div>",
    "scaled down": "seen<div style='transform:scale(.1)'>hidden</div>",
    "indented out": "seen<div style='text-indent:-9999px'>hidden</div>",
    "moved out": "seen<div style='transform:translateX(-2000px)'>hidden</div>",
    "turned away": (
        "seen<div style='transform:rotateY(180deg);backface-visibility:hidden;width:200px'>hidden</div>"
    ),
    "beyond the edge of the viewport": "seen<div style='position:absolute;left:785px'>hidden</div>",
    "below the viewport": "seen<div style='position:absolute;top:597px'>hidden</div>",
    "content-visibility": "seen<div style='content-visibility:hidden;height:20px'>hidden</div>",
    "visibility": "seen<div style='visibility:hidden'>hidden</div>",
    "closed details": "<details><summary>seen</summary>hidden</details>",
    "covered by a child": (
        "seen<div style='position:relative'>hidden<i style='position:absolute;inset:0;"
        "background:#888'></i></div>"
    ),
    "half covered": (
        "<div style='position:relative;font:16px monospace;width:300px'>seen hidden"
        "<i style='position:absolute;left:60px;top:0;width:200px;height:30px;background:#888'></i></div>"
    ),
    "behind its parent": (
        "seen<div style='background:#fff'><p style='position:relative;z-index:-1;margin:0'>hidden</p></div>"
    ),
    **{
        f"below a part of a drawing, {part}": (
            f"seen<br><svg width=200 height=40><text y=20>hidden</text><g fill=none>{part}</g></svg>"
        )
        for part in (
            "<rect width=200 height=40 fill=red />",
            "<rect width=200 height=40 fill=url(#ink) /><linearGradient id=ink><stop /></linearGradient>",
            "<path d='M0 15H200' stroke=red stroke-width=30 />",
        )
    },
    **{
        f"below a drawing, {style}": (
            "seen<div style='position:relative'><p style='margin:0'>hidden</p><svg width=200 height=40 "
            f"style='position:absolute;left:0;top:0;{style}'>{part}</svg></div>"
        )
        for style, part in {
            "": "<rect width=200 height=40 fill=red />",
            "background:red": "",
        }.items()
    },
    "below a component": (
        "seen<p style='margin:0'>hidden</p><x-y style='position:absolute;left:0;top:18px'></x-y>"
        + IN_COMPONENT.format("0123456789")
    ),
    "cut off in a drawing": (
        "<svg width=200 height=60><foreignObject width=60 height=30><div style='white-space:nowrap'>seen"
        "<b style='margin-left:60px'>hidden</b></div></foreignObject></svg>"
    ),
    "behind a dialog, on a level below": (
        "<h1 style='position:fixed;margin:0;width:100%;background:#fff'>seen</h1><p style='margin:0'>hidden"
        + DIALOG.format("", "")
    ),
    "behind a dialog, white on white": ("<div style='color:#fff'>hidden</div>" + DIALOG.format("", "")),
    "below a dialog": "hidden" + DIALOG.format("margin:0;width:300px", ""),
    "below a box in a clear dialog": (
        "hidden<dialog id=d style='margin:0;padding:0;width:300px;background:none'>"
        "<p style='margin:0;background:#ddd'>seen</dialog><script>d.showModal()</script>"
    ),
    "behind a dark backdrop": "hidden" + DIALOG.format("", "::backdrop { background: #000c }"),
    "behind a blurred backdrop": "hidden" + DIALOG.format("", "::backdrop { backdrop-filter: blur(5px) }"),
    "masked letters": "seen<div style='-webkit-text-security:disc'>hidden</div>",
    "typed": "seen<div contenteditable>hidden</div>",
    "a value": "seen <input value=hidden>",
    "a long value": "seen <textarea>hidden</textarea>",
    **{
        f"text slotted into {part}": SLOTTED.format(mode, part, "hidden")
        for mode, part in {
            "open": "<details><summary>More</summary><slot></slot></details>",
            "closed": "<div style='opacity:0'><slot></slot></div>",
        }.items()
    },
}


@pytest.mark.parametrize("pages", batches(3, UNSEEN))
async def test_what_cannot_be_seen_is_left_out(site: Site, tab: Tab, pages: list[str]) -> None:
    for page in pages:
        await tab.goto(site.page(f"<body style='margin:0;background:#fff'>{UNSEEN[page]}"))
        assert "seen" in " ".join(tab.text), page
        assert "hid" not in " ".join(tab.text), page


SEEN = {
    "beside a box that lies over its edge": (
        "<i style='position:absolute;left:0;width:40.4px;height:20px;background:red;z-index:1'></i>"
        "<span style='margin-left:40px'>shown</span>"
    ),
    "below a transparent component": (
        "<p style='margin:0'>shown</p><x-y style='position:absolute;left:0;top:0;opacity:0'></x-y>"
        + IN_COMPONENT.format("cover")
    ),
    "inside a clipped box": (
        "<div style='width:300px;overflow:hidden;line-height:1;font-size:30px'>shown</div>"
    ),
    "inside a shape": "<div style='clip-path:inset(0 0 0 0 round 5px)'>shown</div>",
    "inside a polygon": "<div style='clip-path:polygon(0 0,100% 0,100% 100%,0 100%)'>shown</div>",
    "an ellipsis that is not needed": f"<div style='{BOX}text-overflow:ellipsis'>shown</div>",
    "grey": "<div style='color:#ccc'>shown</div>",
    "faint": "<div style='opacity:.4'>shown</div>",
    "white on dark": "<div style='background:#222;color:#fff'>shown</div>",
    "white on a picture": "<div style='background:linear-gradient(#333,#111);color:#fff'>shown</div>",
    "white over a sibling": (
        "<div style='position:relative;height:30px'><div style='position:absolute;inset:0;"
        "background:#000'></div>"
        "<span style='position:relative;color:#fff'>shown</span></div>"
    ),
    "white in the cell of a picture": (
        "<div style='display:grid'><img style='grid-area:1/1;width:200px;"
        "height:50px' src='data:image/svg+xml,"
        "<svg xmlns=%22http://www.w3.org/2000/svg%22 width=%221%22 height=%221%22/>'>"
        "<span style='grid-area:1/1;color:#fff;z-index:1'>shown</span></div>"
    ),
    "cut out of a picture": (
        "<span style='background:linear-gradient(red,blue);background-clip:text;color:transparent'>"
        "shown</span>"
    ),
    "by its shadow": "<span style='color:#fff;text-shadow:0 0 2px #000'>shown</span>",
    "that takes no clicks": (
        "<div style='position:relative;height:40px'><div style='height:40px;background:#eee'></div>"
        "<div style='position:absolute;top:0;pointer-events:none'>shown</div></div>"
    ),
    "below a clear cover": (
        "<div style='position:relative'>shown<a href=/ style='position:absolute;inset:0'></a></div>"
    ),
    "below a clear cover beside it": (
        "<div style='position:relative'><p>shown</p><a href=/ style='position:absolute;inset:0'></a></div>"
    ),
    "that takes no clicks, on a level above a field": (
        "<div style='position:relative'><b style='position:absolute;z-index:1;pointer-events:none'>shown</b>"
        "<input style='position:relative;width:200px;height:30px;background:#eee'></div>"
    ),
    "that takes no clicks, below a clear button": (
        "<div style='position:relative;height:40px'>"
        "<b style='position:absolute;pointer-events:none'>shown</b>"
        "<button style='position:absolute;inset:0;background:none;border:0'></button></div>"
    ),
    "below a box to tick that is not seen": (
        "<div style='position:relative;width:90px'>shown"
        "<input type=checkbox style='position:absolute;left:0;width:90px;opacity:0'></div>"
    ),
    "below a thin veil": "<p>shown</p><div style='position:fixed;inset:0;background:#0004'></div>",
    "behind a dialog": "<p>shown</p>" + DIALOG.format("", ""),
    "behind a dialog, in what holds it": "shown" + DIALOG.format("", ""),
    "behind a clear part of a dialog": (
        "<p>shown</p>" + DIALOG.format("inset:0;width:100%;height:90%;background:none;padding-top:90px", "")
    ),
    "behind a faded backdrop": ("shown" + DIALOG.format("", "::backdrop { background: #000; opacity: .5 }")),
    "white over a sibling behind a dialog": (
        "<div style='position:relative;height:30px'><div style='position:absolute;inset:0;"
        "background:#000'></div>"
        "<span style='position:relative;color:#fff'>shown</span></div>" + DIALOG.format("", "")
    ),
    "with soft hyphens": "<p>sh&shy;own</p>",
    "broken at a soft hyphen": "<p style='width:30px'>sh&shy;own</p>",
    "a parent without a box": "<div style='display:contents'>shown</div>",
    "what a slot holds by itself": (
        "<div id=host></div><script>host.attachShadow({mode:'open'}).innerHTML = '<slot>shown</slot>"
        "'</script>"
    ),
    "turned": "<div style='writing-mode:vertical-rl;height:200px'>shown</div>",
    "rotated": "<div style='transform:rotate(90deg);width:100px;height:100px'>shown</div>",
    "a box that scrolls": "<div style='height:40px;overflow:auto'>shown<p style='margin-top:90px'>more</div>",
    "small print": "<div style='font-size:8px'>shown</div>",
    "in a frame": "<iframe srcdoc='<p>shown' style='width:200px;height:80px'></iframe>",
    "a drawing": (
        "<svg width=200 height=40><rect width=200 height=40 fill=navy /><text y=20 fill=#fff>"
        "shown</text></svg>"
    ),
    **{
        f"below a clear part of a drawing, {part}": (
            f"<svg width=200 height=40><text y=20>shown</text><g>{part}</g></svg>"
        )
        for part in (
            "<rect width=200 height=40 fill=none pointer-events=all />",
            "<rect width=200 height=40 fill=transparent />",
            "<path d='M0 0H200V40H0Z' fill-opacity=.2 stroke=red />",
            "<line x1=0 y1=15 x2=200 y2=15 stroke-width=20 stroke=red stroke-opacity=0 />",
        )
    },
    **{
        f"below a drawing of {what}": (
            "<div style='position:relative'><p style='margin:0'>shown</p>"
            f"<svg width=200 height=40 style='position:absolute;left:0;top:0'>{part}</svg></div>"
        )
        for what, part in {
            "nothing": "",
            "a clear box": "<g><rect width=200 height=40 fill=none pointer-events=all /></g>",
        }.items()
    },
    "a paragraph in a drawing": (
        "<svg width=200 height=60><rect width=200 height=60 fill=navy /><g>"
        "<foreignObject width=200 height=60><p style='color:#fff'><b>shown</b></p></foreignObject></g></svg>"
    ),
    "white on a dark hint that takes no clicks": (
        "<div style='position:absolute;pointer-events:none;background:rgba(0,0,0,.8)'>"
        "<p style='margin:0;color:#fff'>shown</p></div>"
    ),
    **{
        f"text slotted into {part}": SLOTTED.format("open", part, "shown")
        for part in (
            "<div style='background:#000;color:#fff'><slot></slot></div>",
            "<div style='clip-path:inset(0)'><slot></slot></div>",
            "<label style='position:relative'><slot></slot>"
            "<input style='position:absolute;inset:0;opacity:0'></label>",
            "<i style='position:absolute;width:90px;height:30px;background:#000;pointer-events:none'></i>"
            "<b style='position:relative;color:#fff'><slot></slot></b>",
        )
    },
    "letters in a button that paints them alone": (
        "<button style='background:text #14c;color:#14c'><b>shown</b></button>"
    ),
    "letters that what is around them paints": (
        "<p style='background:linear-gradient(red,blue) text;color:transparent'><b>shown</b></p>"
    ),
    "the steps below a slider that paints nothing": (
        "<div style='position:relative'>shown<input type=range style='appearance:none;position:absolute;"
        "inset:0;margin:0;background:none'></div>"
    ),
    "a button": "<input type=submit value=shown>",
    "a choice": "<select><option>other<option selected>shown</select>",
    "a hint": "<input placeholder=shown>",
    "a hint that takes no clicks": "<button><input placeholder=shown inert></button>",
    "a choice behind a dialog": "<select><option>shown</select>" + DIALOG.format("", ""),
    "signs": "<p lang=ja style='width:200px;overflow:hidden;white-space:nowrap'>東京shown</p>",
}


@pytest.mark.parametrize("pages", batches(3, SEEN))
async def test_what_can_be_seen_is_told(site: Site, tab: Tab, pages: list[str]) -> None:
    for page in pages:
        await tab.goto(site.page(f"<body style='margin:0;background:#fff'>{SEEN[page]}"))
        assert "shown" in " ".join(tab.text), page


async def test_a_gap_stands_for_what_is_cut(site: Site, tab: Tab) -> None:
    box = "width:100px;overflow:hidden;white-space:nowrap;font:16px monospace"
    await tab.goto(
        site.page(f"<div style='{box}'>Price $12.50 each</div><div style='{box}'>東京都千代田区丸の内</div>")
    )
    assert tab.text == ["Price …", "東京都千代田 …"]


async def test_words_beside_what_is_covered_are_told(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<div style='position:relative;font:16px monospace'>one two three four"
            "<i style='position:absolute;left:34px;width:40px;top:0;height:30px;background:#888'></i></div>"
        )
    )
    assert tab.text == ["one … three four"]


async def test_only_the_part_of_a_long_text_that_is_in_view_is_told(site: Site, tab: Tab) -> None:
    lines = "\n".join(f"row-{number}" for number in range(20_000))
    await tab.goto(
        site.page(f"<body style='margin:0'><pre style='margin:0;font:16px/20px monospace'>{lines}</pre>")
    )
    assert tab.text[0].startswith("row-0 row-1 row-2 ")
    assert tab.text[0].endswith(f"row-{VIEWPORT[1] // 20 - 1} …")
    await tab.goto(
        site.page(f"<pre style='height:100px;overflow:auto;font:16px/20px monospace'>{lines}</pre>")
    )
    assert tab.text == ["row-0 row-1 row-2 row-3 row-4 …"]


async def test_what_stands_in_fields_is_kept_apart(site: Site, tab: Tab) -> None:
    inner = site.elsewhere(site.page("<label>Town <input value=Fernhill></label>"))
    await tab.goto(
        site.page(
            "<p>Name <input value=Ann> please</p><textarea>long note</textarea>"
            "<input type=password value=secret>"
            f"<p>Draft: <span contenteditable>my <b>words</b></span></p><iframe src={inner}></iframe>"
        )
    )
    assert tab.text == ["Name please", "Draft:", "Town"]
    assert tab.last is not None
    assert tab.last.observation.fields == ("Ann", "long note", "••••••", "my words", "Fernhill")


async def test_a_frame_of_another_origin_shows_whole_words_only(site: Site, tab: Tab) -> None:
    inner = site.elsewhere(
        site.page("<body style='margin:0;font:16px monospace;white-space:nowrap'>one two three")
    )
    style = "border:0;width:400px;height:60px"
    await tab.goto(
        site.page(
            f"<div style='width:70px;overflow:hidden'><iframe src={inner} style='{style}'></iframe></div>"
        )
    )
    assert tab.text == ["one two …"]
    await tab.goto(site.page(f"<p>out</p><iframe src={inner} style='{style};opacity:.01'></iframe>"))
    assert tab.text == ["out"]


async def test_lines_that_are_cut_wherever_one_scrolls_are_told(site: Site, open_tab: Open) -> None:
    tab = await open_tab(cuts=True, text=False, elements=False)
    box = "width:120px;overflow:hidden;white-space:nowrap;font:16px monospace"
    look = await tab.goto(
        site.page(
            "<p>whole</p><div style='height:40px;overflow:auto'><p>in a box<p>that scrolls</div>"
            "<details><summary>More</summary>closed</details><p style='display:none'>none</p>"
            f"<div style='height:2000px'></div><div style='{box}'><b>14:30</b> to <b>15:45</b></div>"
        )
    )
    assert look.observation.cuts == (("14:30 to 15:45", "14:30 to …"),)


OVER = "position:absolute;inset:0;pointer-events:none;"
LAYERS = {
    "a colour": f"<i style='{OVER}background:#fff'></i>",
    "a blur": f"<i style='{OVER}backdrop-filter:blur(12px)'></i>",
    "a drawing": f"<svg style='{OVER}' width=300 height=40><rect width=300 height=40 fill=#fff /></svg>",
    "a drawn picture": (
        f"<canvas width=300 height=40 style='{OVER}'></canvas>"
        "<script>document.querySelector('canvas').getContext('2d').fillRect(0, 0, 300, 40)</script>"
    ),
    "what its own style makes": f"<style>.own::after{{content:'';{OVER}background:#fff}}</style>",
    "what the style beside it makes": (
        f"<style>.beside::before{{content:'';{OVER}background:#fff}}</style><s class=beside></s>"
    ),
}
CLEAR = {
    "a drawing of a line": f"<svg style='{OVER}' width=300 height=40><path d='M0 39H300' stroke=red /></svg>",
    "an empty drawn picture": f"<canvas width=300 height=40 style='{OVER}'></canvas>",
    "a thin colour": f"<i style='{OVER}background:rgba(0,0,0,.1)'></i>",
    "a layer below": f"<i style='{OVER}background:#fff;z-index:-1'></i>",
    "a shadow from above": (
        f"<style>.own::after{{content:'';{OVER}background:linear-gradient(#0000,#0008)}}</style>"
    ),
}


def layered(layers: dict[str, str]) -> str:
    """A box for each layer, with a word and a button of its own below it."""
    boxes = (
        f"<div class={'own' if 'own' in layer else 'none'} style='position:relative;width:300px;height:40px'>"
        f"word{number} <button>press{number}</button>{layer}</div>"
        for number, layer in enumerate(layers.values())
    )
    return "<p>shown</p>" + "".join(boxes)


async def test_what_lies_under_a_layer_that_lets_the_mouse_through_is_left_out(site: Site, tab: Tab) -> None:
    """No hit test finds such a layer, nor one that a style sheet makes."""
    await tab.goto(site.page(layered(LAYERS)))
    assert tab.text == ["shown"]
    assert tab.last is not None
    assert tab.last.observation.elements == ()


async def test_what_shows_through_a_layer_is_told(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(layered(CLEAR)))
    assert tab.text == ["shown", *(f"word{number} press{number}" for number in range(len(CLEAR)))]
    assert len(tab.last.observation.elements if tab.last and tab.last.observation.elements else ()) == len(
        CLEAR
    )


async def test_what_style_sheets_write_is_told(site: Site, tab: Tab) -> None:
    style = (
        ".a::after { content: 'after' } .b::before { content: attr(data-x) ' of' }"
        " .c::after { content: '\\e900' }"
        " .d::before { content: 'none'; display: none } .e::after { content: 'faint'; opacity: .02 }"
        " .f::after { content: 'tip'; position: absolute; left: -999px; width: 90px; top: 0; height: 20px }"
        " .h { appearance: none; width: 90px; height: 20px } .h::after { content: attr(aria-label) }"
        " .g::before { content: 'placed'; position: absolute; left: 0; top: 0; width: 90px; height: 20px }"
    )
    rows = "".join(f"<p class={name} data-x=seven style='position:relative'>{name}</p>" for name in "abcdef")
    placed = "<p class=g style='position:relative;padding-left:100px'>g</p>"
    tab_of_radio = "<input type=radio class=h aria-label='of a control'>"
    await tab.goto(site.page(f"<style>{style}</style>{rows}{placed}{tab_of_radio}"))
    assert tab.text == ["a after", "seven of b", "c", "d", "e", "f", "placed g", "of a control"]


async def test_numbers_that_style_sheets_count_are_told(site: Site, tab: Tab) -> None:
    style = (
        "h2 { counter-increment: part; counter-reset: point }"
        " h2::before { content: 'Part ' counter(part) ': ' } p { counter-increment: point }"
        " p::before { content: counters(part, '.') '.' counter(point, upper-roman) }"
    )
    rows = "<h2>one</h2><p>a</p><p>b</p><div style='height:700px'></div><h2>two</h2><p>c</p>"
    look = await tab.goto(site.page(f"<style>{style}</style><p>\ufdd07\ufdd1x</p>{rows}"))
    assert tab.text == ["0.I x", "Part 1: one", "1.I a", "1.II b"]
    assert look.observation.scroll[1] > VIEWPORT[1]
    await tab.step(Scroll("down"))
    assert tab.text[-2:] == ["Part 2: two", "2.I c"]


MASKS = {
    "an empty picture": "mask-image:url('data:image/svg+xml,<svg xmlns=%22http://www.w3.org/2000/svg%22/>')",
    "a gradient from nothing to nothing": "mask-image:linear-gradient(transparent,transparent)",
    "a path that is elsewhere": "clip-path:path('M500 500H600V600Z')",
    "no light": "filter:brightness(0);background:#000",
    "a blend with black": "mix-blend-mode:multiply;color:#fff",
    "letters of nothing": "background:linear-gradient(#fff,#fff);background-clip:text;color:transparent",
}
SHOWN = {
    "a gradient at the end": "mask-image:linear-gradient(to right,#000 90%,transparent)",
    "less light": "filter:brightness(.7);background:#fff",
    "a blend with white": "mix-blend-mode:multiply;color:#00c",
}


async def test_the_picture_tells_what_a_mask_a_blend_or_a_filter_leaves(site: Site, open_tab: Open) -> None:
    rows = [f'<p style="{style}">word{number} <b>more</b></p>' for number, style in enumerate(MASKS.values())]
    rows += [
        f'<p style="{style}">shown{number} <b>more</b></p>' for number, style in enumerate(SHOWN.values())
    ]
    for options in ({}, {"mode": "marks"}, {"jpeg_quality": 70, "config": BrowserConfig(capture_scale=0.5)}):
        tab = await open_tab(**options)
        await tab.goto(site.page(f"<body style='background:#fff'><p>first</p>{''.join(rows)}"))
        assert tab.text == ["first", *(f"shown{number} more" for number in range(len(SHOWN)))]
