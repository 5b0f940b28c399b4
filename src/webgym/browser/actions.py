"""Carries out actions by mouse, keyboard and history (paper appendix C)."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Literal, assert_never

import msgspec

from webgym.browser.cdp_messages import History, HistoryEntry
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.keyboard import BACKSPACE, ENTER, PROCESS, Key, key_of, split_input
from webgym.browser.page import BLANK, Page, Returned
from webgym.browser.pointer import Point, click, drag, hold, holding, mouse, press, scroll
from webgym.browser.settle import settle
from webgym.browser.sliders import TYPED_KEYS, slide
from webgym.browser.upload import upload
from webgym.core.action import (
    GRID,
    MAX_WAIT_SECONDS,
    AnswerDialog,
    BrowserAction,
    DoubleClick,
    Drag,
    GoBack,
    Hold,
    Hover,
    LeftClick,
    Navigate,
    Press,
    RightClick,
    Scroll,
    Target,
    Type,
    Upload,
    Wait,
    typed_addresses,
)
from webgym.core.errors import ActionFailed, NavigationFailed

_QUOTED_LENGTH = 300
_FRAME_DEPTH = 8
"""How many levels of nested frames the focus is followed into."""


class _Field(msgspec.Struct, frozen=True):
    """The focused element, prepared for typing.

    Attributes:
        kind: ``text``: a field whose content is selected. ``keys``: another element that handles keys.
            ``slider``: a slider that keys move. ``frame``: a frame of another origin. ``set``, ``chosen``:
            the value was set already.
            ``refused``: the text is not valid for the field. ``read_only``: no text is. ``none``: nothing
            accepts text.
        filled: whether it has content to be cleared.
        stands: whether it may be the input of an editor that keeps its content itself.
        frame: the focused frame; ``None`` if it was not entered yet, empty if it cannot be entered.
        wondered: whether the focus may be in a closed shadow root that was not entered yet.
        why: why the text was refused, or which other value than the requested one was set.
        wanted, value, share: as in :func:`webgym.browser.sliders.slide`.
    """

    kind: Literal["text", "keys", "slider", "frame", "set", "chosen", "refused", "read_only", "none"]
    filled: bool = False
    stands: bool = False
    frame: str | None = None
    wondered: bool = False
    why: str = ""
    wanted: float = 0.0
    value: float | None = None
    share: bool = False


async def perform(page: Page, action: BrowserAction) -> None:
    """Carry out an action, without waiting for its effects.

    Raises:
        ActionFailed, NavigationFailed: the action is not possible on this page, which is unchanged; or a
            slider has another value than the requested one.
        BrowserTimeout: the page did not handle an input event in time.
        TargetGone, BrowserCrashed: the page or the browser is gone.
    """
    match action:
        case LeftClick(target=target, modifiers=modifiers):
            point = point_of(page, target)
            async with holding(page, modifiers) as bits:
                await click(page, point, modifiers=bits)
        case DoubleClick(target=target):
            await click(page, point_of(page, target), count=2)
        case RightClick(target=target):
            await click(page, point_of(page, target), button="right")
        case Hover(target=target):
            await mouse(page, "mouseMoved", point_of(page, target))
        case Hold(target=target, time=seconds):
            await hold(page, point_of(page, target), _bounded(seconds))
        case Drag(start=start, target=target, path=path, time=seconds):
            between = [_on_page(page, point) for point in path]
            await drag(page, [point_of(page, start), *between, point_of(page, target)], _bounded(seconds))
        case Type(target=target, text=text, enter=enter):
            await type_at(page, point_of(page, target), text, enter=enter)
        case Press(keys=keys):
            await press(page, keys)
        case Scroll(direction=direction, target=target):
            await scroll(page, direction, None if target is None else point_of(page, target))
        case Upload(target=target, files=names):
            await upload(page, point_of(page, target), names)
        case Wait(time=seconds):
            await page.rest(_bounded(seconds))
        case AnswerDialog(accept=accept, text=text):
            if not page.dialogs.is_open:
                raise ActionFailed("no dialog is open")
            page.dialogs.answer(accept=accept, text=text)
        case GoBack():
            await _go_back(page)
        case Navigate(url=url):
            await _navigate(page, url)
        case _:
            assert_never(action)


def _bounded(seconds: float) -> float:
    return max(0.0, min(seconds, MAX_WAIT_SECONDS))


def point_of(page: Page, target: Target) -> Point:
    """The position of a target in the viewport, CSS pixels.

    Raises:
        ActionFailed: the last observation contains no such element.
    """
    if target.element is not None:
        point = page.points.get(target.element)
        if point is None:
            raise ActionFailed(f"there is no element {target.element} in the last observation")
        return point
    assert target.coordinate is not None
    return _on_page(page, target.coordinate)


def _on_page(page: Page, coordinate: tuple[float, float]) -> Point:
    width, height = page.options.viewport
    x, y = coordinate
    return min(x / GRID * width, width - 1), min(y / GRID * height, height - 1)


# --- keyboard -----------------------------------------------------------------------------------------


async def _press(page: Page, key: Key) -> None:
    kinds: tuple[Literal["down", "up"], ...] = ("down", "up")
    seconds = page.config.execute_seconds
    await asyncio.gather(  # sent at once, handled in order
        *(page.session.do("Input.dispatchKeyEvent", key.event(kind), seconds=seconds) for kind in kinds)
    )


async def _insert(page: Page, text: str) -> None:
    await page.session.do("Input.insertText", {"text": text}, seconds=page.config.execute_seconds)


async def _compose(page: Page, text: str) -> None:
    """Enter text as an input method does: the page sees a composition begin, change and end."""
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
    for method, run in split_input(text, TYPED_KEYS):
        match method:
            case "keys":
                await asyncio.gather(*(_press(page, key_of(character)) for character in run))
            case "compose":
                await _compose(page, run)
            case "insert":
                await _insert(page, run)


async def _prepare(page: Page, text: str, enter: bool) -> _Field:
    """Prepare the focused element for typing, in whichever frame it is."""
    frame: str | None = None
    for _ in range(_FRAME_DEPTH):
        try:
            field = await page.run("prepareTyping", text, enter, reply=_Field, frame=frame)
            if field.kind != "frame":
                return msgspec.structs.replace(field, frame=frame)
            if field.frame is None:
                await page.worlds.explore(again=True)
            elif field.frame:
                frame = field.frame
            else:
                break
        except DocumentGone:
            break
    return _Field("none")


async def _settle_and_prepare(page: Page, text: str, enter: bool, wondered: bool) -> _Field:
    """Prepare again after the page has settled: the click may open a field with a delay, or have focused an
    element in a closed shadow root."""
    await settle(page)
    if wondered:
        with contextlib.suppress(DocumentGone):
            await page.worlds.explore()
    return await _prepare(page, text, enter)


async def type_at(
    page: Page, point: Point, text: str, *, replace: bool = True, enter: bool = True, blindly: bool = False
) -> None:
    """Click at a point and type into the element that then has the focus.

    Args:
        page: the page.
        point: where to click, CSS pixels.
        text: what to type.
        replace: whether to replace the field's content; otherwise the text is appended.
        enter: whether to press Enter afterwards.
        blindly: whether to press the keys even if no element is known to handle them.

    Raises:
        ActionFailed: no element accepts this text, or a slider does not have this value.
    """
    await click(page, point)
    field = await _prepare(page, text, enter)
    if field.kind in ("none", "keys", "read_only"):
        field = await _settle_and_prepare(page, text, enter, field.wondered)
    if field.kind == "text" and field.stands and replace:
        await press(page, ("Control", "a"))
    match field.kind:
        case "none" | "frame" if not blindly:
            raise ActionFailed("there is no text field at this place; nothing was typed")
        case "refused" | "read_only":
            raise ActionFailed(f"nothing was typed: {field.why}")
        case "chosen":
            return
        case "slider":
            await slide(page, field.wanted, field.value, share=field.share, frame=field.frame)
            return
        case "set" if field.why:
            raise ActionFailed(field.why)
        case "keys" | "none" | "frame":
            if len(text) > TYPED_KEYS:
                raise ActionFailed(f"this is not a text field; it takes {TYPED_KEYS} key presses at most")
            await _write(page, text)
        case "text" if text:
            if not replace:
                await press(page, ("Control", "End"))  # replaces the selection by a caret at the end
            await _write(page, text)
        case "text" if (field.filled or field.stands) and replace:
            await _press(page, BACKSPACE)
    if enter:
        await _press(page, ENTER)


# --- history and addresses ----------------------------------------------------------------------------


async def _go_back(page: Page) -> None:
    history = await _history(page)
    index = (history.current_index if page.returned is None else page.returned.index) - 1
    page.returned = None
    if index < 0 or history.entries[index].url == BLANK:
        if not page.is_window:
            raise ActionFailed("there is no earlier page to go back to")
        page.close_target()
        await page.rest(page.config.execute_seconds)
        return
    left = page.loader
    await _return_to(page, history.entries[index])
    page.returned = Returned(index, left)


async def has_redirected(page: Page) -> bool:
    """Whether the page that this action went back to has redirected, or added itself to the history.

    Going back then requires skipping that page, by going back once more in the same action.
    """
    returned = page.returned
    return returned is not None and (await _history(page)).current_index > returned.index


async def _history(page: Page) -> History:
    return await page.session.call(
        "Page.getNavigationHistory", reply=History, seconds=page.config.execute_seconds
    )


async def _return_to(page: Page, entry: HistoryEntry) -> None:
    """Request an entry of the history, and return once the page, or one of its frames, goes there."""
    seconds = page.config.execute_seconds
    page.traffic.started.clear()
    await page.session.do("Page.navigateToHistoryEntry", {"entryId": entry.id}, seconds=seconds)
    try:
        async with asyncio.timeout(page.config.navigate_seconds):
            while not await page.traffic.starts(page.config.quiet_seconds):
                history = await _history(page)
                if history.entries[history.current_index].id == entry.id:  # only a frame went back
                    break
    except TimeoutError:
        raise NavigationFailed(f"{entry.url[:_QUOTED_LENGTH]} did not open", url=entry.url) from None


async def _navigate(page: Page, url: str) -> None:
    address = url.strip()
    if len(address) > page.config.url_length:
        raise NavigationFailed(f"an address of {len(address)} characters was not opened")
    addresses = typed_addresses(address)
    if not addresses:
        raise NavigationFailed(
            f'"{address[:_QUOTED_LENGTH]}" was not opened: only http and https addresses are'
        )
    page.next_is_typed = not page.is_first
    for address in addresses:
        try:
            await page.navigate(address)
        except NavigationFailed:
            if address == addresses[-1]:
                raise
        else:
            break
