"""From a command of their clients to actions, gestures and readings of ours.

Points are pixels of the viewport. Ids are the numbers of marks, as strings or integers. What a page refuses
is an error where it keeps the command from being carried out, and none where it only happened meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterable
from typing import Any, TypeAlias

import msgspec

from webgym.browser.chords import keys_of
from webgym.browser.document import ReadRequest
from webgym.browser.gestures import (
    AnyAction,
    Choose,
    Click,
    Fill,
    HoverAndScroll,
    ScrollElement,
    Wheel,
)
from webgym.core.action import (
    MAX_WAIT_SECONDS,
    Direction,
    GoBack,
    Hover,
    Navigate,
    Press,
    Side,
    Target,
    Wait,
)
from webgym.core.errors import PageError, ProtocolError
from webgym.core.observation import NoticeKind
from webgym.server.client import Session
from webgym.server.compat.config import CompatConfig
from webgym.server.compat.instances import VIEWPORT, Instance
from webgym.server.compat.regions import Json, regions_of, screenshot_info

MARKS = "set_of_marks"
"""The ``interaction_mode`` with marks; any other is without."""

_PAGE_MARGIN = 50
"""Pixels of the viewport that stay in view when a whole page is scrolled."""

_UNTITLED = "Unknown Page"
"""What their clients take for a page that has not loaded yet."""


class BadCommand(ProtocolError):
    """A command that is none, or whose arguments make no sense."""

    code = "compat_bad_command"


class CommandRefused(PageError):
    """A page kept a command from being carried out."""

    code = "compat_command_refused"


# --- arguments ----------------------------------------------------------------------------------------


class _None(msgspec.Struct, frozen=True):
    pass


class _Url(msgspec.Struct, frozen=True):
    url: str


class _Point(msgspec.Struct, frozen=True):
    x: float
    y: float

    @property
    def target(self) -> Target:
        width, height = VIEWPORT
        if not (0 <= self.x <= width and 0 <= self.y <= height):
            raise BadCommand(f"x = {self.x:g}, y = {self.y:g} lies outside of the {width}x{height} viewport")
        return Target(coordinate=(self.x / width * 1000, self.y / height * 1000))


class _Id(msgspec.Struct, frozen=True):
    id: int | str

    @property
    def number(self) -> int:
        try:
            return int(self.id)
        except ValueError:
            raise BadCommand(f'there is no element "{str(self.id)[:40]}": ids are numbers') from None

    @property
    def target(self) -> Target:
        return Target(element=self.number)


class _FillPoint(_Point, frozen=True):
    value: str
    press_enter: bool = True
    delete_existing: bool = False


class _FillId(_Id, frozen=True):
    value: str
    press_enter: bool = True
    delete_existing: bool = False


class _ScrollPoint(_Point, frozen=True):
    direction: str = "down"


class _ScrollId(_Id, frozen=True):
    direction: str


class _Amount(msgspec.Struct, frozen=True):
    amount: float = 200
    full_page: bool = False

    @property
    def distance(self) -> float:
        if not math.isfinite(self.amount):
            raise BadCommand("amount is a number of pixels")
        return VIEWPORT[1] - _PAGE_MARGIN if self.full_page else self.amount


class _Keys(msgspec.Struct, frozen=True):
    keys: list[str] | str


class _Duration(msgspec.Struct, frozen=True):
    duration: float


class _Lines(msgspec.Struct, frozen=True):
    n_lines: int = 100


class _Picture(msgspec.Struct, frozen=True):
    interaction_mode: str = MARKS


# --- commands that act --------------------------------------------------------------------------------

Actions: TypeAlias = AnyAction | Iterable[AnyAction]


class _Deed(msgspec.Struct, frozen=True):
    """A command that acts.

    Attributes:
        shape: of its arguments.
        actions: what is carried out, one after the other.
        fails_on: notices that mean that it was not.
    """

    shape: type[msgspec.Struct]
    actions: Callable[[Any, CompatConfig], Actions]
    fails_on: frozenset[NoticeKind] = frozenset()


_REFUSED: frozenset[NoticeKind] = frozenset({"action_failed"})
_UNOPENED: frozenset[NoticeKind] = frozenset({"navigation_failed", "download_refused"})


def _upright(direction: str) -> Direction:
    match direction.lower():
        case "up":
            return "up"
        case "down":
            return "down"
    raise BadCommand(f'direction is "up" or "down", not "{direction[:40]}"')


def _side(direction: str) -> Side:
    match direction.lower():
        case "left":
            return "left"
        case "right":
            return "right"
    return _upright(direction)


def _fill(given: _FillPoint | _FillId, _: CompatConfig) -> Fill:
    return Fill(given.target, given.value, given.press_enter, given.delete_existing)


def _press(given: _Keys, _: CompatConfig) -> Press:
    names = (given.keys,) if isinstance(given.keys, str) else tuple(given.keys)
    try:
        keys_of(names)
        return Press(names)
    except ValueError as error:
        raise BadCommand(str(error)) from None


def _sleep(given: _Duration, config: CompatConfig) -> Iterable[AnyAction]:
    if not given.duration >= 0:
        raise BadCommand("duration is a number of seconds")
    left = min(given.duration, config.sleep_seconds)
    return [
        Wait(min(MAX_WAIT_SECONDS, left - n * MAX_WAIT_SECONDS))
        for n in range(math.ceil(left / MAX_WAIT_SECONDS))
    ]


def _hover_and_scroll(given: _ScrollPoint, _: CompatConfig) -> HoverAndScroll:
    return HoverAndScroll(given.target, _upright(given.direction))


_DEEDS = {
    "visit_page": _Deed(_Url, lambda given, _: Navigate(given.url), _UNOPENED),
    "back": _Deed(_None, lambda *_: GoBack(), frozenset({"navigation_failed"})),
    "click_coords": _Deed(_Point, lambda given, _: Click(given.target)),
    "click_id": _Deed(_Id, lambda given, _: Click(given.target), _REFUSED),
    "fill_coords": _Deed(_FillPoint, _fill, _REFUSED),
    "fill_id": _Deed(_FillId, _fill, _REFUSED),
    "select_option": _Deed(_Id, lambda given, _: Choose(given.number), _REFUSED),
    "hover_id": _Deed(_Id, lambda given, _: Hover(given.target), _REFUSED),
    "hover_coords": _Deed(_Point, lambda given, _: Hover(given.target)),
    "hover_and_scroll_coords": _Deed(_ScrollPoint, _hover_and_scroll),
    "scroll_coords": _Deed(_ScrollPoint, _hover_and_scroll),
    "scroll_id": _Deed(
        _ScrollId, lambda given, _: ScrollElement(given.number, _side(given.direction)), _REFUSED
    ),
    "page_down": _Deed(_Amount, lambda given, _: Wheel(given.distance)),
    "page_up": _Deed(_Amount, lambda given, _: Wheel(-given.distance)),
    "keypress": _Deed(_Keys, _press),
    "sleep": _Deed(_Duration, _sleep),
    "tab_and_enter": _Deed(_None, lambda *_: (Press(("Tab",)), Press(("Enter",)))),
}
"""``scroll_coords`` is sent by their client for a scroll at a point, and known to none of their servers."""


# --- commands that read -------------------------------------------------------------------------------


async def picture(instance: Instance, session: Session, interaction_mode: str) -> bytes:
    """The viewport as PNG, with marks or without. What marks show is kept for ``get_screenshot_info``."""
    if interaction_mode != MARKS:
        return await session.screenshot()
    document = await session.read(ReadRequest(elements=True))
    view = await session.step()
    instance.shown = screenshot_info(view.observation.elements or (), document.elements, VIEWPORT)
    return view.image


async def _text(_: Instance, session: Session, given: _Lines) -> Json:
    return {"text": (await session.read(ReadRequest(lines=max(0, given.n_lines)))).text}


async def _metadata(_: Instance, session: Session, __: _None) -> Json:
    document = await session.read(ReadRequest(meta=True))
    told: Json = {"title": document.title.strip() or _UNTITLED, "url": document.url}
    if document.linked:
        parsed = [_parsed(text) for text in document.linked]
        told["jsonld"] = parsed[0] if len(parsed) == 1 else parsed
    if document.meta:
        told["meta_tags"] = document.meta
    if document.items:
        told["microdata"] = document.items
    return told


def _parsed(text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError):  # not JSON, cut, or nested beyond reason
        return text


async def _rects(_: Instance, session: Session, __: _None) -> Json:
    return regions_of((await session.read(ReadRequest(elements=True))).elements)


async def _info(instance: Instance, _: Session, __: _None) -> Json:
    return instance.shown or {"error": "no picture with marks was taken yet"}


async def _screenshot(instance: Instance, session: Session, given: _Picture) -> Json:
    await picture(instance, session, given.interaction_mode)
    return {"status": "screenshot_taken"}


class _Reading(msgspec.Struct, frozen=True):
    """A command that reads."""

    shape: type[msgspec.Struct]
    read: Callable[[Instance, Session, Any], Awaitable[Json]]


_READINGS = {
    "get_webpage_text": _Reading(_Lines, _text),
    "get_page_metadata": _Reading(_None, _metadata),
    "get_interactive_rects": _Reading(_None, _rects),
    "get_screenshot_info": _Reading(_None, _info),
    "screenshot": _Reading(_Picture, _screenshot),
}

COMMANDS = (*_DEEDS, *_READINGS)
"""Every command by name."""


# --- one command --------------------------------------------------------------------------------------


class Command(msgspec.Struct, frozen=True):
    """A command that was understood, its actions or reading at hand."""

    name: str
    given: msgspec.Struct
    actions: tuple[AnyAction, ...] = ()

    async def run(self, instance: Instance, session: Session) -> Json:
        """Carry it out. Gives the reply.

        Raises:
            CommandRefused: the page kept it from being carried out.
        """
        if self.name in _READINGS:
            return await _READINGS[self.name].read(instance, session, self.given)
        for action in self.actions:
            if isinstance(action, Navigate):
                told = await session.navigate(action.url)
            else:
                told = await session.execute(action)
            for notice in told.notices:
                if notice.kind in _DEEDS[self.name].fails_on:
                    raise CommandRefused(notice.text)
        return {"status": "success"}


def understand(asked: dict[str, Any], config: CompatConfig) -> Command:
    """The one command of a request.

    Raises:
        BadCommand: there is none or more than one, nobody knows it, or its arguments make no sense.
    """
    if len(asked) != 1:
        names = ", ".join(sorted(asked)[:8]) or "none"
        raise BadCommand(f"a request holds exactly one command, not {len(asked)} ({names})")
    [(name, arguments)] = asked.items()
    known: _Deed | _Reading | None = _DEEDS.get(name) or _READINGS.get(name)
    if known is None:
        raise BadCommand(f'unsupported command "{name[:40]}"', hint=f"there are {', '.join(COMMANDS)}")
    try:
        given = msgspec.convert(arguments or {}, known.shape, strict=False)
    except msgspec.ValidationError as error:
        raise BadCommand(f"{name}: {error}") from None
    if isinstance(known, _Reading):
        return Command(name, given)
    actions = known.actions(given, config)
    return Command(name, given, tuple(actions) if isinstance(actions, Iterable) else (actions,))
