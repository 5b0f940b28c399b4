"""What pages make usable in their own ways is numbered once, by the name that is seen on it."""

from __future__ import annotations

import pytest

from webgym.core.action import LeftClick, Type

from .conftest import Open, Site, Tab, batches
from .test_marks import evaluate

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


def names(tab: Tab) -> list[str]:
    assert tab.last is not None
    return [element.name for element in tab.last.observation.elements or ()]


LISTENS = (
    "<script>for (const one of document.querySelectorAll('.on'))"
    "one.addEventListener('{0}', () => {{}})</script>"
)
COMPONENT = (
    "<script>customElements.define('x-one', class extends HTMLElement {{ constructor() {{ super();"
    "this.attachShadow({{ mode: 'open' }}).innerHTML = `{0}`; }} }})</script>"
)
ICON = "<style>i{display:inline-block;width:9px;height:9px;border:1px solid}p{margin:0}</style>"
CLOUD = [(1, 2, "war"), (4, 5, "sea"), (9, 3, "sun"), (15, 7, "ice"), (20, 4, "fog"), (25, 8, "hut")]
WEEK = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"]
PAGES: dict[str, tuple[str, list[str]]] = {
    "only a listener": ("<p class=on>Heard</p><p>Plain</p>" + LISTENS.format("click"), ["Heard"]),
    "a press of the mouse": ("<b class=on>Heard</b>" + LISTENS.format("pointerdown"), ["Heard"]),
    "no press of the mouse": ("<b class=on>Plain</b>" + LISTENS.format("keydown"), []),
    "a link that leads nowhere": ("<a class=on>Next</a><a>Plain</a>" + LISTENS.format("click"), ["Next"]),
    "children of what only has a cursor": (
        "<div style='cursor:pointer;padding:20px'><b class=on>One</b> <b class=on>Two</b></div>"
        + LISTENS.format("click"),
        ["One", "Two"],
    ),
    "what is drawn by its content alone": (
        "<style>i{content:url('data:image/svg+xml,<svg xmlns=%22http://www.w3.org/2000/svg%22/>');"
        "width:20px;height:20px}</style><div class=on style='cursor:pointer;height:90px'>"
        "Mail <i class=on></i></div>" + LISTENS.format("click"),
        ["Mail", ""],
    ),
    "items of a list that listens": (
        "<ul class=on><li>One<li>Two<li>Three</ul>" + LISTENS.format("click"),
        ["One", "Two", "Three"],
    ),
    "a container of controls": (
        "<div class=on><button>One</button><div style='height:90px'></div></div>" + LISTENS.format("click"),
        ["One"],
    ),
    "shapes of a chart that hears for them": (
        "<div class=on><svg width=300 height=150><text y=20>Sales</text>"
        "<path fill=none stroke=grey d='M0 100h300' />"
        + "".join(f"<rect x={20 + 50 * n} y=40 width=30 height=60 fill=teal />" for n in range(3))
        + "</svg></div>"
        + LISTENS.format("click"),
        ["", "", ""],
    ),
    "fields of a month that the document hears for": (
        "<style>p{display:flex;height:60px;margin:0;user-select:none}p>b{flex:1}</style><div>"
        + 4 * f"<section><p>{7 * '<b></b>'}</p></section>"
        + "</div><script>document._reactListening1 = true;"
        "document.addEventListener('mousedown', () => {})</script>",
        28 * [""],
    ),
    "fields of a month for which no script listens": (
        "<style>p{display:flex;height:60px;margin:0;user-select:none}p>b{flex:1}</style><div>"
        + 4 * f"<section><p>{7 * '<b></b>'}</p></section>"
        + "</div><script>document._reactListening1 = true;"
        "document.addEventListener('mousedown', (() => {}).bind())</script>",
        [],
    ),
    "days of parts with a pointer, and of the next month": (
        "<style>p{position:relative;margin:0}p>*{cursor:pointer}i{position:absolute;left:0;width:20px;height:20px}"
        "</style><div class=on>"
        + "".join(f"<p><b>{day}</b><i></i></p>" for day in (28, 29, 30))
        + "<p>1</p></div>"
        + LISTENS.format("click"),
        ["28", "29", "30"],
    ),
    "a closed list that takes the focus, and its arrow": (
        ICON + "<div class=on role=listbox aria-expanded=false aria-label=Fruit tabindex=0>Apple "
        "<i class='on arrow'></i></div>" + LISTENS.format("click"),
        ["Fruit"],
    ),
    "an arrow in what opens": (
        ICON + "<p class=on style='cursor:pointer'><i class='on arrow' aria-hidden=true></i>What is it?</p>"
        "<p class=on style='cursor:pointer'><i class='on arrow'></i>Trunk</p>" + LISTENS.format("click"),
        ["What is it?", "Trunk", ""],
    ),
    "an arrow in a menu that takes the focus": (
        ICON + "<p class=on tabindex=0>More <i class='on dropdown'></i></p>" + LISTENS.format("click"),
        ["More"],
    ),
    "an arrow of which only a part is named so": (
        ICON
        + "<p class=on role=combobox aria-label=Fruit tabindex=0>Apple "
        + "<b class=on><i class=list-arrow></i></b></p>"
        + LISTENS.format("click"),
        ["Fruit"],
    ),
    "what clears a list, and the arrow behind it": (
        ICON
        + "<p class=on role=combobox aria-label=Fruit tabindex=0>Apple <i class=on aria-hidden=true></i>"
        + "<i class=on aria-hidden=true></i></p><p class=on role=combobox aria-label=Town tabindex=0>Bonn "
        + "<i class=on aria-hidden=true></i></p>"
        + LISTENS.format("click"),
        ["Fruit", "", "Town", ""],
    ),
    "a tree's item whose name alone listens": (
        ICON
        + "<p role=treeitem style='cursor:pointer;height:40px'><i class=on></i><b class=on>Trunk</b></p>"
        + LISTENS.format("click"),
        ["", "Trunk"],
    ),
    "names of columns that bear data": (
        "<style>b{display:inline-block;cursor:default;user-select:none}</style><div class=on><p>"
        + "".join(f"<b role=columnheader data-column-id={name}>{name}</b>" for name in ("Task", "From", "To"))
        + "</p><div style='height:600px'></div></div>"
        + LISTENS.format("click"),
        [],
    ),
    "a component of several controls": (
        "<x-one>Sizes</x-one>" + COMPONENT.format("<slot></slot>" + 4 * "<input size=4>"),
        4 * [""],
    ),
    "a component of a field and its buttons": (
        "<x-one>Size</x-one>" + COMPONENT.format("<slot></slot><input size=4>" + 2 * "<button></button>"),
        3 * ["Size"],
    ),
    "a name of a tree's item that is disabled": (
        ICON + "<p role=treeitem class=item-disabled><i class=on></i><b class=on>Leaf</b></p>"
        "<p role=treeitem><b class=on>Twig</b></p>" + LISTENS.format("click"),
        ["", "Twig"],
    ),
    "what listens beside a pointer on something taller": (
        "<div><p class=on>Agree</p><p style='cursor:pointer;height:60px'>More</p></div>"
        + LISTENS.format("click"),
        ["Agree", "More"],
    ),
    "most of the page": ("<div class=on style='height:600px'>Map</div>" + LISTENS.format("click"), []),
    "a card with a button in it": (
        "<div class=on style='cursor:pointer;height:90px'>Card <button>Buy</button></div>"
        + LISTENS.format("click"),
        ["Card Buy", "Buy"],
    ),
    "shapes of a drawing": (
        "<svg width=90 height=90><g aria-label=Plain><rect width=9 height=9 /></g>"
        "<circle class=on aria-label=Round cx=50 cy=50 r=30 /></svg>" + LISTENS.format("click"),
        ["Round"],
    ),
    "a canvas": ("<canvas class=on aria-label=Board></canvas>" + LISTENS.format("click"), ["Board"]),
    "delegated by jQuery": (
        "<div id=box><p>Plain</p><p class=item>Item</p></div><script>window.jQuery = () => {}; box.jQuery3 = "
        "{ events: { click: [{ selector: '.item' }] } }</script>",
        ["Item"],
    ),
    "one text of a parent without a box": (
        "<div class=on style='display:contents'>Heard</div>" + LISTENS.format("click"),
        ["Heard"],
    ),
    "days that a box around listens for": (
        "<div class=on><i tabindex=-1>One</i> <i tabindex=-1>Two</i></div><i tabindex=-1>Plain</i>"
        + LISTENS.format("click"),
        ["One", "Two"],
    ),
    "a cell that does nothing": ("<div role=grid><div role=gridcell>Plain</div></div>", []),
    "an editor with a hidden field": (
        "<div style='cursor:text;width:300px;height:90px'><div style='height:0;overflow:hidden'>"
        "<textarea aria-label=Code></textarea></div>some code</div>",
        ["Code"],
    ),
    "a component around a button": (
        "<x-one class=on>Save</x-one>"
        + COMPONENT.format("<style>:host{cursor:pointer}</style><button><slot></slot></button>")
        + LISTENS.format("click"),
        ["Save"],
    ),
    "a field named by its component": (
        "<x-one aria-label=Town></x-one>" + COMPONENT.format("<input>"),
        ["Town"],
    ),
    "a field named in a slot": (
        "<x-one><b slot=label>Town</b></x-one>"
        + COMPONENT.format("<label for=i><slot name=label></slot></label><input id=i>"),
        ["Town"],
    ),
    "a field drawn anew by its component": (
        "<x-one></x-one>" + COMPONENT.format("<p>Town</p><div style=opacity:0><input aria-label=Town></div>"),
        ["Town"],
    ),
    "a pointer under the mouse alone": (
        "<style>@media screen { .row:hover .one { cursor: pointer } }"
        ".two { & b:hover { cursor: pointer } } .row:not(:hover) i { cursor: pointer }</style>"
        "<div class=row><p class=one>One</p><p>Plain</p></div><div class=two><b>Two</b></div>",
        ["One", "Two"],
    ),
    "a pointer under the mouse in a component": (
        "<x-one></x-one>" + COMPONENT.format("<style>p:hover{cursor:pointer}</style><p>One</p><i>Plain</i>"),
        ["One"],
    ),
    "a panel that only takes the focus": ("<div role=tabpanel tabindex=0>Plain</div>", []),
    "a panel that listens": (
        "<div role=tabpanel tabindex=0 class=on>Heard</div>" + LISTENS.format("click"),
        ["Heard"],
    ),
    "what React listens for": (
        "<p id=a>Heard</p><p id=b>Plain</p><script>a.__reactProps$x = { onMouseDown() {} };"
        "b.__reactProps$x = { onKeyDown() {} }</script>",
        ["Heard"],
    ),
    "a part of a label with a cursor of its own": (
        "<label><input type=checkbox aria-label=Agree><span style='cursor:pointer'>I agree</span></label>",
        ["Agree"],
    ),
    "a label that the focus stops at": (
        "<input type=radio id=r style='position:absolute;clip:rect(0,0,0,0);pointer-events:none'>"
        "<label for=r tabindex=0 style='cursor:pointer'>List</label>",
        ["List"],
    ),
    "a part of a label that listens": (
        "<label><input type=checkbox aria-label=Agree><b class=on>Why?</b></label>" + LISTENS.format("click"),
        ["Agree", "Why?"],
    ),
    "a box around a tab of the same name": (
        "<div class=on style='cursor:pointer;padding:12px'><div role=tab tabindex=0>One</div></div>"
        + LISTENS.format("click"),
        ["One"],
    ),
    "an item of a tree whose text listens": (
        "<div role=tree><div role=treeitem>Root <b class=on>Root</b></div><div role=treeitem>Leaf</div></div>"
        + LISTENS.format("click"),
        ["Root", "Leaf"],
    ),
    "a slider as thin as a line": (
        "<div class=on style='padding:14px 0'><div role=slider tabindex=0 aria-label=Volume "
        "style='height:3px;background:red'></div></div>" + LISTENS.format("mousedown"),
        ["Volume"],
    ),
    "a track and its handle": (
        "<div class=on style='width:300px;height:30px;background:silver'><div role=slider tabindex=0 "
        "aria-label=Volume style='width:9px;height:30px;background:red'></div></div>"
        + LISTENS.format("mousedown"),
        ["Volume", "Volume"],
    ),
    "an icon in a slider and in a button": (
        "<div role=slider tabindex=0 aria-label=Volume><button tabindex=-1>x</button></div>"
        "<div role=button tabindex=0>More <button tabindex=-1>v</button></div>"
        "<div role=button tabindex=0>Card <button>Buy</button></div>",
        ["Volume", "More v", "Card Buy", "Buy"],
    ),
    "a part of the label of a button that is not seen": (
        "<style>button{position:absolute;width:1px;padding:0;opacity:0;overflow:hidden}</style>"
        "<label><button></button><i class=on>Off</i></label>"
        "<label><button></button><i style='cursor:pointer'>On</i></label>" + LISTENS.format("click"),
        ["Off", "On"],
    ),
    "cells of a table whose headings have a pointer": (
        "<table><tr><th class=on style='cursor:pointer'>Name<tr><td class=on>Ann<tr class=on><td>Bob</table>"
        + LISTENS.format("click"),
        ["Name"],
    ),
    "cells of a table without a pointer": (
        "<table><tr><td class=on>One<td class=on>Two</table>" + LISTENS.format("click"),
        ["One", "Two"],
    ),
    "text beside an item with a pointer": (
        "<ul><li class=on style='cursor:pointer'>Inbox<li class=on>Plain</ul>" + LISTENS.format("click"),
        ["Inbox"],
    ),
    "text around a button with a pointer": (
        "<span class=on>Tag <i class=on style='cursor:pointer'>x</i></span>" + LISTENS.format("click"),
        ["x"],
    ),
    "a button in the label of a hidden box": (
        "<style>input{position:absolute;width:0;height:0;opacity:0}</style>"
        "<label><input type=radio><button>Star</button></label>",
        ["Star"],
    ),
    "a group that only takes the focus": (
        "<div class=on style='height:600px'><p role=group tabindex=-1>Slide</p></div>"
        + LISTENS.format("click"),
        [],
    ),
    "what hears fingers alone": ("<b class=on>Plain</b>" + LISTENS.format("touchstart"), []),
    "days of weeks that a calendar listens for": (
        "<style>div div{height:60px}i{float:left;width:33%;height:60px}</style><div class=on>"
        + "<div><div><i>One</i><i>Two</i><i>Three</i></div></div>" * 3
        + "</div>"
        + LISTENS.format("mousedown"),
        ["One", "Two", "Three"] * 3,
    ),
    "a component around a hidden box and its label": (
        "<style>input{position:absolute;opacity:0}label{display:block}</style>"
        "<div role=checkbox tabindex=0 aria-label=Agree class=on><label><input type=checkbox>"
        "<b class=on style='cursor:pointer'>Agree</b></label></div>" + LISTENS.format("click"),
        ["Agree"],
    ),
    "parts of what fills a control": (
        "<div role=combobox tabindex=0 aria-label=Town style='width:90px'>"
        "<div class=on style='width:90px;height:30px'>"
        "<i style='float:right;cursor:pointer;border:9px solid'></i></div></div>" + LISTENS.format("click"),
        ["Town"],
    ),
    "what names a group": (
        "<b class=on id=l>Size</b><div role=radiogroup aria-labelledby=l>S, M</div>"
        + LISTENS.format("mousedown"),
        [],
    ),
    "a component around an icon of the same name": (
        "<div role=option tabindex=0 class=on style='width:200px'>Tag <x-one class=on "
        "style='float:right;padding:0 20px'></x-one></div>"
        + COMPONENT.format("<b tabindex=0 style='background:red'>x</b>")
        + LISTENS.format("click"),
        ["Tag x", "x"],
    ),
    "days that are not offered": (
        "<style>div{display:flex}div b{width:30px;height:30px}</style><div class=on><b>1</b><b>2</b><b>3</b>"
        "<b class='day-disabled'>4</b><b aria-disabled=true>5</b><b style='cursor:not-allowed'>6</b>"
        "<b disabled>7</b><b data-disabled>8</b><b data-disabled=false>9</b></div>" + LISTENS.format("click"),
        ["1", "2", "3", "9"],
    ),
    "a native button whose class says it is disabled": ("<button class=disabled>Send</button>", ["Send"]),
    "cells of a sheet that the document listens for": (
        "<style>td{user-select:none}</style><div tabindex=-1><table><tr><td>A<td>B</table></div>"
        "<table><tr><td>Plain</table><script>document.addEventListener('mousedown', () => {})</script>",
        ["A", "B"],
    ),
    "cells of a sheet that nothing listens for": (
        "<style>td{user-select:none}</style><div tabindex=-1><table><tr><td>A<td>B</table></div>",
        [],
    ),
    "bars of a plan that listens": (
        "<style>.plan,div{user-select:none}.plan,.in{position:relative;height:90px;width:600px}i{position:absolute;"
        "height:20px;top:9px;background:silver}</style><div class='plan on'><div class=in></div>"
        "<div class=in style='margin-top:-90px'><i style='width:90px'>Plan</i>"
        "<i style='left:120px;width:200px'>Build</i><i style='left:400px;width:60px'>Ship</i></div></div>"
        + LISTENS.format("click"),
        ["Plan", "Build", "Ship"],
    ),
    "delegated by a jQuery that is bundled": (
        "<div id=box><p>Plain</p><p class=item>Item</p></div><script>box.jQuery3 = "
        "{ events: { click: [{ selector: '.item' }] } }</script>",
        ["Item"],
    ),
    "what an earlier React, Inferno and Svelte listen for": (
        "<p id=a>One</p><p id=b>Two</p><p id=c>Three</p><p id=d>Plain</p><script>"
        "a.__reactEventHandlers$x = { onClick() {} }; b.$EV = { onClick() {} };"
        "c[Symbol('events')] = { click() {} }; d.__reactEventHandlers$x = { onKeyDown() {} }</script>",
        ["One", "Two", "Three"],
    ),
    "where React listens for all": (
        "<style>div{display:flex}b{width:30px;height:30px}</style>"
        "<div class=on id=root><b>1</b><b>2</b><b>3</b></div>"
        "<script>root._reactListeningx = true</script>" + LISTENS.format("click"),
        [],
    ),
    "a tag that cannot be selected around what has a pointer": (
        "<span class=on style='user-select:none'>Tag <i class=on style='cursor:pointer'>x</i></span>"
        + LISTENS.format("click"),
        ["x"],
    ),
    "a track around a handle with a pointer": (
        "<div class=on style='width:300px;height:14px;background:silver'><i tabindex=0 style='display:block;"
        "cursor:pointer;width:9px;height:14px;background:red'></i></div>" + LISTENS.format("mousedown"),
        ["", ""],
    ),
    "a pad that is aimed at": (
        "<div title=Colours style='cursor:crosshair;width:90px;height:90px;background:red'></div>"
        "<script>document.addEventListener('mousedown', () => {})</script>",
        ["Colours"],
    ),
    "items of a list that keeps room before and after those in view": (
        "<ul class=on style='margin:0;padding:0'><li style='height:40px'></li>"
        + "".join(f"<li style='height:20px' data-id={n}>Row {n}</li>" for n in range(3))
        + "<li style='height:900px'></li></ul>"
        + LISTENS.format("click"),
        ["Row 0", "Row 1", "Row 2"],
    ),
    "slides of a carousel, which is dragged, and one that listens": (
        "<div class='slick-list on' style='overflow:hidden'><div class=slick-track style='display:flex'>"
        + "".join(
            f"<p tabindex=-1 data-slick-index={n} style='width:100px;user-select:none'>{n}</p>"
            for n in range(3)
        )
        + "<p class='slick-slide on'>Four</p></div></div>"
        + LISTENS.format("click"),
        ["Four"],
    ),
    "a field as narrow as its caret, and what is around it": (
        "<div class=on style='border:1px solid;width:200px;padding:4px'><b>Apple</b>"
        "<input style='width:4px;border:0;padding:0'></div>" + LISTENS.format("mousedown"),
        ["Apple"],
    ),
    "a track of two pixels under a handle": (
        "<p style='padding:20px'><div class=on style='position:relative;width:300px;height:2px;"
        "cursor:pointer;background:silver'><i role=slider tabindex=0 style='position:absolute;left:100px;"
        "top:-12px;width:24px;height:24px;background:red'></i></div>" + LISTENS.format("click"),
        ["", ""],
    ),
    "ends of lines that are only dragged": (
        "<div class=on style='width:300px;height:200px'><i style='position:absolute;left:40px;top:40px;"
        "width:20px;height:20px;cursor:crosshair;background:red'></i><button>Mail</button></div>"
        + LISTENS.format("mousedown"),
        ["Mail"],
    ),
    "an arrow in a button that opens": (
        "<div role=button class=on tabindex=0 style='width:90px'>Fruit <i class='dropdown icon on' "
        "style='display:inline-block;width:14px;height:14px;background:red'></i></div>"
        + LISTENS.format("click"),
        ["Fruit"],
    ),
    "an item of a tree whose arrow has a pointer": (
        "<div role=tree class=on><div role=treeitem tabindex=0>One <i class=expand-button style='display:"
        "inline-block;width:14px;height:14px;background:red;cursor:pointer'></i></div></div>"
        + LISTENS.format("click"),
        ["One", ""],
    ),
    "jQuery that listens for whatever lies in a box": (
        "<div id=box><b>Apple</b> <i>Pear</i></div><script>box.jQuery3 = {events: {mousedown: Object.assign("
        "[{selector: '*:not(input)', handler: () => {}}], {delegateCount: 1})}}</script>",
        [],
    ),
    "boxes to tick and arrows of rows that a tree listens for": (
        ICON
        + "<style>s::before{content:'\\a0'}</style><div class=on>"
        + "".join(
            f"<p><i class=t-checkbox></i><s class=expander></s><b>{name}</b></p>"
            for name in ("One", "Two", "Three")
        )
        + "</div>"
        + LISTENS.format("click"),
        ["One", "", "Two", "", "Three", ""],
    ),
    "arrows of items that listen themselves": (
        ICON
        + "<div class=on><p class=on>One <i class=expander></i><p class=on>Two <i class=expander></i></div>"
        + "<div class=on><button>A <i class=toggle></i></button><button>B <i class=toggle></i></button></div>"
        + LISTENS.format("click"),
        ["One", "Two", "A", "B"],
    ),
    "arrows in cells that a grid listens for": (
        "<style>[role=gridcell]{width:90px}</style><div class=on role=grid><div role=row>"
        "<div role=gridcell tabindex=-1>Red <i class=listArrow>▼</i></div>"
        "<div role=gridcell tabindex=-1>Blue <i class=listArrow>▼</i></div></div></div>"
        "<div class=on style='height:600px'><p>Plain <i class=listArrow>▼</i></p>"
        "<p>Plain <i class=listArrow>▼</i></p></div>" + LISTENS.format("click"),
        ["Red ▼", "▼", "Blue ▼", "▼"],
    ),
    "headings that a table is sorted by": (
        "<style>th{width:90px}</style><div class=on><b role=columnheader aria-sort=none>Town</b>"
        "<b role=columnheader>Plain</b> and some more text</div><table class=on>"
        "<tr><th aria-sort=none><th aria-sort=none>Name<th class=col-sortable>Age"
        "<th class=not-sortable>Plain<th>Plain"
        "<tr><td>Ann<td>20<td>x<td>y</table>"
        "<table><tr><th aria-sort=none>Plain<th aria-sort=none>Plain</table>" + LISTENS.format("click"),
        ["Town", "Name", "Age"],
    ),
    "handlers that keep an event from having an effect": (
        "<p oncontextmenu='return false'>Plain</p><p id=a>Plain</p><p id=b>Plain</p><p id=c>Heard</p>"
        "<p id=d>Heard</p><script>a.__reactProps$x = { onClick: (e) => e.stopPropagation() };"
        "b.addEventListener('click', function (event) { event.preventDefault(); return !1 });"
        "c.addEventListener('mousedown', (e) => { e.preventDefault() });"
        "d.addEventListener('click', (e) => { e.preventDefault(); go() })</script>",
        ["Heard", "Heard"],
    ),
    "what is only dragged": (
        "<style>p{cursor:grab;height:30px}</style><p class=on>Plain</p><p class=on id=heard>Heard</p>"
        "<b class=on style='cursor:grab'>Handle</b>"
        + LISTENS.format("pointerdown")
        + "<script>heard.addEventListener('click', () => {})</script>",
        ["Heard", "Handle"],
    ),
    "slides that a box around is swiped by": (
        "<ul class=on style='cursor:grab'><li>One<li>Two<li>Three</ul><button>Buy</button>"
        + LISTENS.format("mousedown"),
        ["Buy"],
    ),
    "a bar that is an edge to drag": (
        "<div class=on title=Size><div style='cursor:ns-resize;height:20px;border:1px solid'></div></div>"
        + LISTENS.format("mousedown"),
        [],
    ),
    "labels of an axis": (
        "<svg width=300 height=90><g>"
        + "".join(f"<text class=on x={x} y=80>{x}</text>" for x in range(20, 140, 20))
        + "</g><g>"
        + "".join(f"<text class=on x={10 * x} y={9 * y}>{word}</text>" for x, y, word in CLOUD)
        + "</g></svg>"
        + LISTENS.format("click"),
        [word for _, _, word in CLOUD],
    ),
    "a large chart": (
        "<svg class=on width=900 height=330 aria-label=Chart><text y=20>Sales</text></svg>"
        "<svg class=on width=900 height=330 aria-label=Board></svg>" + LISTENS.format("click"),
        ["Board"],
    ),
    "names of days and fields without a day": (
        "<style>i{display:inline-block;width:22px;height:20px;border:1px solid}</style><div>"
        + "".join(f"<b><i class=on>{name}</i></b>" for name in "Mo 2,Tu 3,We 4,Thu 5,Fri 6".split(","))
        + "</div><div style='width:200px'>"
        + "".join(f"<i class=on>{day if day > 0 else ''}</i>" for day in range(-2, 29))
        + "</div>"
        + LISTENS.format("click"),
        [str(day) for day in range(1, 29)],
    ),
    "names of days that have a pointer": (
        "<style>b{cursor:pointer}</style><p>" + "".join(f"<b class=on>{name}</b> " for name in WEEK) + "</p>"
        "<p>" + "".join(f"<i class=on>{name}</i> " for name in WEEK[:4]) + "</p>" + LISTENS.format("click"),
        [*WEEK, *WEEK[:4]],
    ),
    "what bears data for a script around it": (
        "<style>.day{cursor:default}</style><div class=on><p>Plain</p><div><p class=day data-time=1>One</p>"
        "<p class='day first' data-time=2>Two</p><p>Plain</p></div><p class=day data-time=3>Three</p>"
        + "".join(f"<b class=day data-id={same}>Plain</b>" for same in (1, 1, 2))
        + "".join(f"<i data-id={own}>Plain</i><u class=day data-look={own}>Plain</u>" for own in (1, 2, 3))
        + "".join(f"<p class=day data-id={own} style='height:9px;border:1px solid'></p>" for own in (4, 5, 6))
        + "</div><p class=day data-time=4>Plain</p>"
        + LISTENS.format("click"),
        ["One", "Two", "Three"],
    ),
    "rows that bear data, with a part that has a pointer": (
        "<style>li{user-select:none}b{cursor:pointer}div{height:600px}</style><div class=on><h1>Plain</h1>"
        + "".join(f"<li data-id={name}>{name} <b>+</b></li>" for name in ("One", "Two", "Three"))
        + "</div>"
        + LISTENS.format("click"),
        ["One +", "+", "Two +", "+", "Three +", "+"],
    ),
    "what bears data in what is only dragged": (
        "<style>p{cursor:default}</style><div class=on style='height:600px'><h1>Plain</h1>"
        + "".join(f"<p data-id={own}>Plain</p>" for own in (1, 2, 3))
        + "</div>"
        + LISTENS.format("mousedown"),
        [],
    ),
    "regions of a map that a box around listens for": (
        "<div class=on><svg width=90 height=90>"
        + "".join(f"<path data-code={n} d='M{n * 30} 0h{n * 5 + 9}v30h-9' />" for n in range(3))
        + "</svg></div>"
        + LISTENS.format("click"),
        ["", "", ""],
    ),
    "a component that is the label of a box to tick": (
        "<style>b{display:inline-block;width:9px;height:9px}</style>"
        "<x-one><b role=checkbox tabindex=0 aria-label='I agree'></b> I agree</x-one>"
        + COMPONENT.format("<div class=on style='width:300px'><slot></slot></div>")
        + "<script>document.querySelector('x-one').shadowRoot.firstChild.onclick = () => {}</script>",
        ["I agree"],
    ),
    "a part of a button that is called the same": (
        "<div role=button class=on style='height:60px;width:90px'><b class=on>Size</b></div>"
        "<div role=button class=on style='height:60px;width:90px'>Tag <b class=on>x</b></div>"
        + LISTENS.format("click"),
        ["Size", "Tag x", "x"],
    ),
    "a field that is transparent until it has the focus": (
        "<div role=group class=on aria-label=Day style='width:250px;height:50px;border:1px solid'>"
        "<p tabindex=0 style='opacity:0'><s class=on><b role=spinbutton contenteditable aria-label=Month>"
        "MM</b></s> <b role=spinbutton contenteditable aria-label=Year>YYYY</b></p>"
        "<button>Choose</button></div>" + LISTENS.format("click"),
        ["Day", "Choose"],
    ),
    "the label of a field that nobody gets to": (
        "<style>input{position:absolute;clip:rect(0,0,0,0);pointer-events:none}</style>"
        "<label for=i>Plain</label><input id=i tabindex=-1>",
        [],
    ),
    "a hint below the field in a label": (
        "<label>Town <span style='position:relative'><input readonly tabindex=-1 value=Lisbon "
        "style='position:absolute;left:0'><input style='position:relative'></span></label>",
        ["Town"],
    ),
    "cards that take the focus, with a control in each": (
        "<style>div{width:300px;height:140px}</style>"
        "<div tabindex=0 class=on>Lamp <button>Buy</button></div>"
        "<div tabindex=0 class=on>Desk <a href=#x>More</a></div>"
        "<div tabindex=0>Plain <button>On</button></div>"
        "<div tabindex=0 role=toolbar class=on>Plain <button>Bold</button></div>" + LISTENS.format("click"),
        ["Lamp Buy", "Buy", "Desk More", "More", "On", "Bold"],
    ),
    "cells of nothing but a button": (
        "<style>[role=gridcell]{width:200px;height:50px}</style><div role=grid>"
        "<div role=gridcell tabindex=-1 class=on><button>Edit</button></div>"
        "<div role=gridcell tabindex=-1 class=on>Name <button>Sort</button></div></div>"
        + LISTENS.format("click"),
        ["Edit", "Name Sort", "Sort"],
    ),
    "a cell that is cut, around a box to tick": (
        "<style>input{margin:0;width:40px;height:40px}</style><div style='height:30px;overflow:hidden'>"
        "<div role=gridcell tabindex=-1 aria-label='Row 1' style='width:50px;height:60px'>"
        "<input type=checkbox aria-label=Choose></div></div>",
        ["Choose"],
    ),
    "a button all of whose parts listen": (
        "<div role=button tabindex=0 class=on style='height:60px'>"
        "<i class=on>+</i> <b class=on>Panel</b></div>" + LISTENS.format("click"),
        ["+ Panel"],
    ),
    "an item of a tree and the one below it": (
        "<ul role=tree><li role=treeitem tabindex=0 class=on><div>src</div><ul role=group style=padding:0>"
        "<li role=treeitem tabindex=-1 class=on><div>a.ts</div></li></ul></li></ul>"
        + LISTENS.format("click"),
        ["src a.ts", "a.ts"],
    ),
    "sliders on each other, and what is drawn for a box to tick": (
        "<style>input { pointer-events: none; position: absolute; left: 9px } .clip { clip: rect(0 0 0 0) }"
        "[type=range] { appearance: none; background: none; width: 200px; margin: 0 }"
        "::-webkit-slider-thumb { pointer-events: auto }</style><br>"
        "<input type=range aria-label=From value=20>"
        "<input type=range aria-label=To value=70><br><br><input type=checkbox class=clip id=t>"
        "<i class=on style='border: 1px solid; padding: 9px'></i><label for=t>Tick</label>"
        + LISTENS.format("click"),
        ["From", "To", "Tick"],
    ),
    "a switch, and the field that it keeps for forms": (
        "<style>input{position:fixed;left:0;top:0;width:1px;height:1px;clip:rect(0 0 0 0)}</style>"
        "<label><button role=switch style='width:40px;height:20px' aria-label=Dark></button></label>"
        "<label><span role=switch tabindex=0 style='border:9px solid'><i hidden>x</i></span>"
        "<input type=checkbox tabindex=-1 aria-hidden=true> Notify</label>",
        ["Dark", "Notify"],
    ),
    "the combobox around a field": (
        "<div role=combobox class=on aria-label=Fruit><input aria-label=Search><button>v</button></div>"
        "<div role=combobox tabindex=0 aria-label=Town style='padding:20px'><input aria-label=Search></div>"
        + LISTENS.format("click"),
        ["Search", "v", "Town", "Search"],
    ),
    "what is written in a button, or an item, that is called otherwise": (
        "<style>button,[role]{padding:20px}</style><button aria-label=cancel><b class=on>No</b></button>"
        "<button aria-label=Next><i class=on style='padding:9px;border:1px solid'></i></button>"
        "<div role=menuitem tabindex=0><b class=on>big</b></div>" + LISTENS.format("click"),
        ["cancel", "Next", "big"],
    ),
    "a heading that listens, and the arrow that a click brings": (
        "<div role=columnheader aria-sort=ascending class=on style='width:200px;height:30px'>Town "
        "<b role=button aria-label=Sorted style='cursor:pointer'>^</b></div>"
        "<p class=on style='width:200px;height:30px'>Plain <b class=on style='cursor:pointer'>More</b></p>"
        + LISTENS.format("click"),
        ["Town Sorted", "Sorted", "More"],
    ),
    "a label's own name": ("<i id=l aria-label=Town>x</i><input aria-labelledby=l>", ["Town"]),
    "what a component that is not offered draws": (
        "<x-one></x-one><x-one disabled></x-one><x-one disabled=false></x-one>"
        + COMPONENT.format("<div role=menuitem>Bin</div>"),
        ["Bin", "Bin"],
    ),
    "the button of an item of a menu that is called otherwise": (
        "<div role=menuitem aria-label=item style='width:260px'><button>v</button>"
        "<button style='width:200px;height:30px'>Home</button></div>",
        ["v", "Home"],
    ),
    "a component that is the label of a field": (
        "<x-one for=f style='cursor:pointer'>Name</x-one><input id=f aria-label=Name>"
        "<script>document.querySelector('x-one').onclick = () => f.focus()</script>",
        ["Name"],
    ),
    "a component drawn in line around a taller field": (
        "<br><br><x-one class=on aria-label=Note tabindex=0></x-one>"
        + COMPONENT.format("<textarea style='height:50px;margin-bottom:20px'></textarea>")
        + LISTENS.format("click"),
        ["Note"],
    ),
    "what is drawn around a transparent box to tick": (
        "<div class=on style='width:40px;height:40px;border:1px solid'>"
        "<input type=checkbox id=t style='opacity:0;width:40px;height:40px;margin:0'></div>"
        "<label for=t>Agree</label>" + LISTENS.format("mousedown"),
        ["Agree"],
    ),
    "a heading of nothing but its button": (
        "<table><tr><th class=on style='cursor:pointer;width:300px;height:90px'>"
        "<b role=button tabindex=0>Weight</b></table>" + LISTENS.format("click"),
        ["Weight"],
    ),
    "what is drawn around a field, with its value": (
        "<div class=on style='width:200px;padding:20px;cursor:pointer'><b id=l>Food</b>"
        "<div role=combobox tabindex=0 aria-labelledby=l style='width:90px'>Pizza</div></div>"
        + LISTENS.format("click"),
        ["Food"],
    ),
    "labels whose handler does nothing": (
        "<label onclick='' for=f>Name</label><input id=f>"
        "<p onclick='javascript:void(0)'>Plain</p><p onclick='return false;'>Plain</p><p onclick=go()>Go</p>",
        ["Name", "Go"],
    ),
    "a field that is not displayed, beside a button in its place": (
        "<input type=radio id=r style='display:none'><a><button role=radio aria-label=Grey></button></a>"
        "<label for=r>Grey</label>",
        ["Grey"],
    ),
    "what takes the pointer of what is around it away": (
        "<table><tr style='cursor:pointer'><th class=on>Name<th class=on style='cursor:default'>Plain"
        "<th class=on style='cursor:default;width:20px;background:red'></table>" + LISTENS.format("click"),
        ["Name", ""],
    ),
    "the value and the arrow of a list that opens": (
        "<div role=combobox tabindex=0 aria-label=Town style='width:300px;padding:20px'>"
        "<b class=on>Bonn</b> <i role=button tabindex=0 aria-expanded=false>v</i></div>"
        + LISTENS.format("click"),
        ["Town"],
    ),
    "cells of which one takes the focus": (
        "<div role=grid class=on>"
        + "".join(f"<span role=gridcell {'tabindex=0' * (n == 1)}>{n}</span>" for n in (1, 2))
        + "</div>"
        + LISTENS.format("click"),
        ["1", "2"],
    ),
    "icons that throw rows away": (
        ICON
        + "<div class=on>"
        + "<p>Row <i class=wxi-trash></i> <i class=wxi-star></i></p>" * 2
        + "</div>"
        + LISTENS.format("click"),
        ["Row Row", "", ""],
    ),
}


