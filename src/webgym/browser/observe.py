"""Observes the page: returns an observation and the bytes of its screenshot.

A screenshot can be taken while the page is still settling, or the last one used again
(:class:`EarlyScreenshot`), and a notice says that an action had no effect (:class:`EffectCheck`).
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import time
from collections.abc import Awaitable, Callable
from typing import Any, NamedTuple, TypeVar

import msgspec

from webgym.browser import marks
from webgym.browser.aim import point_of
from webgym.browser.cdp import CommandFailed
from webgym.browser.cdp_messages import Screenshot
from webgym.browser.gestures import AnyAction
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import Page
from webgym.browser.pictures import white
from webgym.browser.pointer import Point
from webgym.browser.settle import settle
from webgym.browser.text import Box, Counted, count, drop_unseen
from webgym.core.action import DoubleClick, LeftClick, RightClick, Scroll, Wait
from webgym.core.errors import ActionFailed, BrowserError, BrowserTimeout, NavigationFailed
from webgym.core.observation import Element, Notice, Observation, scaled

T = TypeVar("T")

_RETRY_SECONDS = 0.05
"""Between attempts at a screenshot for which the browser has no frame yet."""

_MAX_PASSES = 3
"""Most passes over the document: each level of nested frames or shadow roots that is new takes one."""


_MAX_LOOKS = 3
"""Most looks at a page that is replaced by another one each time."""


_NO_FRAME_YET = ("Unable to capture screenshot", "Not attached to an active page")
"""Chromium's error messages while a page is being replaced."""


_SHORTENED = {
    "title": "the title",
    "address": "an address",
    "text": "the text",
    "value": "what stands in a field",
    "name": "the name of an element",
    "elements": "the list of elements",
    "options": "the open list of options",
}
"""Descriptions in notices of the kinds of content that the scripts truncate."""


class Look(msgspec.Struct, frozen=True):
    """An observation with its picture.

    Attributes:
        observation: the observation.
        image: PNG (or JPEG, if the page's options say so); its SHA-256 is ``observation.screenshot``.
    """

    observation: Observation
    image: bytes


class Metadata(msgspec.Struct, frozen=True):
    """A page's state without its content; fields as in :class:`~webgym.core.observation.Observation`."""

    url: str
    title: str
    viewport: tuple[int, int]
    status: int | None
    scroll: tuple[float, float]
    settled: str
    notices: tuple[Notice, ...]
    """What happened since the last action began."""


class PageContent(msgspec.Struct, frozen=True):
    """The content of a document; other fields as in :class:`~webgym.core.observation.Observation`.

    Attributes:
        login: whether a form for a name or a password is shown.
        frames: the frames of other origins in its viewport.
        missing: those of them whose content was not provided.
        unknown: whether it contains frames or shadow roots that were not entered yet.
        counted, doubts: what the text has placeholders for (:mod:`~webgym.browser.text`).
        shortened: kinds of content that were truncated (:data:`_SHORTENED`).
        said: what the browser itself shows beside the page, such as the bubble of a field that is not valid:
            number and text of each since the document began, the last ones.
    """

    title: str = ""
    scroll: tuple[float, float] = (0.0, 0.0)
    text: str | None = None
    fields: tuple[str, ...] = ()
    cuts: tuple[tuple[str, str], ...] = ()
    elements: tuple[Element, ...] | None = None
    login: bool = False
    frames: frozenset[str] = frozenset()
    missing: frozenset[str] = frozenset()
    unknown: bool = False
    counted: tuple[Counted, ...] = ()
    doubts: tuple[tuple[Box, ...], ...] = ()
    shortened: tuple[str, ...] = ()
    said: tuple[tuple[str, str], ...] = ()

    def notices(self, page: Page) -> tuple[Notice, ...]:
        """Notices of what the browser said, unless an observation told it already, and that content was
        truncated, if any was."""
        news = ((number, text) for number, text in self.said if (page.loader, number) not in page.told)
        return (*(Notice("browser", text) for _, text in news), *self._truncated(page))

    def _truncated(self, page: Page) -> tuple[Notice, ...]:
        kinds = [*self.shortened, *(["address"] if page.address != page.url else [])]
        named = ", ".join(words for kind, words in _SHORTENED.items() if kind in kinds)
        return (Notice("shortened", named),) if named else ()


