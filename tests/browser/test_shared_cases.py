"""Pages from public bug reports, each with what a person would see: the folder ``shared`` beside the project.

Every row says what is done and what the agent must then see or be told. Small pages of our own test the same
in ``make test``; these run with ``make test-all`` where the folder is there.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from webgym.core.action import (
    DoubleClick,
    Drag,
    GoBack,
    Hover,
    LeftClick,
    Press,
    RightClick,
    Scroll,
    Target,
    Type,
    Upload,
    Wait,
)

from .conftest import Open, Site, Tab

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "cases" / "browser"

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.asyncio(loop_scope="package"),
    pytest.mark.skipif(not FOLDER.is_dir(), reason="the folder of shared cases is not beside the project"),
]

KINDS = {"html": "text/html", "pdf": "application/pdf", "js": "text/javascript", "json": "application/json"}
KINDS |= {"txt": "text/plain", "xml": "text/xml", "svg": "image/svg+xml"}


async def _file(request: Request) -> Response:
    path = FOLDER / request.url.path.strip("/")
    return Response(path.read_bytes(), media_type=KINDS[path.suffix.strip(".")])


async def _echo(request: Request) -> Response:
    said = (await request.body()).decode() or str(request.url.query)
    return Response(
        f"<!doctype html><meta charset=utf-8><title>echo</title><h1>ECHO {said}</h1>", media_type="text/html"
    )


async def _slow(request: Request) -> Response:
    await asyncio.sleep(int(request.query_params["ms"]) / 1000)
    return Response(
        request.query_params.get("body", "ok"), media_type=request.query_params.get("type", "text/plain")
    )


async def _picture(request: Request) -> Response:
    await asyncio.sleep(int(request.query_params.get("ms", 0)) / 1000)
    drawn = BytesIO()
    Image.new("RGB", (300, 200), (0, 128, 0)).save(drawn, "png")
    return Response(drawn.getvalue(), media_type="image/png")


async def _events(_: Request) -> Response:
    async def more() -> Any:
        for number in range(100):
            yield f"data: tick {number}\n\n"
            await asyncio.sleep(0.3)

    return StreamingResponse(more(), media_type="text/event-stream")


async def _basic(request: Request) -> Response:
    if request.headers.get("authorization") == "Basic dTpw":
        return Response("<h1>SECRET 4711</h1>", media_type="text/html")
    return Response("no", 401, headers={"www-authenticate": 'Basic realm="r"'})


def serve(site: Site) -> None:
    """Put the pages and what they ask for on the site."""
    for file in FOLDER.rglob("*"):
        if file.suffix.strip(".") in KINDS:
            site.on(f"/{file.relative_to(FOLDER)}", _file)
    for path, handler in {
        "/echo": _echo,
        "/slow": _slow,
        "/pic": _picture,
        "/sse": _events,
        "/basic": _basic,
    }.items():
        site.on(path, handler)


Do = Callable[[Tab], Awaitable[object]]


def click(name: str) -> Do:
    return lambda tab: tab.step(LeftClick(tab.at(name)))


def write(name: str, text: str, enter: bool = True) -> Do:
    return lambda tab: tab.step(Type(tab.at(name), text, enter=enter))


def do(action: object) -> Do:
    return lambda tab: tab.step(action)


def sleep(seconds: float) -> Do:
    """The agent thinks, with the page's processes stopped as between the steps of a server."""

    async def thinking(tab: Tab) -> None:
        with tab.slot.asleep():
            await asyncio.sleep(seconds)

    return thinking


async def at_rest(tab: Tab) -> None:
    """What the last picture shows stays where it is."""
    shown = tab.text
    await tab.step(Wait(1.5))
    assert tab.text == shown


async def all_green(tab: Tab) -> None:
    """The pictures of the page are painted, or the agent is told that they are not there yet."""
    assert tab.last is not None
    shown = Image.open(BytesIO(tab.last.image)).convert("RGB")
    counted = {color: number for number, color in shown.getcolors(1 << 20) or ()}
    assert counted.get((0, 128, 0), 0) > 3000
    assert counted.get((136, 136, 136), 0) < 3000 or any(kind == "still_loading" for kind, _ in tab.notices)


def place(x: float, y: float) -> Target:
    return Target(coordinate=(x, y))


@dataclass(frozen=True)
class Case:
    """What is done on a page, and what must then be seen.

    Attributes:
        steps: after the page was opened.
        text: in the text or the fields of the last observation.
        notice: in a notice of any of its observations, as ``kind: text``.
        either: enough if one of ``text`` and ``notice`` holds.
        absent: not in the last observation.
        marked: names of elements with a number.
        unmarked: names of elements without one.
        page: the file that is opened.
    """

    steps: tuple[Do, ...] = ()
    text: tuple[str, ...] = ()
    notice: tuple[str, ...] = ()
    either: bool = False
    absent: tuple[str, ...] = ()
    marked: tuple[str, ...] = ()
    unmarked: tuple[str, ...] = ()
    page: str = "index.html"
    mode: str = "marks"