@pytest.mark.parametrize("pages", batches(3, PAGES))
async def test_what_can_be_used_is_numbered_once(site: Site, tab: Tab, pages: list[str]) -> None:
    found = {}
    for page in pages:
        await tab.goto(site.page(PAGES[page][0]))
        found[page] = names(tab)
    assert found == {page: PAGES[page][1] for page in pages}


async def test_a_wide_component_is_clicked_where_its_box_to_tick_is(site: Site, tab: Tab) -> None:
    inner = "<div><label for=t>Loud</label><input type=checkbox id=t style=opacity:0></div>"
    await tab.goto(site.page("<x-one role=switch style='display:block'></x-one>" + COMPONENT.format(inner)))
    assert names(tab) == ["Loud"]
    assert tab.find("Loud").box[2] < 100, "its label, not all of the line"


async def test_what_listens_in_frames_is_numbered(site: Site, open_tab: Open) -> None:
    inner = site.page("<b class=on>Inner</b>" + LISTENS.format("click"))
    tab = await open_tab("marks")
    await tab.goto(site.page(f"<iframe src={inner}></iframe><iframe src={site.elsewhere(inner)}></iframe>"))
    assert names(tab) == ["Inner", "Inner"]


async def test_a_text_in_a_slot_is_part_of_the_button_around_the_slot(site: Site, open_tab: Open) -> None:
    body, _ = PAGES["a component around a button"]
    tab = await open_tab("marks")
    await tab.goto(site.page(f"{body}<script>onclick = () => {{ document.title = 'clicked' }}</script>"))
    box = tab.find("Save").box
    assert box[3] > 18, "all of it, not a part beside its text"
    look = await tab.step(LeftClick(tab.at("Save")))
    assert look.observation.title == "clicked"