class Early(NamedTuple):
    """An observation that was made while the page was settling.

    Attributes:
        content: content of the document.
        picture: returns the screenshot that shows it.
    """

    content: PageContent
    picture: Callable[[], Awaitable[bytes]]


async def look(page: Page, settled: str, milliseconds: dict[str, float], early: Early | None = None) -> Look:
    """Observe the page.

    Args:
        page: the page.
        settled: why the wait for a quiet page ended.
        milliseconds: wall time of the operations so far; this function adds its own.
        early: a screenshot taken during the wait that still shows the page's current state, if there is one.

    Raises:
        BrowserTimeout: no screenshot within the deadline.
    """
    for tries in range(_MAX_LOOKS):
        if tries:
            early, settled = None, await settle(page)
        loader = page.loader
        start = time.perf_counter()
        content = early.content if early else await read_content(page, **content_options(page))
        if content.text is not None and content.counted:
            text = await count(page.session, content.text, content.counted, page.config.execute_seconds)
            content = msgspec.structs.replace(content, text=text)
        between = time.perf_counter()
        image = await (early.picture() if early else _capture_bare(page))
        if page.loader == loader:
            break  # else the picture shows the next page
    if content.text is not None and content.doubts:
        text = await drop_unseen(content.text, content.doubts, image, page.capture_scale)
        content = msgspec.structs.replace(content, text=text)
    if page.options.mode == "marks":
        elements, quality = content.elements or (), page.options.jpeg_quality
        image = await asyncio.to_thread(marks.draw, image, elements, quality, page.capture_scale)
    end = time.perf_counter()
    milliseconds["metadata"] = (between - start) * 1000
    milliseconds["screenshot"] = (end - between) * 1000
    name = hashlib.sha256(image).hexdigest()
    page.image = image if page.options.mode == "coordinates" else b""
    return Look(_observation(page, content, name, settled, milliseconds), image)


def _observation(
    page: Page, content: PageContent, name: str, settled: str, milliseconds: dict[str, float]
) -> Observation:
    page.points = {element.number: _middle(element.box) for element in content.elements or ()}
    page.pictured(name, content.scroll[0])
    sent, limited, crowded = page.take_usage()
    notices = (*page.notices.take(), *content.notices(page))
    page.told |= {(page.loader, number) for number, _ in content.said}
    return Observation(
        screenshot=name,
        url=page.address,
        title=content.title,
        viewport=page.options.viewport,
        status=page.status,
        scroll=content.scroll,
        mode=page.options.mode,
        capture_scale=page.capture_scale,
        settled=settled,
        notices=notices,
        faults=page.take_faults(),
        text=content.text,
        fields=content.fields,
        cuts=content.cuts,
        elements=content.elements,
        has_login=content.login,
        bytes=sent,
        limited=limited,
        crowded=crowded,
        milliseconds=milliseconds,
        route=page.route,
    )


async def read_content(page: Page, **wanted: bool) -> PageContent:
    """Read the content of the document.

    Args:
        page: the page.
        wanted: ``text``, ``cuts``, ``elements``.
    """
    return await with_retries(page, lambda: _read_content(page, wanted))


async def with_retries(page: Page, question: Callable[[], Awaitable[T]]) -> T:
    """Query the document; if it navigates in the meantime, query the next one once it is quiet.

    Raises:
        BrowserTimeout: no answer within ``screenshot_seconds``, nor after what blocks the page was ended.
    """
    try:
        return await _ask(page, question)
    except (TimeoutError, BrowserTimeout):
        await page.unblock()
    try:
        return await _ask(page, question)
    except TimeoutError:
        seconds = page.config.screenshot_seconds
        raise BrowserTimeout(f"the page could not be looked at within {seconds:g} s") from None


