"""The mouse: clicks of every kind, drags, the wheel."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable, Sequence
from contextlib import asynccontextmanager
from typing import Any, Literal, TypeAlias

import msgspec

from webgym.browser.chords import chord, keys_of, modifier_bits
from webgym.browser.page import Page
from webgym.browser.wire import Nothing, Wire
from webgym.browser.worlds import DocumentGone
from webgym.core.action import Modifier, Side
from webgym.core.errors import ActionFailed

Point: TypeAlias = tuple[float, float]
Button: TypeAlias = Literal["left", "right"]

_BUTTON_BITS: dict[Button, int] = {"left": 1, "right": 2}
_DRAG_STEPS = 8
"""Places on the way of a drag. Pages look at where it comes from and goes to, and at what it passes."""
_DRAG_START = 6.0
"""CSS pixels of the first of them: more than what libraries take for a trembling hand."""


class Wheel(msgspec.Struct, frozen=True):
    """Where the wheel turns, and the length of which it scrolls a part, CSS pixels."""

    point: Point
    extent: float


class _List(msgspec.Struct, frozen=True):
    """The wheel over an open list, if there is one."""

    wheel: Wheel | None = None


class _DragIntercepted(Wire, frozen=True):
    data: dict[str, Any]


async def mouse(page: Page, kind: str, point: Point, **more: Any) -> None:
    """One mouse event of the protocol, until the page has taken it."""
    params = {"type": kind, "x": point[0], "y": point[1], **more}
    await page.session.call(
        "Input.dispatchMouseEvent", params, reply=Nothing, seconds=page.config.execute_seconds
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
    """Move the mouse here and press and release a button, ``count`` times."""
    await mouse(page, "mouseMoved", point, modifiers=modifiers)
    for number in range(1, count + 1):
        pressed = {"button": button, "clickCount": number, "modifiers": modifiers}
        await mouse(page, "mousePressed", point, **pressed, buttons=_BUTTON_BITS[button])
        await mouse(page, "mouseReleased", point, **pressed)


# --- drags --------------------------------------------------------------------------------------------


async def drag(page: Page, start: Point, end: Point) -> None:
    """Press the left button at the start, move, and release it at the end.

    What the page makes draggable by HTML is dragged as the system would: Chromium hands the drag over, and
    is told where it passes and is dropped.
    """
    held_down = {"button": "left", "buttons": 1}
    with contextlib.ExitStack() as stack:
        taken: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

        def on_intercepted(event: _DragIntercepted) -> None:
            if not taken.done():
                taken.set_result(event.data)

        stack.callback(page.session.on("Input.dragIntercepted", _DragIntercepted, on_intercepted))
        stack.callback(page.session.send, "Input.setInterceptDrags", {"enabled": False})
        page.session.send("Input.setInterceptDrags", {"enabled": True})
        await mouse(page, "mouseMoved", start)
        await mouse(page, "mousePressed", start, button="left", buttons=1, clickCount=1)
        data: dict[str, Any] | None = None
        for place in _way(start, end):
            if data is not None:
                await _drag_event(page, "dragOver", place, data)
                continue
            await mouse(page, "mouseMoved", place, **held_down)
            if await _has_drag_begun(page):
                async with asyncio.timeout(page.config.execute_seconds):
                    data = await taken
                await _drag_event(page, "dragEnter", place, data)
        if data is not None:
            await _drag_event(page, "drop", end, data)
        await mouse(page, "mouseReleased", end, button="left", clickCount=1)


def _way(start: Point, end: Point) -> list[Point]:
    """The places that a drag passes, its end included, which is passed twice: it is where most pages look."""
    across, down = end[0] - start[0], end[1] - start[1]
    length = max(1.0, (across**2 + down**2) ** 0.5)
    first = min(1.0, _DRAG_START / length)
    shares = [first + (1 - first) * step / _DRAG_STEPS for step in range(_DRAG_STEPS + 1)]
    return [(start[0] + across * share, start[1] + down * share) for share in (*shares, 1.0)]


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
    """Turn the wheel by a share of what scrolls here, or where it does the most."""
    sign = 1 if side in ("down", "right") else -1
    wheel = await wheel_over(page, side, point)
    distance = wheel.extent * page.config.scroll_fraction * sign
    across = side in ("left", "right")
    await mouse(
        page,
        "mouseWheel",
        wheel.point,
        deltaX=distance if across else 0,
        deltaY=0 if across else distance,
    )


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