async def test_what_is_slotted_into_closed_roots_is_part_of_the_button_there(site: Site, tab: Tab) -> None:
    page = (
        "<x-two>Text</x-two> <x-two><b>Bold</b></x-two><script>"
        "for (const [name, inner] of [['x-one', 'button'], ['x-two', 'x-one']])"
        "customElements.define(name, class extends HTMLElement { connectedCallback() {"
        "this.attachShadow({ mode: 'closed' }).innerHTML ="
        "`<${inner} style='padding:9px'><slot></slot></${inner}>` } })</script>"
    )
    await tab.goto(site.page(page))
    assert names(tab) == ["Text", "Bold"]
    assert min(tab.find(name).box[3] for name in ("Text", "Bold")) > 30, "all of it"


async def test_an_icon_in_a_component_keeps_its_own_place(site: Site, tab: Tab) -> None:
    inner = "<b style=margin-right:80px><slot></slot></b><i part=remove-button></i>"
    script = (
        "<script>const chip = document.querySelector('x-one'); chip.addEventListener('mousedown', () => {});"
        "chip.shadowRoot.querySelector('i').addEventListener('click', () => {})</script>"
    )
    await tab.goto(site.page("<x-one>Apple</x-one>" + COMPONENT.format(ICON + inner) + script))
    assert tab.last is not None
    (element,) = tab.last.observation.elements or ()
    assert element.box[2] < 20