async def _ask(page: Page, question: Callable[[], Awaitable[T]]) -> T:
    async def ask() -> T:
        while True:
            try:
                return await question()
            except DocumentGone:
                await settle(page)

    asked = asyncio.create_task(ask())
    try:
        return await page.session.connection.wait(asked, page.config.screenshot_seconds)
    finally:
        asked.cancel()


async def _read_content(page: Page, wanted: dict[str, bool]) -> PageContent:
    """Read the content, with further passes if there are frames that were not entered yet."""
    worlds = page.worlds
    if worlds.has_new_frames:
        await worlds.explore()
    content = PageContent()
    for _ in range(_MAX_PASSES):
        shown = await worlds.gather(wanted, content.missing)
        content = await page.run("observe", wanted, shown, reply=PageContent)
        worlds.in_view = set(content.frames)
        if content.unknown:
            await worlds.explore(again=True)
        elif not content.missing:
            break
    return content


def content_options(page: Page) -> dict[str, bool]:
    """The content of the page's observations, by its options (see :func:`read_content`)."""
    options = page.options
    elements = options.elements or options.mode == "marks"
    return {"text": options.text, "cuts": options.cuts, "elements": elements}


def _middle(box: tuple[float, float, float, float]) -> tuple[float, float]:
    x, y, width, height = box
    return x + width / 2, y + height / 2


async def capture(page: Page, quality: int | None = None) -> bytes:
    """A screenshot of the viewport as PNG, lossless, or as JPEG of this quality, 1 to 100.

    Raises:
        BrowserTimeout: no screenshot within the deadline, retries included.
    """

    async def query() -> bytes:
        params = await page.picture_params(quality)
        for _ in range(_MAX_LOOKS):
            image, before = await _capture(page, params, quality), params
            params = await page.picture_params(quality)
            if params == before:  # else it was scrolled, and the picture may show another part of it
                break
        return image

    return await with_retries(page, query)


async def _capture_bare(page: Page) -> bytes:
    """A screenshot as the page's options say, or a PNG to draw marks on."""
    loader = page.loader
    page.stillness.begin_picture()
    image = await capture(page, None if page.options.mode == "marks" else page.options.jpeg_quality)
    page.stillness.end_picture(loader, image)
    return image


async def _capture(page: Page, params: dict[str, Any], quality: int | None) -> bytes:
    config = page.config
    requests: set[asyncio.Task[Screenshot]] = set()
    if page.is_new_window and (undrawn := await _have_drawn(page, quality)):
        return undrawn
    try:
        while True:
            request = page.session.call(
                "Page.captureScreenshot", params, reply=Screenshot, seconds=config.screenshot_seconds
            )
            requests.add(asyncio.create_task(request))
            # Earlier ones may still be answered: a huge page is drawn for longer than one may take.
            done, requests = await asyncio.wait(
                requests, timeout=config.screenshot_try_seconds, return_when=asyncio.FIRST_COMPLETED
            )
            try:
                for shot in done:
                    return shot.result().data
            except CommandFailed as error:
                if not any(words in error.message for words in _NO_FRAME_YET):
                    raise
                await asyncio.sleep(_RETRY_SECONDS)
                continue
            # The request was lost with a replaced frame, or nothing is drawn yet.
            undrawn = await _have_drawn(page, quality)
            if undrawn is not None:
                return undrawn
    finally:
        for one in requests:
            one.cancel()


async def _have_drawn(page: Page, quality: int | None) -> bytes | None:
    """Have a document drawn that Chromium does not draw.

    Documents that ended before their body get one: a script in the head may open another program, such as for
    mail, and then the rest is not parsed; or the connection broke. Documents that are held back by a style
    sheet that is still loading are drawn without it until it has loaded.

    Args:
        page: the page.
        quality: of a JPEG, 1 to 100.

    Returns:
        A white picture of a document whose body is yet to come; ``None`` if there is something to draw now.
    """
    with contextlib.suppress(DocumentGone, CommandFailed, BrowserTimeout):
        found = await page.run("drawn", page.has_broken_off, page.is_new_window, reply=str)
        if found == "cut off":
            content = {"frameId": page.target_id, "html": ""}
            await page.session.do("Page.setDocumentContent", content, seconds=page.config.execute_seconds)
        elif found:
            if not page.is_new_window:
                why = f"{page.address} has nothing to show yet"
                page.fail(NavigationFailed(why, url=page.url), is_typed=page.is_typed)
            return white(scaled(page.options.viewport, page.capture_scale), quality)
    return None


