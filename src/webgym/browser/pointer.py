"""The mouse: clicks of every kind, drags, the wheel."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
from collections.abc import AsyncIterator, Iterable, Sequence
from contextlib import asynccontextmanager
from typing import Any, Literal, TypeAlias

import msgspec

from webgym.browser.cdp_messages import CdpMessage, EmptyReply
from webgym.browser.chords import chord, keys_of, modifier_bits
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import Page
from webgym.core.action import Modifier, Side
from webgym.core.errors import ActionFailed

Point: TypeAlias = tuple[float, float]
Button: TypeAlias = Literal["left", "right"]

_BUTTON_BITS: dict[Button, int] = {"left": 1, "right": 2}
_DRAG_STEPS = 8
"""Places on the way of a drag, shared among its parts. Pages look at where it comes from and goes to, and at
what it passes."""
_MOST_TURNS = 40
"""Of the wheel, over what moves a little at each."""
_DRAG_START = 6.0
"""CSS pixels of the first of them: more than what libraries take for a trembling hand."""


class Wheel(msgspec.Struct, frozen=True):
    """Where the wheel turns, and the length of which it scrolls a part, CSS pixels."""

    point: Point
    extent: float


class _Turned(msgspec.Struct, frozen=True):
    """How far a script of the page scrolled, and the length of its box, CSS pixels."""

    by: float
    extent: float


class _List(msgspec.Struct, frozen=True):
    """The wheel over an open list, if there is one."""

    wheel: Wheel | None = None


class _DragIntercepted(CdpMessage, frozen=True):
    data: dict[str, Any]


async def mouse(page: Page, kind: str, point: Point, **more: Any) -> None:
    """One mouse event of the protocol, until the page has taken it."""
    params = {"type": kind, "x": point[0], "y": point[1], **more}
    await page.session.call(
        "Input.dispatchMouseEvent", params, reply=EmptyReply, seconds=page.config.execute_seconds
    )


async def send_keys(page: Page, events: Iterable[dict[str, Any]]) -> None:
    """Key events of the protocol, in their order, until the page has taken the last."""
    seconds = page.config.execute_seconds
    await asyncio.gather(  # sent at once, taken in order
        *(page.session.do("Input.dispatchKeyEvent", event, seconds=seconds) for event in events)
    )


async def press(page: Page, names: Sequence[str]) -> None:
    """Press these keys together.

    Raises:
        ActionFailed: a name that no key has.
    """
    try:
        keys = keys_of(names)
    except ValueError as error:
        raise ActionFailed(str(error)) from None
    await send_keys(page, chord(keys))


@asynccontextmanager
async def held(page: Page, modifiers: Sequence[Modifier]) -> AsyncIterator[int]:
    """Hold these keys for the block. Gives the protocol's bits of them."""
    events = chord(keys_of(modifiers))
    half = len(events) // 2
    await send_keys(page, events[:half])
    try:
        yield modifier_bits(modifiers)
    finally:
        await send_keys(page, events[half:])


async def click(
    page: Page, point: Point, *, button: Button = "left", count: int = 1, modifiers: int = 0
) -> None:
    """Move the mouse here and press and release a button, ``count`` times.

    As with a hand, the page sees the mouse come before the button goes down, and that before it goes up: what
    it does about the one has happened when the other comes. Where the mouse drives away what lay here, it
    follows once.
    """
    moved = await _act(page, "mouseMoved", point, modifiers=modifiers)
    if moved != point and _is_inside(page, moved):
        point = moved
        await _act(page, "mouseMoved", point, modifiers=modifiers)
    for number in range(1, count + 1):
        pressed = {"button": button, "clickCount": number, "modifiers": modifiers}
        await _act(page, "mousePressed", point, **pressed, buttons=_BUTTON_BITS[button])
        await mouse(page, "mouseReleased", point, **pressed)


async def _act(page: Page, kind: str, point: Point, **more: Any) -> Point:
    """One mouse event, and a frame for the page if it does anything about it. Gives where now lies what lay
    at the point."""
    is_blind = bool(page.worlds.entered)  # frames of other origins are not looked into for this
    try:
        await page.run("expect", *point, reply=bool)
        await mouse(page, kind, point, **more)
        across, down = await page.run("reacted", *point, is_blind, reply=tuple[float, float])
    except DocumentGone:
        return point
    return point[0] + across, point[1] + down


def _is_inside(page: Page, point: Point) -> bool:
    return all(0 <= value < side for value, side in zip(point, page.options.viewport, strict=True))


# --- drags --------------------------------------------------------------------------------------------