async def test_a_transparent_field_has_its_role_and_is_typed_into(site: Site, open_tab: Open) -> None:
    body, _ = PAGES["a field that is transparent until it has the focus"]
    tab = await open_tab("marks")
    await tab.goto(site.page(f"<style>p:focus-within{{opacity:1 !important}}</style>{body}"))
    assert tab.find("Day").role == "spinbutton"
    await tab.step(Type(tab.at("Day"), "7"))
    assert not tab.notices
    assert names(tab) == ["Month", "Year", "Choose"]


async def test_pages_cannot_tell_that_they_are_asked(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(
        site.page(
            "<p class=on style='cursor:grab'>Heard</p>"
            + LISTENS.format("click")
            + "<script>window.seen = [];"
            "for (const name of ['preventDefault', 'composedPath']) { const own = Event.prototype[name];"
            "Event.prototype[name] = function () { seen.push(name); return own.call(this); } }"
            "for (const [type, name] of [[Function, 'toString'], [RegExp, 'exec'], [RegExp, 'test']])"
            "type.prototype[name] = () => { seen.push(name) };"
            "Object.defineProperty(Event.prototype, 'bubbles', { get: () => { seen.push('bubbles') } });"
            "const { dispatchEvent } = EventTarget.prototype;"
            "EventTarget.prototype.dispatchEvent = function (event) {"
            "seen.push(event.type); return dispatchEvent.call(this, event); }</script>"
        )
    )
    assert names(tab) == ["Heard"]
    assert await evaluate(tab, "[...seen, typeof getEventListeners]") == ["undefined"]