_FINAL = frozenset({"unchanged", "quiet", "long_poll"})
"""Reasons for the end of the wait after which the page does not change any more."""


class EarlyScreenshot:
    """The early screenshot of one step.

    Taking a screenshot takes as long as finding out that nothing more is loading, which is the usual case. So
    if an action has started nothing that is still pending, the screenshot is requested at once, and used if
    the page still looks the same when the wait is over (``scripts/early.js``). Otherwise it is discarded and
    a new one is taken as usual. On a page whose last early screenshot was used, it is requested without
    finding out first whether tasks are pending, which takes until the next frame.

    If the page has painted nothing since the last picture, that is used again
    (:class:`~webgym.browser.pictures.Stillness`).

    :meth:`begin` after the action and :meth:`end` after the wait; :meth:`drop` in any case.
    """

    def __init__(self, page: Page) -> None:
        self.content: PageContent | None = None
        """The content of the document, if the screenshot shows its current state."""
        self.page = page
        self._is_calm, page.is_calm = page.is_calm, False
        self._before = self._state()
        self._task: asyncio.Task[bytes | None] | None = None
        self._is_requested = False
        self._kept: bytes | None = None
        """The last picture, if that is used again."""

    def _state(self) -> tuple[str, int]:
        return self.page.loader, self.page.requests

    @property
    def result(self) -> Early | None:
        """The screenshot and the document's content, if it was taken and shows the page's current state."""
        if self.content is None or self._before != self._state():
            return None
        return Early(self.content, self.picture)

    async def begin(self) -> None:
        """After the action: request the screenshot, unless something is known to be in progress."""
        if not self._is_alone() or self.page.notices.happened:
            return
        self._task = asyncio.create_task(self._take())
        await asyncio.sleep(0)  # this request reaches the page before those of the wait

    def _is_alone(self) -> bool:
        """Whether the main frame sees all changes, and nothing is being loaded."""
        page, worlds = self.page, self.page.worlds
        has_more = worlds.has_new_frames or worlds.entered or len(page.workers) or page.options.cuts
        if has_more or not worlds.is_entered or self._before != self._state():
            return False
        return page.traffic.is_idle()

    async def _take(self) -> bytes | None:
        """The screenshot, or ``None`` if the page is about to change."""
        page = self.page
        is_worth_it: bool | None = None
        try:
            seconds = page.config.busy_seconds
            is_calm = self._is_calm and page.stillness.picture_of(page.loader) is None
            is_worth_it = await page.run("beginEarly", is_calm, reply=bool, seconds=seconds)
        except BrowserError:
            return None  # reported by the wait or the observation
        finally:
            if is_worth_it is None:
                page.post("dropEarly")  # the page may still come to it
        if not is_worth_it:
            return None
        if page.stillness.picture_of(page.loader) is not None:
            await (
                page.stillness.has_painted.wait()
            )  # else the last picture is used again, and this is cancelled
        self._is_requested = True
        return await _capture_bare(page)

    @property
    def wanted(self) -> dict[str, bool] | None:
        """The content to read when the wait is over; ``None`` if no screenshot is on its way."""
        return content_options(self.page) if self._task is not None else None

    async def end(self, settled: str) -> None:
        """After the wait: find out whether the screenshot shows the page's current state.

        Args:
            settled: why the wait ended.
        """
        page = self.page
        if page.result is None or settled not in _FINAL:
            return
        known = [msgspec.json.decode(it, type=PageContent) for it in page.result.contents]
        if not self._is_requested:
            await self.drop()
            known = await self._keep(known) if settled == "unchanged" and self._is_alone() else []
        self.content = next((it for it in known if not (it.unknown or it.missing or it.frames)), None)
        page.is_calm = self.result is not None

    async def _keep(self, known: list[PageContent]) -> list[PageContent]:
        """Use the last picture again, if it is one of the page as it is.

        Args:
            known: the content of the document, if it was read already.

        Returns:
            The content; empty if the page needs a new picture.
        """
        page = self.page
        if page.stillness.picture_of(page.loader) is None:
            return []
        with contextlib.suppress(BrowserError):  # reported by the observation
            if await page.stillness.has_still_pictures(page.config.execute_seconds):
                options = None if known else content_options(page)
                read = await page.run("rest", options, reply=list[PageContent | None])
                self._kept = page.stillness.picture_of(page.loader)
                if read and self._kept is not None:
                    return known or [it for it in read if it is not None]
        return []

    async def picture(self) -> bytes:
        """The screenshot. Raises as :func:`~webgym.browser.observe.capture` does."""
        if self._kept is not None:
            return self._kept
        assert self._task is not None
        image = await self._task
        assert image is not None, "the screenshot was requested before its content was read"
        return image

    async def drop(self) -> None:
        """Cancel the screenshot, or waiting for a reason to take one."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)


class EffectCheck:
    """Detects clicks and scrolls without effect, and adds a notice of them to the next observation.

    A page does not report that an action had none, and the screenshot of a page that moves by itself differs
    in any case.

    An effect is a change of the document that did not occur by itself before, another focus or selection, a
    changed value, a scroll, a new timer, a request, another URL, a window, or any notice. Other actions are
    not checked. Parts that go on changing after an action are ignored at the next one.
    """

    def __init__(self, page: Page, action: AnyAction) -> None:
        self._page = page
        self._point: Point | None = None
        self._message = ""
        self._is_idle, self._is_scroll = isinstance(action, Wait), isinstance(action, Scroll)
        self._trace_started: asyncio.Task[bool | None] | None = None
        match action:
            case LeftClick(target=target) | DoubleClick(target=target) | RightClick(target=target):
                with contextlib.suppress(ActionFailed):  # reported when the action is carried out
                    self._point = point_of(page, target)
                    self._message = "the page did not react to it"
            case Scroll(direction=direction):
                self._message = f"nothing scrolled {direction}"

    async def begin(self) -> None:
        """Call before the action. The page handles this call before the action's, so it is not awaited."""
        self._before = self._state()
        if self._message:
            self._trace_started = asyncio.create_task(self._call_page("beginTrace", self._point, reply=bool))
            await (asyncio.sleep(0) if self._page.worlds.is_entered else self._trace_started)  # it is sent

    async def end(self) -> None:
        """Call after the page has settled: add a notice if the action had no effect."""
        page = self._page
        was_traced = self._trace_started and await self._trace_started
        if self._is_idle:
            page.post("beginTrace")  # what has gone on meanwhile does so by itself
        page.post("endTrace")
        if page.result and page.result.missed:
            page.note("changed", "the page changed during the click, which hit something else, or nothing")
        if not was_traced or page.notices.happened or self._before != self._state():
            return
        effect = page.result.effect if page.result else "some"
        if effect == "some":
            return
        options = page.options
        sees_shadow_roots = options.text or options.elements or options.mode == "marks"
        if effect == "unseen" or not sees_shadow_roots or page.worlds.in_view:
            page.ineffective_if_same = self._message
        elif self._is_scroll:
            page.ineffective_if_unscrolled = self._message
        else:
            page.note("no_effect", self._message)

    def _state(self) -> tuple[str, str, int]:
        return self._page.url, self._page.loader, self._page.requests

    async def _call_page(self, function: str, *arguments: object, reply: Any) -> Any:
        """The page's reply; ``None`` if it does not answer or is gone, which other notices report."""
        with contextlib.suppress(BrowserError):
            seconds = self._page.config.busy_seconds
            return await self._page.run(function, *arguments, reply=reply, seconds=seconds)
        return None
