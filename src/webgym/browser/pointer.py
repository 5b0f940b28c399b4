"""Mouse input: clicks, drags, the wheel."""

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
from webgym.browser.settle import settle
from webgym.core.action import Modifier, Side
from webgym.core.errors import ActionFailed

Point: TypeAlias = tuple[float, float]
Button: TypeAlias = Literal["left", "right"]

_BUTTON_BITS: dict[Button, int] = {"left": 1, "right": 2}
_SCROLLED = 0.75
"""How far a scroll turns the view, as a share of what is visible."""
_DRAG_STEPS = 8
"""Number of intermediate points of a drag, over all of its segments. Pages handle the start, the end and the
elements that the mouse passes."""
_MOST_TURNS = 40
"""Most wheel events of one scroll, for pages that move a few lines at each."""
_DRAG_START = 6.0
"""Distance of the first point of a drag, CSS pixels: above the threshold of drag-and-drop libraries."""


class Wheel(msgspec.Struct, frozen=True):
    """Where to turn the wheel, and the visible size of what it scrolls, CSS pixels."""

    point: Point
    extent: float


class Turned(msgspec.Struct, frozen=True):
    """How far a script of the page scrolled, and the size of its box, CSS pixels.

    Attributes:
        taken: whether the page prevented that anything is scrolled, although it has more in that direction.
    """

    by: float
    extent: float
    taken: bool = False


class _List(msgspec.Struct, frozen=True):
    """The wheel over an open list; ``None`` if none is open."""

    wheel: Wheel | None = None


class _DragIntercepted(CdpMessage, frozen=True):
    data: dict[str, Any]


async def mouse(page: Page, kind: str, point: Point, **more: Any) -> None:
    """Send one mouse event of the protocol, and wait until the page has handled it."""
    params = {"type": kind, "x": point[0], "y": point[1], **more}
    await page.session.call(
        "Input.dispatchMouseEvent", params, reply=EmptyReply, seconds=page.config.execute_seconds
    )


async def send_keys(page: Page, events: Iterable[dict[str, Any]]) -> None:
    """Send key events of the protocol in order, and wait until the page has handled the last."""
    seconds = page.config.execute_seconds
    await asyncio.gather(  # sent at once, handled in order
        *(page.session.do("Input.dispatchKeyEvent", event, seconds=seconds) for event in events)
    )


async def press(page: Page, names: Sequence[str]) -> None:
    """Press these keys together.

    Raises:
        ActionFailed: a name is not that of a key.
    """
    try:
        keys = keys_of(names)
    except ValueError as error:
        raise ActionFailed(str(error)) from None
    await send_keys(page, chord(keys))


@asynccontextmanager
async def holding(page: Page, modifiers: Sequence[Modifier]) -> AsyncIterator[int]:
    """Hold these keys down during the block. Yields the protocol's bit mask of them."""
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
    """Move the mouse to a point and press and release a button, ``count`` times.

    As with a real mouse, the page can react to every event before the next: to the move before the press, and
    to the press before the release. If the element moves away when the mouse arrives, the mouse follows once.
    """
    moved = await _send_and_react(page, "mouseMoved", point, modifiers=modifiers)
    if moved != point:
        if not _is_inside(page, moved):
            raise ActionFailed("what lay at this place has moved out of view; nothing was clicked")
        point = moved
        await _send_and_react(page, "mouseMoved", point, modifiers=modifiers)
    for number in range(1, count + 1):
        pressed = {"button": button, "clickCount": number, "modifiers": modifiers}
        await _send_and_react(page, "mousePressed", point, **pressed, buttons=_BUTTON_BITS[button])
        await mouse(page, "mouseReleased", point, **pressed)


async def _send_and_react(page: Page, kind: str, point: Point, **more: Any) -> Point:
    """Send one mouse event, and give the page time for a frame if it reacts. Returns the new position of the
    element that was at the point."""
    is_blind = bool(page.worlds.entered)  # reactions in frames of other origins are not seen
    try:
        if page.expected != point:
            await page.run("expect", *point, reply=bool)
        page.expected = None
        await mouse(page, kind, point, **more)
        is_move = kind == "mouseMoved"
        across, down = await page.run("reacted", *point, is_blind, is_move, reply=tuple[float, float])
    except DocumentGone:
        return point
    if is_move and not (across or down):
        page.expected = point
    return point[0] + across, point[1] + down


def _is_inside(page: Page, point: Point) -> bool:
    return all(0 <= value < side for value, side in zip(point, page.options.viewport, strict=True))


# --- drags --------------------------------------------------------------------------------------------


async def hold(page: Page, point: Point, seconds: float) -> None:
    """Press the left button at a point, and release it after a while."""
    await _send_and_react(page, "mouseMoved", point)
    await _send_and_react(page, "mousePressed", point, button="left", buttons=1, clickCount=1)
    await page.rest(seconds)
    await mouse(page, "mouseReleased", point, button="left", clickCount=1)


async def drag(page: Page, points: Sequence[Point], seconds: float = 0.0) -> None:
    """Press the left button at the first point, move through the others, and release it at the last.

    Before it moves, the button is held down for ``seconds``.

    For HTML drag and drop, Chromium's drag is intercepted, and the drag events are dispatched instead of
    mouse events.
    """
    with contextlib.ExitStack() as stack:
        intercepted: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

        def on_intercepted(event: _DragIntercepted) -> None:
            if not intercepted.done():
                intercepted.set_result(event.data)

        stack.callback(page.session.on("Input.dragIntercepted", _DragIntercepted, on_intercepted))
        stack.callback(page.session.send, "Input.setInterceptDrags", {"enabled": False})
        page.session.send("Input.setInterceptDrags", {"enabled": True})
        await mouse(page, "mouseMoved", points[0])
        await mouse(page, "mousePressed", points[0], button="left", buttons=1, clickCount=1)
        try:
            await page.rest(seconds)
            await _move_and_drop(page, _path(points), intercepted)
        finally:
            await mouse(page, "mouseReleased", points[-1], button="left", clickCount=1)


