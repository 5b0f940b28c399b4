"""From an action to mouse, keyboard and history (paper appendix C)."""

from __future__ import annotations

import asyncio
from typing import Any, Literal

import msgspec

from webgym.browser.page import DocumentGone, Page
from webgym.browser.settle import settle
from webgym.browser.wire import History, Nothing
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
_SCHEMES = ("http://", "https://")
_OTHER_SCHEMES = frozenset(
    {"about", "blob", "chrome", "data", "file", "ftp", "javascript", "mailto", "view-source"}
)
_KEYS = {"Enter": (13, "\r"), "Backspace": (8, "")}


class _Field(msgspec.Struct, frozen=True):
    """What has the focus, readied for typing."""

    kind: Literal["text", "set", "chosen", "refused", "none"]
    filled: bool = False
    why: str = ""


class _ScrollPoint(msgspec.Struct, frozen=True):
    """The middle of an open list, if there is one: the wheel turns over that."""

    point: Point | None = None


async def perform(page: Page, action: BrowserAction) -> None:
    """Carry an action out, without waiting for what it sets off.

    Raises:
        ActionFailed, NavigationFailed: the page is as it is, the agent is to be told.
        BrowserTimeout: the page did not take an input event in time.
        TargetGone, BrowserCrashed: the page or the browser is gone.
    """
    match action:
        case LeftClick(target=target):
            await _click(page, _point(page, target))
        case Type(target=target, text=text):
            await _type(page, _point(page, target), text)
        case Scroll(direction=direction):
            await _scroll(page, direction)
        case Wait(time=seconds):
            await asyncio.sleep(max(0.0, min(seconds, MAX_WAIT_SECONDS)))
        case GoBack():
            await _go_back(page)
        case Navigate(url=url):
            await _navigate(page, url)


def _point(page: Page, target: Target) -> Point:
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


async def _mouse(page: Page, kind: str, point: Point, **more: Any) -> None:
    params = {"type": kind, "x": point[0], "y": point[1], **more}
    await page.session.call(
        "Input.dispatchMouseEvent", params, reply=Nothing, seconds=page.config.execute_seconds
    )


async def _click(page: Page, point: Point) -> None:
    button = {"button": "left", "clickCount": 1}
    await asyncio.gather(  # sent at once, taken in order
        _mouse(page, "mouseMoved", point),
        _mouse(page, "mousePressed", point, **button, buttons=1),
        _mouse(page, "mouseReleased", point, **button),
    )


async def _scroll(page: Page, direction: Literal["up", "down"]) -> None:
    width, height = page.options.viewport
    over = await page.run("scrollPoint", reply=_ScrollPoint)
    point = over.point or (width / 2, height / 2)
    distance = height * page.config.scroll_fraction * (1 if direction == "down" else -1)
    await _mouse(page, "mouseWheel", point, deltaX=0, deltaY=distance)


# --- keyboard -----------------------------------------------------------------------------------------


async def _key(page: Page, kind: str, **more: Any) -> None:
    await page.session.call(
        "Input.dispatchKeyEvent", {"type": kind, **more}, reply=Nothing, seconds=page.config.execute_seconds
    )


async def _press(page: Page, key: str) -> None:
    code, text = _KEYS[key]
    named = {"key": key, "code": key, "windowsVirtualKeyCode": code}
    await _key(page, "keyDown" if text else "rawKeyDown", **named, **({"text": text} if text else {}))
    await _key(page, "keyUp", **named)


async def _insert(page: Page, text: str) -> None:
    """Insert text as an input method does, but for a last ASCII character, which is a key press: a page
    that listens to keys alone hears of the change."""
    last = text[-1] if text[-1].isascii() and text[-1].isprintable() else ""
    head = text[: len(text) - len(last)]
    if head:
        await page.session.call(
            "Input.insertText", {"text": head}, reply=Nothing, seconds=page.config.execute_seconds
        )
    if last:
        await _key(page, "keyDown", key=last, text=last)
        await _key(page, "keyUp", key=last)


async def _prepare(page: Page, text: str) -> _Field:
    try:
        return await page.run("prepareTyping", text, reply=_Field)
    except DocumentGone:
        return _Field("none")


async def _type(page: Page, point: Point, text: str) -> None:
    await _click(page, point)
    field = await _prepare(page, text)
    if field.kind == "none":  # the click may open a field that takes a moment
        await settle(page)
        field = await _prepare(page, text)
    if field.kind == "none":
        raise ActionFailed("there is no text field at this place; nothing was typed")
    if field.kind == "refused":
        raise ActionFailed(f"nothing was typed: {field.why}")
    if field.kind == "chosen":
        return
    if field.kind == "text":
        if text:
            await _insert(page, text)
        elif field.filled:
            await _press(page, "Backspace")
    await _press(page, "Enter")


# --- history and addresses ----------------------------------------------------------------------------


async def _go_back(page: Page) -> None:
    seconds = page.config.execute_seconds
    history = await page.session.call("Page.getNavigationHistory", reply=History, seconds=seconds)
    before = history.entries[: history.current_index]
    if not before or (len(before) == 1 and before[0].url == "about:blank"):
        raise ActionFailed("there is no earlier page to go back to")
    page.traffic.started.clear()
    await page.session.do("Page.navigateToHistoryEntry", {"entryId": before[-1].id}, seconds=seconds)
    try:
        async with asyncio.timeout(page.config.navigate_seconds):
            await page.traffic.started.wait()
    except TimeoutError:
        raise NavigationFailed(f"{before[-1].url[:_SAID_LENGTH]} did not open") from None


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