MISSING = (
    *("W1 after", "W2 attr", "W3 slot", "W4 value", "W5 place", "W6-1 item", "W7 option", "W8 svg"),
    *("W9 frame", "W10 summary", "W11 disabled", "W12 drop", "W13 down", "W14 edge", "W15", "W16"),
)

CASES: dict[str, Case] = {
    "01-webgl": Case(text=("YES",)),
    "02-hover-media": Case(
        (do(Hover(place(60, 12))),),
        ("Laptops", "(hover:hover)=true", "(pointer:fine)=true"),
        absent=("TOUCH",),
    ),
    "03-pdf": Case((click("Open invoice"),), ("TOTAL 4711",)),
    "04-validation-bubble": Case((click("Send"),), notice=("Please fill out this field",)),
    "05-datalist": Case((write("City", "Ber", enter=False), click("BER-2 Berlin")), ("BER-2",)),
    "07-popup-opener": Case((click("Sign in"), click("Continue as ada")), ("signed in as ada", "my draft")),
    "08-popup-written": Case((click("Show receipt"),), ("RECEIPT 4711",)),
    "10-confirm": Case((click("Clean up"),), notice=("dialog: ",)),
    "11-prompt": Case((click("New folder"),), notice=("dialog: ",)),
    "12-shift": Case((sleep(4.2), click("Keep")), ("KEPT",)),
    "14-slow-search": Case((click("Search"),), ("RESULT-4711",), ("still_loading",), either=True),
    "15-count-up": Case(text=("1,284",), notice=("still_loading",), either=True),
    "16-basic-auth": Case(
        (click("Members"), lambda tab: tab.goto(tab.base.replace("//", "//u:p@") + "/basic")),
        ("SECRET 4711",),
        ("password",),
    ),
    "17-clipboard": Case((click("Copy code"),), ("copied",), absent=("failed",)),
    "18-geolocation": Case((click("Use my location"),), ("error 1",)),
    "19-history-trap": Case(
        (click("Go"), do(GoBack())), ("START",), ("go_back leaves it",), either=True, page="start.html"
    ),
    "20-post-back": Case(
        (click("Search"), lambda tab: tab.goto(f"{tab.base}/echo?item"), do(GoBack())),
        ("ECHO q=shoes",),
        ("again",),
        either=True,
    ),
    "21-meta-refresh": Case(text=("ECHO arrived",)),
    "22-video": Case(
        (do(Wait(1.5)), lambda tab: tab.step(LeftClick(tab.at_role("button"))), do(Wait(1))), ("playing",)
    ),
    "23-frameset": Case((click("News"),), ("NEWS 4711",)),
    "24-focus-thief": Case(
        (sleep(4.2), write("Search", "shoes")), ("ECHO q=shoes",), ("action_failed",), either=True
    ),
    "25-font-late": Case(text=("PRICE 4711",)),
    "26-iframe-modal": Case((click("Accept"),), marked=("Behind",)),
    "27-contenteditable": Case(
        (lambda tab: tab.step(Type(tab.at_role("textbox"), "new text", enter=False)),),
        ('model: ["new text"]',),
    ),
    "29-select-multiple": Case((click("Choose"),), ("two",)),
    "31-bfcache": Case(
        (click("Search shoes"), click("Shoe 1"), do(GoBack())), ("3 results",), ("reloaded",), either=True
    ),
    "32-virtual-list": Case((do(Scroll("down")),), ("Row 20",)),
    "33-infinite-scroll": Case(
        (do(Scroll("down")), do(Scroll("down"))), ("Item 11",), ("still_loading",), either=True
    ),
    "34-scroll-snap": Case((do(Scroll("down")),) * 4, ("S5",)),
    "35-smooth-lib": Case((do(Scroll("down")), at_rest), ("Line 7",), absent=("Line 1 ",)),
    "36-modal-scroll": Case((do(Scroll("down")),) * 6 + (click("Accept"),), ("ACCEPTED",)),
    "37-spa": Case((click("Item 7"), do(GoBack())), ("Item 7",)),
    "38-websocket": Case((click("Buy"),), ("bought",)),
    "39-close": Case((click("Go"), click("Close window")), ("Thank you",), page="start.html"),
    "40-print": Case((click("Print"),), ("printed",)),
    "43-pointer-slider": Case(
        (lambda tab: tab.step(Drag(tab.at("Min"), place(*tab.beside("Min", 160)))),),
        ("-80",),
        absent=("20-80",),
    ),
    "44-invisible": Case(
        marked=("A plain", "G card"),
        unmarked=("B opacity", "C covered", "D clipped", "I hidden", "J outside"),
    ),
    "45-mask": Case((write("phone", "4155550123", enter=False),), ("(415) 555-0123",)),
    "46-emoji": Case((write("aa", "👩‍👩‍👧 é شكرا 漢字 🇩🇪", enter=False),), ("👩‍👩‍👧 é شكرا 漢字 🇩🇪",)),
    "47-debounce-suggest": Case(
        (write("City", "Par", enter=False), click("Paris, TX")), ("chosen Paris, TX",)
    ),
    "48-frames-deep": Case((write("Card number", "42", enter=False), click("Pay")), ("ECHO card=42",)),
    "49-sandbox-frame": Case(text=("CODE 4711",), marked=("Confirm",)),
    "50-json": Case(text=("4711",), page="a.json"),
    "51-popover": Case((click("Menu"), click("Save")), ("saved",)),
    "52-canvas-app": Case((do(LeftClick(place(390, 270))),), ("BLUE",), mode="coordinates"),
    "53-huge": Case((click("L5"),), ("ECHO 5",)),
    "54-first-click": Case(
        (do(LeftClick(place(30, 30))), do(LeftClick(place(30, 30)))), ("ORDERED",), mode="coordinates"
    ),
    "55-media-perm": Case((click("Camera"), do(Wait(2))), ("cam Not", "note denied")),
    "56-file-picker": Case(
        (lambda tab: tab.step(Upload(tab.at("Choose file"), ("notes.txt",))),), notice=("action_failed",)
    ),
    "58-scrollbars": Case(notice=("more",)),
    "59-service-worker": Case(text=("worker ready",)),
    "60-notify-late": Case((click("Pay"),), ("PAID 4711",), ("still_loading",), either=True),
    "62-hold-drag": Case(
        (do(Drag(place(54, 52), place(300, 52), time=0.4)),), ("dropped at",), mode="coordinates"
    ),
    "64-sight-layer": Case(text=("Subscribe",), absent=("4711",), unmarked=("Order",)),
    "65-count-up-2s": Case(text=("12,847", "963"), notice=("still_loading",), either=True),
    "68-table-load": Case(text=("Row 10",), notice=("still_loading",), either=True),
    "72-swallow": Case((write("paste only", "abc", enter=False),), notice=("did not take all",)),
    "74-frame-scroll": Case((do(Scroll("down")),), ("Para 8",)),
    "85-wrapped-link": Case((click("then a link here"),), ("ECHO hit",)),
    "87-tab-char": Case((write("many", "one\ttwo\nthree", enter=False),), ("three",)),
    "88-open-late": Case((lambda tab: tab.step(Hover(place(40, 40))), click("Log out")), ("logged out",)),
    "89-lazy-images": Case((do(Scroll("down")), do(Scroll("down")), all_green), ("top",), either=True),
    "90-lease-timer": Case((sleep(5),), ("held for",), absent=("EXPIRED",)),
    "91-shadow-form": Case((write("type a city", "Paris", enter=False), click("Go")), ("ECHO q=Paris",)),
    "92-react-like": Case((write("code", "abc", enter=False),), ("ABC",)),
    "93-otp": Case((write("Digit 1", "471100", enter=False),), ("471100",)),
    "94-rtl": Case((click("زر 1"),), ("زر 1",)),
    "95-beforeunload": Case(
        (write("note", "draft", enter=False), lambda tab: tab.goto(f"{tab.base}/echo?left")),
        ("ECHO left",),
        ("dialog: the question whether to leave",),
    ),
    "96-toast": Case((click("Save"),), ("Saved as A-4711",)),
    "97-double": Case((lambda tab: tab.step(DoubleClick(tab.at("Report.doc"))),), ("OPENED",)),
    "98-contextmenu": Case((do(RightClick(place(60, 60))), click("Rename")), ("RENAMED",)),
    "99-slow-again": Case(
        (write("search", "one"), write("search", "two")), ("RESULT for two",), ("still_loading",), either=True
    ),
    "100-sight-variants": Case(
        text=("V9 readable",), absent=tuple(f"V{number} secret" for number in range(1, 9))
    ),
    "101-sight-missing": Case(text=MISSING),
    "28-paste-only": Case(
        (
            lambda tab: tab.step(LeftClick(tab.at_role("textbox"))),
            do(Press(("Control", "a"))),
            do(Press(("Control", "c"))),
            click("paste here"),
            do(Press(("Control", "v"))),
        ),
        ("pasted CODE-9",),
    ),
}


@pytest.mark.parametrize("name", CASES)
async def test_a_page_is_seen_and_used_as_by_a_person(site: Site, open_tab: Open, name: str) -> None:
    case = CASES[name]
    serve(site)
    tab = await open_tab(case.mode)
    notices = []
    first: Do = lambda tab: tab.goto(site.url(f"/{name}/{case.page}"))  # noqa: E731
    tab.base = site.url("")
    for step in (first, *case.steps):
        await step(tab)
        notices += [": ".join(notice) for notice in tab.notices]
    assert tab.last is not None
    seen = tab.last.observation
    shown = " ".join([seen.text or "", *seen.fields, *(element.name for element in seen.elements or ())])
    told = " | ".join(notices)
    has_text = all(text in shown for text in case.text)
    has_notice = all(text in told for text in case.notice)
    assert (has_text or has_notice) if case.either else (has_text and has_notice), (shown[:800], told)
    assert not [text for text in case.absent if text in shown], shown[:800]
    names = {element.name for element in seen.elements or ()}
    assert set(case.marked) <= names, names
    assert not set(case.unmarked) & names, names