async def _move_and_drop(
    page: Page, path: Sequence[Point], intercepted: asyncio.Future[dict[str, Any]]
) -> None:
    """Move along a path with the button down; if Chromium intercepts a drag, drop its data at the end.

    If the page began a drag that is not intercepted, the mouse moves go on as in any other drag.
    """
    data: dict[str, Any] | None = None
    may_intercept = True
    for point in path:
        if data is not None:
            await _drag_event(page, "dragOver", point, data)
            continue
        await mouse(page, "mouseMoved", point, button="left", buttons=1)
        if may_intercept and await _any_frame(page, "hasDragBegun"):
            done, _ = await asyncio.wait({intercepted}, timeout=page.config.execute_seconds)
            may_intercept = bool(done)
            if done:
                data = intercepted.result()
                await _drag_event(page, "dragEnter", point, data)
    if data is not None:
        await _drag_event(page, "drop", path[-1], data)


def _path(points: Sequence[Point]) -> list[Point]:
    """The path of a drag through all of its points, with intermediate ones. The last point occurs twice,
    because pages react to it most."""
    segments = list(itertools.pairwise(points))
    lengths = [math.dist(*segment) for segment in segments]
    total = max(1.0, sum(lengths))
    first = _between(*segments[0], min(1.0, _DRAG_START / max(1.0, lengths[0])))
    segments[0] = first, segments[0][1]
    path = [first]
    for (start, end), length in zip(segments, lengths, strict=True):
        steps = max(1, math.ceil(_DRAG_STEPS * length / total))
        path += [_between(start, end, step / steps) for step in range(1, steps + 1)]
    return [*path, points[-1]]


def _between(start: Point, end: Point, share: float) -> Point:
    return start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share


async def drop_files(page: Page, point: Point, paths: Sequence[str]) -> bool:
    """Drag files to a point, and drop them there. Returns whether the page takes any there."""
    data = {"items": [], "files": paths, "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver"):
        await _drag_event(page, kind, point, data)
    is_taken = await _any_frame(page, "takesDrop")
    await _drag_event(page, "drop" if is_taken else "dragCancel", point, data)
    return is_taken


async def _any_frame(page: Page, function: str) -> bool:
    """Whether this is true of the main frame or one below it."""
    for frame in (None, *page.worlds.entered):
        with contextlib.suppress(DocumentGone):
            if await page.run(function, reply=bool, frame=frame):
                return True
    return False


async def _drag_event(page: Page, kind: str, point: Point, data: dict[str, Any]) -> None:
    params = {"type": kind, "x": point[0], "y": point[1], "data": data}
    await page.session.do("Input.dispatchDragEvent", params, seconds=page.config.execute_seconds)


# --- the wheel ----------------------------------------------------------------------------------------


async def scroll(page: Page, side: Side, point: Point | None = None) -> None:
    """Turn the wheel over a point, or over the largest scrollable part of the page, by ``_SCROLLED`` of
    its visible size.

    Elements that scroll by a script, such as editors and tables with thousands of lines, may move a few lines
    for each wheel event: it is repeated until the distance is reached. Without a point, the page is scrolled
    where what lies there uses the wheel for something else, such as a map that zooms.
    """
    sign = 1 if side in ("down", "right") else -1
    wheel = await wheel_over(page, side, point)
    distance = wheel.extent * _SCROLLED * sign
    is_horizontal = side in ("left", "right")
    deltas = {"deltaX": distance, "deltaY": 0} if is_horizontal else {"deltaX": 0, "deltaY": distance}
    done = 0.0
    with contextlib.suppress(DocumentGone):
        for _ in range(_MOST_TURNS):
            turned = await turn(page, side, wheel.point, **deltas)
            done += turned.by
            if not turned.by or done + turned.by / 2 >= turned.extent * _SCROLLED:
                break
        if point is None and not done and turned.taken:
            await settle(page)  # it may scroll by an animation of its own
            await page.run("scrollPage", distance, reply=bool)


async def turn(page: Page, side: Side, point: Point, **deltas: float) -> Turned:
    """Send one wheel event. What the browser itself scrolls moves later, which settling waits for."""
    await page.run("expectTurn", side, point, reply=bool)
    page.expected = point
    await _send_and_react(page, "mouseWheel", point, **deltas)
    return await page.run("turned", reply=Turned)


async def wheel_over(page: Page, side: Side, point: Point | None = None) -> Wheel:
    """Where to turn the wheel: over an open list in a frame of another origin, which the main frame cannot
    see, else where the main frame says."""
    width, height = page.options.viewport
    try:
        for frame in page.worlds.entered if point is None else ():
            over = (await page.run("listWheel", reply=_List, frame=frame)).wheel
            if over is not None:
                return Wheel(await page.worlds.to_viewport(frame, over.point), over.extent)
        return await page.run("wheel", side, point, reply=Wheel)
    except DocumentGone:
        return Wheel(point or (width / 2, height / 2), height if side in ("up", "down") else width)