async def drag(page: Page, points: Sequence[Point]) -> None:
    """Press the left button at the first point, move through the others, and release it at the last.

    What the page makes draggable by HTML is dragged as the system would: Chromium hands the drag over, and
    is told where it passes and is dropped.
    """
    with contextlib.ExitStack() as stack:
        taken: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

        def on_intercepted(event: _DragIntercepted) -> None:
            if not taken.done():
                taken.set_result(event.data)

        stack.callback(page.session.on("Input.dragIntercepted", _DragIntercepted, on_intercepted))
        stack.callback(page.session.send, "Input.setInterceptDrags", {"enabled": False})
        page.session.send("Input.setInterceptDrags", {"enabled": True})
        await mouse(page, "mouseMoved", points[0])
        await mouse(page, "mousePressed", points[0], button="left", buttons=1, clickCount=1)
        try:
            await _carry(page, _way(points), taken)
        finally:
            await mouse(page, "mouseReleased", points[-1], button="left", clickCount=1)


async def _carry(page: Page, way: Sequence[Point], taken: asyncio.Future[dict[str, Any]]) -> None:
    """Pass these places with the button down, and drop at the last what Chromium hands over on the way.

    A drag that the page began and Chromium does not hand over goes on as one without.
    """
    data: dict[str, Any] | None = None
    is_asked = True
    for place in way:
        if data is not None:
            await _drag_event(page, "dragOver", place, data)
            continue
        await mouse(page, "mouseMoved", place, button="left", buttons=1)
        if is_asked and await _has_drag_begun(page):
            done, _ = await asyncio.wait({taken}, timeout=page.config.execute_seconds)
            is_asked = bool(done)
            if done:
                data = taken.result()
                await _drag_event(page, "dragEnter", place, data)
    if data is not None:
        await _drag_event(page, "drop", way[-1], data)


def _way(points: Sequence[Point]) -> list[Point]:
    """The places that a drag passes, each of its points among them; its end twice, where most pages look."""
    legs = list(itertools.pairwise(points))
    lengths = [math.dist(*leg) for leg in legs]
    whole = max(1.0, sum(lengths))
    first = _between(*legs[0], min(1.0, _DRAG_START / max(1.0, lengths[0])))
    legs[0] = first, legs[0][1]
    way = [first]
    for (start, end), length in zip(legs, lengths, strict=True):
        steps = max(1, math.ceil(_DRAG_STEPS * length / whole))
        way += [_between(start, end, step / steps) for step in range(1, steps + 1)]
    return [*way, points[-1]]


def _between(start: Point, end: Point, share: float) -> Point:
    return start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share


async def _has_drag_begun(page: Page) -> bool:
    """Whether a drag of the system began, in the tab's own frame or one below it."""
    for frame in (None, *page.worlds.entered):
        with contextlib.suppress(DocumentGone):
            if await page.run("hasDragBegun", reply=bool, frame=frame):
                return True
    return False


async def _drag_event(page: Page, kind: str, point: Point, data: dict[str, Any]) -> None:
    params = {"type": kind, "x": point[0], "y": point[1], "data": data}
    await page.session.do("Input.dispatchDragEvent", params, seconds=page.config.execute_seconds)


# --- the wheel ----------------------------------------------------------------------------------------


async def scroll(page: Page, side: Side, point: Point | None = None) -> None:
    """Turn the wheel by a share of what scrolls here, or where it does the most.

    What scrolls by a script, as editors and tables with thousands of lines do, may go a few lines for each
    turn: it is turned again until it has gone as far.
    """
    sign = 1 if side in ("down", "right") else -1
    wheel = await wheel_over(page, side, point)
    distance = wheel.extent * page.config.scroll_fraction * sign
    way = (
        {"deltaX": distance, "deltaY": 0} if side in ("left", "right") else {"deltaX": 0, "deltaY": distance}
    )
    done = 0.0
    with contextlib.suppress(DocumentGone):
        for _ in range(_MOST_TURNS):
            await page.run("expectTurn", side, wheel.point, reply=bool)
            await _act(page, "mouseWheel", wheel.point, **way)
            turned = await page.run("turned", reply=_Turned)
            done += turned.by
            if not turned.by or done + turned.by / 2 >= turned.extent * page.config.scroll_fraction:
                break


async def wheel_over(page: Page, side: Side, point: Point | None = None) -> Wheel:
    """Where the wheel turns. An open list in a frame of another origin goes first: the tab's own frame does
    not know of it."""
    width, height = page.options.viewport
    try:
        for frame in page.worlds.entered if point is None else ():
            over = (await page.run("listWheel", reply=_List, frame=frame)).wheel
            if over is not None:
                return Wheel(await page.worlds.outward(frame, over.point), over.extent)
        return await page.run("wheel", side, point, reply=Wheel)
    except DocumentGone:
        return Wheel(point or (width / 2, height / 2), height if side in ("up", "down") else width)
