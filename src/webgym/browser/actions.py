"""From an action to mouse, keyboard and history (paper appendix C)."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any, Literal

import msgspec

from webgym.browser.chords import chord, keys_of
from webgym.browser.keyboard import BACKSPACE, ENTER, PROCESS, Key, key_of, strokes
from webgym.browser.page import BLANK, Page, Returned
from webgym.browser.settle import settle
from webgym.browser.wire import History, HistoryEntry, Nothing
from webgym.browser.worlds import DocumentGone
from webgym.core.action import (
    GRID,
    MAX_WAIT_SECONDS,
    BrowserAction,
    GoBack,
    LeftClick,
    Navigate,
    Scroll,
    Target,
    Type,
    Wait,
)
from webgym.core.errors import ActionFailed, NavigationFailed

Point = tuple[float, float]

_SAID_LENGTH = 300
_FRAME_DEPTH = 8
"""Frames in frames that the focus is followed into."""
_SCHEMES = ("http://", "https://")
_OTHER_SCHEMES = frozenset(
    {"about", "blob", "chrome", "data", "file", "ftp", "javascript", "mailto", "view-source"}
)


class _Field(msgspec.Struct, frozen=True):
    """What has the focus, readied for typing.

    Attributes:
        kind: ``text`` is a field whose content is selected, ``keys`` something else that listens to keys,
            ``frame`` a frame of another origin that has the focus; ``set`` and ``chosen`` are done.
        filled: whether there is something to be cleared.
        frame: which one; ``None`` if it was not entered yet, empty if it cannot be.
        wondered: whether the focus may be in a closed root that was not entered yet.
        why: what was refused.
    """

    kind: Literal["text", "keys", "frame", "set", "chosen", "refused", "none"]
    filled: bool = False
    frame: str | None = None
    wondered: bool = False
    why: str = ""


class _Wheel(msgspec.Struct, frozen=True):
    """Where the wheel turns, and the height of which it scrolls a part, CSS pixels."""

    point: Point
    height: float


class _List(msgspec.Struct, frozen=True):
    """The wheel over an open list, if there is one."""

    wheel: _Wheel | None = None


async def perform(page: Page, action: BrowserAction) -> None:
    """Carry an action out, without waiting for what it sets off.

    Raises:
        ActionFailed, NavigationFailed: the page is as it is, the agent is to be told.
        BrowserTimeout: the page did not take an input event in time.
        TargetGone, BrowserCrashed: the page or the browser is gone.
    """
    match action:
        case LeftClick(target=target):
            await click(page, point_of(page, target))
        case Type(target=target, text=text):
            await type_at(page, point_of(page, target), text)
        case Scroll(direction=direction):
            await _scroll(page, direction)
        case Wait(time=seconds):
            await page.rest(max(0.0, min(seconds, MAX_WAIT_SECONDS)))
        case GoBack():
            await _go_back(page)
        case Navigate(url=url):
            await _navigate(page, url)


def point_of(page: Page, target: Target) -> Point:
    """Where a target lies in the viewport, px.

    Raises:
        ActionFailed: the last observation showed no such element.
    """
    if target.element is not None:
        point = page.points.get(target.element)
        if point is None:
            raise ActionFailed(f"there is no element {target.element} in the last observation")
        return point
    assert target.coordinate is not None
    width, height = page.options.viewport
    x, y = target.coordinate
    return min(x / GRID * width, width - 1), min(y / GRID * height, height - 1)


# --- mouse --------------------------------------------------------------------------------------------


async def mouse(page: Page, kind: str, point: Point, **more: Any) -> None:
    """One mouse event of the protocol, until the page has taken it."""
    params = {"type": kind, "x": point[0], "y": point[1], **more}
    await page.session.call(
        "Input.dispatchMouseEvent", params, reply=Nothing, seconds=page.config.execute_seconds
    )


async def click(page: Page, point: Point) -> None:
    """Move the mouse here and press and release its left button."""
    button = {"button": "left", "clickCount": 1}
    await asyncio.gather(  # sent at once, taken in order
        mouse(page, "mouseMoved", point),
        mouse(page, "mousePressed", point, **button, buttons=1),
        mouse(page, "mouseReleased", point, **button),
    )


async def _scroll(page: Page, direction: Literal["up", "down"]) -> None:
    sign = 1 if direction == "down" else -1
    wheel = await wheel_over(page, sign)
    distance = wheel.height * page.config.scroll_fraction * sign
    await mouse(page, "mouseWheel", wheel.point, deltaX=0, deltaY=distance)


async def wheel_over(page: Page, sign: int) -> _Wheel:
    """Where the wheel turns. An open list in a frame of another origin goes first: the tab's own frame does
    not know of it."""
    try:
        for frame in page.worlds.entered:
            over = (await page.run("listWheel", reply=_List, frame=frame)).wheel
            if over is not None:
                return _Wheel(await page.worlds.outward(frame, over.point), over.height)
        return await page.run("wheel", sign, reply=_Wheel)
    except DocumentGone:
        width, height = page.options.viewport
        return _Wheel((width / 2, height / 2), height)


# --- keyboard -----------------------------------------------------------------------------------------


async def _press(page: Page, key: Key) -> None:
    kinds: tuple[Literal["down", "up"], ...] = ("down", "up")
    seconds = page.config.execute_seconds
    await asyncio.gather(  # sent at once, taken in order
        *(page.session.do("Input.dispatchKeyEvent", key.event(kind), seconds=seconds) for kind in kinds)
    )


async def press(page: Page, *names: str) -> None:
    """Press these keys together.

    Raises:
        ValueError: a name that no key has.
    """
    seconds = page.config.execute_seconds
    events = chord(keys_of(names))
    await asyncio.gather(  # sent at once, taken in order
        *(page.session.do("Input.dispatchKeyEvent", event, seconds=seconds) for event in events)
    )


async def _insert(page: Page, text: str) -> None:
    await page.session.do("Input.insertText", {"text": text}, seconds=page.config.execute_seconds)


async def _compose(page: Page, text: str) -> None:
    """As an input method does: the page sees a composition begin, change and end."""
    seconds = page.config.execute_seconds
    end = len(text.encode("utf-16-le")) // 2
    await asyncio.gather(
        page.session.do("Input.dispatchKeyEvent", PROCESS.event("down"), seconds=seconds),
        page.session.do(
            "Input.imeSetComposition",
            {"text": text, "selectionStart": end, "selectionEnd": end},
            seconds=seconds,
        ),
        _insert(page, text),
        page.session.do("Input.dispatchKeyEvent", PROCESS.event("up"), seconds=seconds),
    )


async def _write(page: Page, text: str) -> None:
    for way, run in strokes(text, page.config.typed_keys):
        match way:
            case "keys":
                await asyncio.gather(*(_press(page, key_of(character)) for character in run))
            case "compose":
                await _compose(page, run)
            case "insert":
                await _insert(page, run)


async def _prepare(page: Page, text: str, enter: bool) -> _Field:
    """Ready what has the focus, in whichever frame it is."""
    frame: str | None = None
    for _ in range(_FRAME_DEPTH):
        try:
            field = await page.run("prepareTyping", text, enter, reply=_Field, frame=frame)
            if field.kind != "frame":
                return field
            if field.frame is None:
                await page.worlds.explore(again=True)
            elif field.frame:
                frame = field.frame
            else:
                break
        except DocumentGone:
            break
    return _Field("none")


async def _prepare_late(page: Page, text: str, enter: bool, wondered: bool) -> _Field:
    """The click may open a field that takes a moment, or have gone into a closed root."""
    await settle(page)
    if wondered:
        with contextlib.suppress(DocumentGone):
            await page.worlds.explore()
    return await _prepare(page, text, enter)


async def type_at(
    page: Page, point: Point, text: str, *, replace: bool = True, enter: bool = True, blindly: bool = False
) -> None:
    """Click here and type into what then has the focus.

    Args:
        replace: what is in the field; else the text goes behind it.
        enter: press it afterwards.
        blindly: press the keys even where nothing is known to take them.

    Raises:
        ActionFailed: nothing takes this text.
    """
    config = page.config
    await click(page, point)
    field = await _prepare(page, text, enter)
    if field.kind in ("none", "keys"):
        field = await _prepare_late(page, text, enter, field.wondered)
    match field.kind:
        case "none" | "frame" if not blindly:
            raise ActionFailed("there is no text field at this place; nothing was typed")
        case "refused":
            raise ActionFailed(f"nothing was typed: {field.why}")
        case "chosen":
            return
        case "keys" | "none" | "frame":
            if len(text) > config.typed_keys:
                raise ActionFailed(f"this is no text field; it takes {config.typed_keys} key presses at most")
            await _write(page, text)
        case "text" if text:
            if not replace:
                await press(page, "Control", "End")  # the selection gives way to a caret behind it
            await _write(page, text)
        case "text" if field.filled and replace:
            await _press(page, BACKSPACE)
    if enter:
        await _press(page, ENTER)


# --- history and addresses ----------------------------------------------------------------------------


async def _go_back(page: Page) -> None:
    history = await _history(page)
    index = (history.current_index if page.returned is None else page.returned.index) - 1
    page.returned = None
    if index < 0 or history.entries[index].url == BLANK:
        raise ActionFailed("there is no earlier page to go back to")
    left = page.loader
    await _return_to(page, history.entries[index])
    page.returned = Returned(index, left)


async def is_led_on(page: Page) -> bool:
    """Whether the page that this action went back to has led on by itself, as a redirect by script does.

    Then there is no way back but past it; going back once more in the same action takes that way.
    """
    returned = page.returned
    if returned is None or page.loader == returned.left:  # a document that changes its own history may
        return False
    return (await _history(page)).current_index > returned.index


async def _history(page: Page) -> History:
    return await page.session.call(
        "Page.getNavigationHistory", reply=History, seconds=page.config.execute_seconds
    )


async def _return_to(page: Page, entry: HistoryEntry) -> None:
    seconds = page.config.execute_seconds
    page.traffic.started.clear()
    await page.session.do("Page.navigateToHistoryEntry", {"entryId": entry.id}, seconds=seconds)
    try:
        async with asyncio.timeout(page.config.navigate_seconds):
            await page.traffic.started.wait()
    except TimeoutError:
        raise NavigationFailed(f"{entry.url[:_SAID_LENGTH]} did not open") from None


async def _navigate(page: Page, url: str) -> None:
    wanted = url.strip()
    if len(wanted) > page.config.url_length:
        raise NavigationFailed(f"an address of {len(wanted)} characters was not opened")
    if wanted.lower().startswith(_SCHEMES):
        await page.navigate(wanted)
    elif not wanted or "://" in wanted or wanted.split(":")[0].lower() in _OTHER_SCHEMES:
        raise NavigationFailed(f'"{wanted[:_SAID_LENGTH]}" was not opened: only http and https addresses are')
    else:  # as an address bar does: secure first
        try:
            await page.navigate(f"https://{wanted}")
        except NavigationFailed:
            await page.navigate(f"http://{wanted}")
