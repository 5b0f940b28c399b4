"""From the page to an observation and the bytes of its picture."""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple, TypeVar

import msgspec

from webgym.browser.cdp import CommandFailed
from webgym.browser.cdp_messages import Screenshot
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import Page
from webgym.browser.settle import settle
from webgym.core.errors import BrowserTimeout
from webgym.core.observation import Element, Notice, Observation

T = TypeVar("T")

_LOOKS = 3
"""Frames in frames, and roots in roots, take a look each the first time they are seen."""


_NO_FRAME_YET = ("Unable to capture screenshot", "Not attached to an active page")
"""What Chromium says while a page comes or goes."""


_SHORTENED = {
    "title": "the title",
    "address": "an address",
    "text": "the text",
    "value": "what stands in a field",
    "name": "the name of an element",
    "elements": "the list of elements",
    "options": "the open list of options",
}
"""What a notice calls each kind of thing that the scripts cut."""


class Look(msgspec.Struct, frozen=True):
    """An observation with its picture.

    Attributes:
        image: PNG (or JPEG, if the episode wants that), as many pixels as the viewport; its SHA-256 is
            ``observation.screenshot``.
    """

    observation: Observation
    image: bytes


class Metadata(msgspec.Struct, frozen=True):
    """Where a page is; fields as in :class:`~webgym.core.observation.Observation`."""

    url: str
    title: str
    viewport: tuple[int, int]
    status: int | None
    scroll: tuple[float, float]
    settled: str
    notices: tuple[Notice, ...]
    """What happened since the last action began."""


class Seen(msgspec.Struct, frozen=True):
    """What a document says of itself.

    Attributes:
        frames: the frames of other origins in its viewport.
        missing: those of them whose content it should have been given.
        unknown: whether it holds what was not entered yet.
        shortened: kinds of what was cut for its length (:data:`_SHORTENED`).
    """

    title: str = ""
    scroll: tuple[float, float] = (0.0, 0.0)
    text: str | None = None
    fields: tuple[str, ...] = ()
    cuts: tuple[tuple[str, str], ...] = ()
    elements: tuple[Element, ...] | None = None
    frames: frozenset[str] = frozenset()
    missing: frozenset[str] = frozenset()
    unknown: bool = False
    shortened: tuple[str, ...] = ()

    def notices(self, page: Page) -> tuple[Notice, ...]:
        """That something was too long to be observed whole, if something was."""
        kinds = [*self.shortened, *(["address"] if page.address != page.url else [])]
        named = ", ".join(words for kind, words in _SHORTENED.items() if kind in kinds)
        return (Notice("shortened", named),) if named else ()


class Early(NamedTuple):
    """What was found while the page was still waited for.

    Attributes:
        seen: what the document says of itself.
        picture: returns the screenshot that shows it.
    """

    seen: Seen
    picture: Callable[[], Awaitable[bytes]]


async def look(page: Page, settled: str, milliseconds: dict[str, float], early: Early | None = None) -> Look:
    """Look at the page as it is now.

    Args:
        settled: why the wait for it ended.
        milliseconds: wall time of the operations so far; completed here.
        early: a screenshot taken during the wait that still shows the page as it is, if there is one.

    Raises:
        BrowserTimeout: no picture within the deadline.
    """
    page.popups.close_blank()
    start = time.perf_counter()
    seen = early.seen if early else await ask(page, **wanted_of(page))
    page.points = {element.number: _middle(element.box) for element in seen.elements or ()}
    between = time.perf_counter()
    image = await (early.picture() if early else capture_marked(page))
    end = time.perf_counter()
    name = hashlib.sha256(image).hexdigest()
    page.pictured(name)
    milliseconds["metadata"] = (between - start) * 1000
    milliseconds["screenshot"] = (end - between) * 1000
    return Look(
        Observation(
            screenshot=name,
            url=page.address,
            title=seen.title,
            viewport=page.options.viewport,
            status=page.status,
            scroll=seen.scroll,
            mode=page.options.mode,
            settled=settled,
            notices=(*page.take_notices(), *seen.notices(page)),
            text=seen.text,
            fields=seen.fields,
            cuts=seen.cuts,
            elements=seen.elements,
            milliseconds=milliseconds,
        ),
        image,
    )


async def ask(page: Page, **wanted: bool) -> Seen:
    """What the document says of itself.

    Args:
        wanted: ``text``, ``cuts``, ``elements``, ``marks`` (draw them).
    """
    return await patiently(page, lambda: _ask(page, wanted))


async def patiently(page: Page, question: Callable[[], Awaitable[T]]) -> T:
    """Ask the document. One that moves on meanwhile is asked again once it is quiet.

    Raises:
        BrowserTimeout: no answer within the deadline of a look.
    """
    seconds = page.config.screenshot_seconds
    has_waited = False
    try:
        async with asyncio.timeout(seconds):
            while True:
                try:
                    return await question()
                except DocumentGone:
                    await settle(page)
                except BrowserTimeout:
                    if has_waited:
                        raise
                    has_waited = True
                    page.end_script()
                    page.note("still_loading", "the page did not react; the script that ran was ended")
    except TimeoutError:
        raise BrowserTimeout(f"the page could not be looked at within {seconds:g} s") from None


async def _ask(page: Page, wanted: dict[str, bool]) -> Seen:
    """One look; further ones where the first comes upon frames that nobody has looked into."""
    worlds = page.worlds
    if worlds.has_new_frames:
        await worlds.explore()
    seen = Seen()
    for _ in range(_LOOKS):
        shown = await worlds.gather(wanted, seen.missing)
        seen = await page.run("observe", wanted, shown, reply=Seen)
        worlds.in_view = set(seen.frames)
        if seen.unknown:
            await worlds.explore(again=True)
        elif not seen.missing:
            break
    return seen


def wanted_of(page: Page) -> dict[str, bool]:
    """What its observations are to say (see :func:`ask`)."""
    marks = page.options.mode == "marks"
    options = page.options
    return {
        "text": options.text,
        "cuts": options.cuts,
        "elements": options.elements or marks,
        "marks": marks,
    }


def _middle(box: tuple[float, float, float, float]) -> tuple[float, float]:
    x, y, width, height = box
    return x + width / 2, y + height / 2


async def capture_marked(page: Page) -> bytes:
    """:func:`capture`; marks that were drawn for it are gone afterwards."""
    try:
        return await capture(page)
    finally:
        if page.options.mode == "marks":
            page.post("unmark")


async def capture(page: Page) -> bytes:
    """The viewport as PNG, lossless, or as JPEG where the episode wants that.

    Raises:
        BrowserTimeout: not within the deadline, retries included.
    """
    config = page.config
    quality = page.options.jpeg_quality
    params: dict[str, object] = {"format": "png", "optimizeForSpeed": True}
    if quality is not None:
        params = {"format": "jpeg", "quality": quality}
    try:
        async with asyncio.timeout(config.screenshot_seconds):
            while True:
                try:
                    shot = await page.session.call(
                        "Page.captureScreenshot",
                        params,
                        reply=Screenshot,
                        seconds=config.screenshot_try_seconds,
                    )
                except BrowserTimeout:  # a frame that was swapped away took the request with it,
                    await page.complete()  # or there is nothing to draw
                    continue
                except CommandFailed as error:
                    if not any(words in error.message for words in _NO_FRAME_YET):
                        raise
                    await asyncio.sleep(config.screenshot_retry_seconds)
                    continue
                return shot.data
    except TimeoutError:
        raise BrowserTimeout(f"no screenshot within {config.screenshot_seconds:g} s") from None
