"""Low-level mouse and keyboard gestures beyond the agent's actions, for programs that drive a
browser themselves and for the compatibility layer.

Targets are those of actions: a point of the 0-1000 grid, or the number of an element. An element is scrolled
into view and located again, so that its number is valid for as long as it is in the document, whether an
observation showed it or not.
"""

from __future__ import annotations

import contextlib
from typing import Literal, TypeAlias

import msgspec

from webgym.browser.actions import perform, type_at
from webgym.browser.aim import point_of
from webgym.browser.cdp import CommandFailed
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import Page
from webgym.browser.pointer import Point, click, mouse, turn, wheel_over
from webgym.core.action import BrowserAction, Direction, Side, Target
from webgym.core.errors import ActionFailed, BrowserTimeout, NavigationFailed


class Click(msgspec.Struct, frozen=True, tag_field="name", tag="click"):
    """A left click; on an option of a closed dropdown, choose it."""

    target: Target


class HoverOver(msgspec.Struct, frozen=True, tag_field="name", tag="hover_over"):
    """Move the mouse to the target."""

    target: Target


class HoverAndScroll(msgspec.Struct, frozen=True, tag_field="name", tag="hover_and_scroll"):
    """Move the mouse to the target and turn the wheel, by most of the height of the scrollable element
    there."""

    target: Target
    direction: Direction = "down"


class Wheel(msgspec.Struct, frozen=True, tag_field="name", tag="wheel"):
    """Turn the wheel over the page itself.

    Attributes:
        distance: CSS pixels; down is positive.
    """

    distance: float


class ScrollElement(msgspec.Struct, frozen=True, tag_field="name", tag="scroll_element"):
    """Scroll an element, or its nearest scrollable ancestor, by its visible size."""

    element: int
    direction: Side


class Fill(msgspec.Struct, frozen=True, tag_field="name", tag="fill"):
    """Click the target and type. The keys are pressed even if no field receives the focus.

    Attributes:
        press_enter: whether to press Enter afterwards.
        delete_existing: whether to clear the field first; otherwise the text is appended.
    """

    target: Target
    text: str
    press_enter: bool = True
    delete_existing: bool = False


class Choose(msgspec.Struct, frozen=True, tag_field="name", tag="choose"):
    """Choose an option of a dropdown, open or closed; any other element is clicked.

    Attributes:
        element: number of the option.
    """

    element: int


Gesture: TypeAlias = Click | HoverOver | HoverAndScroll | Wheel | ScrollElement | Fill | Choose
AnyAction: TypeAlias = BrowserAction | Gesture
"""Everything that a slot can carry out."""


class _Place(msgspec.Struct, frozen=True):
    """The position of an element after it was scrolled into view."""

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


async def attempt(page: Page, action: AnyAction) -> None:
    """:func:`carry_out`, with failures of the action turned into notices."""
    try:
        await carry_out(page, action)
    except NavigationFailed as error:
        page.fail(error)
    except ActionFailed as error:
        page.note("action_failed", error.message)
    except CommandFailed as error:  # a page that is being replaced accepts no input
        page.note("action_failed", f"the browser did not take it ({error.message})")
    except BrowserTimeout as error:
        await page.end_script()
        page.note("still_loading", f"the page did not react, its script was ended ({error.message})")


async def carry_out(page: Page, action: AnyAction) -> None:
    """Carry out an action or a gesture, without waiting for its effects. Raises as
    :func:`~webgym.browser.actions.perform` does."""
    match action:
        case Click(target=target):
            await _click(page, target)
        case HoverOver(target=target):
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
    if place.kind == "elsewhere" and element in page.points:  # in a frame that only an observation enters
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
    await mouse(page, "mouseMoved", point)
    with contextlib.suppress(DocumentGone):
        await turn(page, "down" if distance > 0 else "up", point, deltaX=0, deltaY=distance)


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
