"""Where an action lands: an element of the last picture is found again, a point compared with the picture."""

from __future__ import annotations

import asyncio
import io
import re
from typing import Literal

import msgspec
from PIL import Image, ImageChops

from webgym.browser.cdp import CommandFailed
from webgym.browser.cdp_messages import Screenshot
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import Page
from webgym.core.action import GRID, Target
from webgym.core.errors import ActionFailed

_MAX_PASSES = 2
"""Most passes over the document: a frame that came into view takes one more."""
_QUOTED_LENGTH = 60
_BAND = 60
"""How far above and below a point, where its label may be, the picture is compared, CSS pixels."""

_WHY = {
    "gone": "is not on this page any more",
    "hidden": "cannot be seen any more",
    "covered": "is covered by something now",
}


class _Aimed(msgspec.Struct, frozen=True):
    """Where an element is (scripts/aim.js)."""

    point: tuple[float, float] | None = None
    why: Literal["", "gone", "hidden", "covered"] = ""
    was: str = ""
    is_: str = msgspec.field(name="is", default="")


class _Found(msgspec.Struct, frozen=True):
    aimed: _Aimed
    missing: frozenset[str] = frozenset()


def point_of(page: Page, target: Target) -> tuple[float, float]:
    """The position of a target in the last picture, CSS pixels.

    Raises:
        ActionFailed: the last observation contains no such element.
    """
    if target.element is not None:
        point = page.points.get(target.element)
        if point is None:
            raise ActionFailed(f"there is no element {target.element} in the last observation")
        return point
    assert target.coordinate is not None
    return on_page(page, target.coordinate)


def on_page(page: Page, coordinate: tuple[float, float]) -> tuple[float, float]:
    """A point of the grid in the viewport, CSS pixels."""
    width, height = page.options.viewport
    x, y = coordinate
    return min(x / GRID * width, width - 1), min(y / GRID * height, height - 1)


async def aim(page: Page, target: Target) -> tuple[float, float]:
    """The position of a target in the page as it is now, CSS pixels. An element is scrolled into view; of a
    point a notice says if the page no longer looks there as in the last picture.

    Raises:
        ActionFailed: the last observation contains no such element, or the page has since removed, covered or
            replaced it.
    """
    point = point_of(page, target)
    try:
        page.expected = point
        if await page.run("isAsPictured", target.element, point, reply=bool):
            return point
        if target.element is not None:
            page.expected = None
            return await _find(page, target.element)
    except DocumentGone:
        if target.element is not None:
            raise ActionFailed(f"element {target.element} was on a page that is gone") from None
    await _compare(page, point)
    return point


async def _find(page: Page, number: int) -> tuple[float, float]:
    aimed = await _look_for(page, number)
    if aimed.why == "hidden" and await page.run("showNumber", number, reply=bool):
        aimed = await _look_for(page, number)
    if aimed.point is None:
        raise ActionFailed(f"element {number} {_WHY[aimed.why or 'gone']}; nothing was done")
    if aimed.was != aimed.is_:
        was, now = aimed.was[:_QUOTED_LENGTH], aimed.is_[:_QUOTED_LENGTH]
        if _without_digits(aimed.was) != _without_digits(aimed.is_):
            raise ActionFailed(f'element {number} was "{was}" and is "{now}" now; nothing was done')
        page.note("changed", f'element {number} was "{was}" in the picture and is "{now}" now')
    return aimed.point


def _without_digits(text: str) -> str:
    """A text without its numbers: one that counts is the same element."""
    return re.sub(r"\d+", "", text)


async def _look_for(page: Page, number: int) -> _Aimed:
    wanted: dict[str, bool | int] = {"elements": True, "aimed": number}
    found = _Found(_Aimed())
    for _ in range(_MAX_PASSES):
        frames = await page.worlds.gather(wanted, found.missing)
        found = await page.run("observe", wanted, frames, reply=_Found)
        if not found.missing:
            break
    return found.aimed


async def _compare(page: Page, point: tuple[float, float]) -> None:
    """Add a notice if the page looks other than in the last picture in a band around this point."""
    if not page.image:
        return
    try:
        shot = await page.session.call(
            "Page.captureScreenshot",
            await page.picture_params(page.options.jpeg_quality),
            reply=Screenshot,
            seconds=page.config.screenshot_seconds,
        )
    except (CommandFailed, DocumentGone):  # there is no frame yet: it looks other than before
        pass
    else:
        band = [y * page.capture_scale for y in (point[1] - _BAND, point[1] + _BAND)]
        if not await asyncio.to_thread(_differ, page.image, shot.data, *band):
            return
    page.note("changed", "the page has changed since the picture, also where this action landed")


def _differ(before: bytes, now: bytes, top: float, bottom: float) -> bool:
    pictures = [Image.open(io.BytesIO(data)).convert("RGB") for data in (before, now)]
    if pictures[0].size != pictures[1].size:
        return True
    width, height = pictures[0].size
    band = (0, max(0, int(top)), width, min(height, int(bottom)))
    return ImageChops.difference(*(picture.crop(band) for picture in pictures)).getbbox() is not None
