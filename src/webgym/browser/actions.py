"""Carries out actions by mouse, keyboard and history (paper appendix C)."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Literal, assert_never

import msgspec

from webgym.browser.aim import aim, on_page
from webgym.browser.cdp_messages import History, HistoryEntry
from webgym.browser.chords import chord, keys_of
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.keyboard import BACKSPACE, ENTER, PROCESS, Key, key_of, split_input
from webgym.browser.page import BLANK, Page, Returned
from webgym.browser.pointer import Point, click, drag, hold, holding, mouse, press, scroll, send_keys
from webgym.browser.settle import settle
from webgym.browser.upload import upload
from webgym.core.action import (
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
    Type,
    Upload,
    Wait,
    typed_addresses,
)
from webgym.core.errors import ActionFailed, NavigationFailed

_ARROWS = ("ArrowRight", "ArrowLeft", "ArrowUp", "ArrowDown")
_FAR = 50
"""Number of presses of an arrow key above which Page Up or Page Down is tried. If the slider ignores it, the
page scrolls."""
_MOST_READS = 40
"""Most times that the value is read, for a slider that moves by itself or by steps of many sizes."""
_PRECISION = 1e-6
"""Relative difference up to which two values are equal, as pages round them."""

TYPED_KEYS = 200
"""A text of up to this many characters is typed key by key, because fields may handle key events. A key costs
about 1 ms of CPU, as much as inserting a whole text, so a longer text is inserted except for its last
character, which is typed. Also the longest text for an element that handles keys but is no field, such as a
game board."""
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
        wanted, value, share: as in :func:`slide`.
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
            point = await aim(page, target)
            async with holding(page, modifiers) as bits:
                await click(page, point, modifiers=bits)
        case DoubleClick(target=target):
            await click(page, await aim(page, target), count=2)
        case RightClick(target=target):
            await click(page, await aim(page, target), button="right")
        case Hover(target=target):
            await _hover(page, await aim(page, target))
        case Hold(target=target, time=seconds):
            await hold(page, await aim(page, target), _bounded(seconds))
        case Drag(start=start, target=target, path=path, time=seconds):
            between = [on_page(page, point) for point in path]
            await drag(page, [await aim(page, start), *between, await aim(page, target)], _bounded(seconds))
        case Type(target=target, text=text, enter=enter):
            await type_at(page, await aim(page, target), text, enter=enter)
        case Press(keys=keys):
            await press(page, keys)
        case Scroll(direction=direction, target=target):
            await scroll(page, direction, None if target is None else await aim(page, target))
        case Upload(target=target, files=names):
            await upload(page, await aim(page, target), names)
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


async def _hover(page: Page, point: Point) -> None:
    await mouse(page, "mouseMoved", point)
    with contextlib.suppress(DocumentGone):
        if tooltip := await page.run("tooltip", *point, reply=str):
            page.note("browser", f'a tooltip "{tooltip}"')


def _bounded(seconds: float) -> float:
    return max(0.0, min(seconds, MAX_WAIT_SECONDS))


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
            await _tell_refused(page, text, field)
        case "text" if (field.filled or field.stands) and replace:
            await _press(page, BACKSPACE)
    if enter:
        await _press(page, ENTER)


async def _tell_refused(page: Page, text: str, field: _Field) -> None:
    """Add a notice if the field has not taken a text."""
    with contextlib.suppress(DocumentGone):
        if why := await page.run("refusal", text, reply=str, frame=field.frame):
            page.note("action_failed", why)


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


# --- sliders, moved by keys ----------------------------------------------------------------------------


class _Told(msgspec.Struct, frozen=True):
    """What the page tells of the value of a slider."""

    value: float | None = None


class _Slider:
    """The focused slider: its value, and by how much each key that was pressed changes it."""

    def __init__(self, page: Page, value: float | None, frame: str | None) -> None:
        self.page = page
        self.value = value
        self.frame = frame
        self.steps: dict[str, float] = {}
        self.keys_left = TYPED_KEYS
        self.reads_left = _MOST_READS

    async def press(self, name: str, count: int = 1) -> None:
        """Press a key several times, and read the value.

        Raises:
            ActionFailed: the document is gone.
        """
        count = min(count, self.keys_left)
        self.keys_left -= count
        self.reads_left -= 1
        before = self.value
        await send_keys(self.page, chord(keys_of((name,))) * count)
        try:
            told = await self.page.run("readSlider", before, reply=_Told, frame=self.frame)
        except DocumentGone:
            raise ActionFailed("another page opened while the slider was moved") from None
        self.value = told.value
        if before is not None and self.value is not None:
            self.steps[name] = (self.value - before) / count

    def next_presses(self, wanted: float) -> tuple[str, int] | None:
        """The key that brings the value nearer, and how often to press it; ``None`` if nothing does."""
        if self.value is None or not (self.keys_left and self.reads_left):
            return None
        distance = wanted - self.value
        if abs(distance) <= _PRECISION * max(1.0, abs(wanted)):
            return None
        known = {name: step / distance for name, step in self.steps.items() if step * distance > 0}
        fitting = {
            name: max(1, int((1 + _PRECISION) / share))
            for name, share in known.items()
            if share <= 1 + _PRECISION
        }
        name = min(fitting, key=fitting.__getitem__, default=None)
        if name is None or fitting[name] > _FAR:
            for untried in self._candidates(distance, arrows=not known):
                if untried not in self.steps:
                    return untried, 1
        if name is not None:
            return name, fitting[name]
        nearest = min(known, key=known.__getitem__, default=None)
        return (nearest, 1) if nearest is not None and known[nearest] < 2 * (1 - _PRECISION) else None

    def _candidates(self, distance: float, *, arrows: bool) -> tuple[str, ...]:
        """Keys that may change the value in the direction of a distance."""
        right, left, up, down = _ARROWS
        if not arrows:
            return ("PageUp" if distance > 0 else "PageDown",)
        first, opposite, second = (right, left, up) if distance > 0 else (left, right, down)
        is_mirrored = self.steps.get(first, 0) * distance < 0
        return (first, opposite, second) if is_mirrored else (first, second)


async def slide(page: Page, wanted: float, value: float | None, *, share: bool, frame: str | None) -> None:
    """Move the focused slider to a value by keys, as near as its steps lead, by ``typed_keys`` keys at most.

    Args:
        page: the page.
        wanted: the requested value.
        value: the current value; ``None`` if the page tells it only when it changes.
        share: whether both are positions of the handle on its track, in percent.
        frame: the frame of another origin that the slider is in; ``None`` if it is in none.

    Raises:
        ActionFailed: the slider has another value than the requested one; the message contains it. Or
            the document is gone.
    """
    slider = _Slider(page, value, frame)
    for name in _ARROWS if value is None else ():
        await slider.press(name)
        if slider.value is not None:
            break
    while presses := slider.next_presses(wanted):
        await slider.press(*presses)
    if slider.value is None:
        raise ActionFailed(
            "nothing on the page tells the value of this slider; write where its handle shall be, such as 40%"
        )
    if abs(wanted - slider.value) > _PRECISION * max(1.0, abs(wanted)):
        why = "" if any(slider.steps.values()) else ", and does not react to keys"
        unit = " % of its track" if share else ""
        raise ActionFailed(f"the slider is at {slider.value:g}{unit}, not at {wanted:g}{unit}{why}")
