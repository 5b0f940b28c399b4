"""Low-level mouse and keyboard gestures beyond the agent's actions, for programs that drive a
browser themselves and for the compatibility layer.

Places are targets as actions have them: a point of the 0-1000 grid, or the number of an element. An
element is measured anew and scrolled into view, so that its number is good for as long as it is in the
document, whether a picture showed it or not.
"""

from __future__ import annotations

import asyncio
from typing import Literal, TypeAlias

import msgspec

from webgym.browser.actions import perform, point_of, type_at
from webgym.browser.cdp import CommandFailed
from webgym.browser.page import Page
from webgym.browser.pointer import Point, click, mouse, wheel_over
from webgym.core.action import BrowserAction, Direction, Hover, Side, Target
from webgym.core.errors import (
    ActionFailed,
    BrowserTimeout,
    DownloadRefused,
    EgressRefused,
    NavigationFailed,
    PageError,
)
from webgym.core.observation import NoticeKind


class Click(msgspec.Struct, frozen=True, tag_field="name", tag="click"):
    """A left click. On an option of a closed dropdown: choose it."""

    target: Target


class HoverAndScroll(msgspec.Struct, frozen=True, tag_field="name", tag="hover_and_scroll"):
    """Move the mouse here and turn its wheel: by most of what scrolls here, a little where nothing does."""

    target: Target
    direction: Direction = "down"


class Wheel(msgspec.Struct, frozen=True, tag_field="name", tag="wheel"):
    """Turn the wheel over the page itself.

    Attributes:
        distance: CSS pixels; down is positive.
    """

    distance: float


class ScrollElement(msgspec.Struct, frozen=True, tag_field="name", tag="scroll_element"):
    """Scroll an element, or the nearest around it that scrolls, by what it shows at once."""

    element: int
    direction: Side


class Fill(msgspec.Struct, frozen=True, tag_field="name", tag="fill"):
    """Click here and type. Where no field takes the focus the keys are pressed all the same.

    Attributes:
        press_enter: afterwards.
        delete_existing: clear the field first; else the text goes behind what is there.
    """

    target: Target
    text: str
    press_enter: bool = True
    delete_existing: bool = False


class Choose(msgspec.Struct, frozen=True, tag_field="name", tag="choose"):
    """Choose an option of a dropdown, which need not be open; anything else is clicked.

    Attributes:
        element: the option's number.
    """

    element: int


Gesture: TypeAlias = Click | HoverAndScroll | Wheel | ScrollElement | Fill | Choose
AnyAction: TypeAlias = BrowserAction | Gesture
"""Whatever a slot carries out."""


class _Place(msgspec.Struct, frozen=True):
    """Where an element is, now that it was scrolled into view."""

    kind: Literal["shown", "hidden", "gone", "elsewhere", "option"]
    point: Point = (0.0, 0.0)


class _Chosen(msgspec.Struct, frozen=True):
    why: str = ""


class _Spot(msgspec.Struct, frozen=True):
    point: Point | None


class _Distance(msgspec.Struct, frozen=True):
    distance: float


class _Scrolled(msgspec.Struct, frozen=True):
    kind: Literal["scrolled", "fixed", "gone"]


_NOTICE_OF: dict[type[PageError], NoticeKind] = {
    NavigationFailed: "navigation_failed",
    EgressRefused: "navigation_failed",
    DownloadRefused: "download_refused",
    ActionFailed: "action_failed",
}


async def attempt(page: Page, action: AnyAction) -> None:
    """:func:`carry_out`; what the page refuses is kept as a notice."""
    try:
        await carry_out(page, action)
    except (ActionFailed, NavigationFailed) as error:
        page.note(_NOTICE_OF[type(error)], error.message)
    except CommandFailed as error:  # a page that comes or goes takes no input
        page.note("action_failed", f"the browser did not take it ({error.message})")
    except BrowserTimeout as error:
        page.end_script()
        page.note("still_loading", f"the page did not react, its script was ended ({error.message})")


async def carry_out(page: Page, action: AnyAction) -> None:
    """Carry an action or a gesture out, without waiting for what it sets off. Raises as
    :func:`~webgym.browser.actions.perform` does."""
    match action:
        case Click(target=target):
            await _click(page, target)
        case Hover(target=target):
            await mouse(page, "mouseMoved", await _point(page, target))
        case HoverAndScroll(target=target, direction=direction):
            await _hover_and_scroll(page, await _point(page, target), direction)
        case Wheel(distance=distance):
            await _turn(page, await _over_page(page, distance), distance)
        case ScrollElement(element=element, direction=direction):
            await _scroll_element(page, element, direction)
        case Fill(target=target, text=text, press_enter=enter, delete_existing=replace):
            point = await _point(page, target)
            await type_at(page, point, text, replace=replace, enter=enter, blindly=True)
        case Choose(element=element):
            await _click(page, Target(element=element))
        case _:
            await perform(page, action)


# --- places -------------------------------------------------------------------------------------------


async def _reveal(page: Page, element: int) -> _Place:
    place = await page.run("reveal", element, reply=_Place)
    if place.kind == "elsewhere" and element in page.points:  # in a frame that only a look reaches
        return _Place("shown", page.points[element])
    if place.kind in {"gone", "elsewhere"}:
        raise ActionFailed(f"there is no element {element} on this page any more")
    if place.kind == "hidden":
        raise ActionFailed(f"element {element} cannot be seen")
    return place


async def _point(page: Page, target: Target) -> Point:
    if target.element is None:
        return point_of(page, target)
    return (await _reveal(page, target.element)).point


# --- mouse --------------------------------------------------------------------------------------------


async def _click(page: Page, target: Target) -> None:
    if target.element is None:
        return await click(page, point_of(page, target))
    place = await _reveal(page, target.element)
    if place.kind != "option":
        return await click(page, place.point)
    chosen = await page.run("chooseOption", target.element, reply=_Chosen)
    if chosen.why:
        raise ActionFailed(f"option {target.element} was not chosen: {chosen.why}")
    return None


async def _turn(page: Page, point: Point, distance: float) -> None:
    await asyncio.gather(  # sent at once, taken in order
        mouse(page, "mouseMoved", point),
        mouse(page, "mouseWheel", point, deltaX=0, deltaY=distance),
    )


async def _over_page(page: Page, distance: float) -> Point:
    spot = await page.run("wheelPoint", reply=_Spot)
    return spot.point or (await wheel_over(page, "down" if distance > 0 else "up")).point


async def _hover_and_scroll(page: Page, point: Point, direction: Direction) -> None:
    by = await page.run("scrollDistance", *point, reply=_Distance)
    await _turn(page, point, by.distance if direction == "down" else -by.distance)


async def _scroll_element(page: Page, element: int, direction: Side) -> None:
    scrolled = await page.run("scrollElement", element, direction, reply=_Scrolled)
    if scrolled.kind == "gone":
        raise ActionFailed(f"there is no element {element} on this page any more")
    if scrolled.kind == "fixed":
        raise ActionFailed(f"nothing scrolls around element {element}")
