"""Translates commands of the authors' clients into actions, gestures and readings.

Points are pixels of the viewport. Ids are the numbers of marks, as strings or integers. A notice of the page
is an error if it means that the command was not carried out, and is ignored otherwise. The marks on a
screenshot have the ids of the elements, so that the clients' mapping from drawn ids to element ids is the
identity.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterable
from typing import Any, TypeAlias

import msgspec

from webgym.browser.chords import keys_of
from webgym.browser.document import DocumentElement, ReadRequest
from webgym.browser.gestures import (
    AnyAction,
    Choose,
    Click,
    Fill,
    HoverAndScroll,
    HoverOver,
    ScrollElement,
    Wheel,
)
from webgym.compat.instances import VIEWPORT, Instance
from webgym.core.action import MAX_WAIT_SECONDS, Direction, GoBack, Navigate, Press, Side, Target, Wait
from webgym.core.errors import PageError, ProtocolError
from webgym.core.observation import Element, NoticeKind
from webgym.server.client import Session

Json = dict[str, Any]

MARKS = "set_of_marks"
"""The ``interaction_mode`` with marks; any other mode has none."""

_PAGE_MARGIN = 50
"""Pixels of the viewport that stay in view when a whole page is scrolled."""

_UNTITLED = "Unknown Page"
"""The title by which the authors' clients recognise a page that has not loaded yet."""

SLEEP_SECONDS = 60.0
"""The longest ``sleep`` that is carried out; longer ones are shortened to it."""


_TAG_OF_ROLE = {"link": "a", "textbox": "input, type=text", "combobox": "select", "option": "option"}
"""Tag by role, for elements in frames of another origin, which are missing when the document is read."""


class BadCommand(ProtocolError):
    """A command is unknown, or its arguments are invalid."""

    code = "compat_bad_command"


class CommandRefused(PageError):
    """A command could not be carried out on the page."""

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


class _ActionCommand(msgspec.Struct, frozen=True):
    """A command that acts on the page.

    Attributes:
        shape: type of its arguments.
        actions: returns the action, or several to carry out one after the other.
        fails_on: kinds of notices that mean that it was not carried out.
    """

    shape: type[msgspec.Struct]
    actions: Callable[[Any], Actions]
    fails_on: frozenset[NoticeKind] = frozenset()


_ON_ACTION_FAILED: frozenset[NoticeKind] = frozenset({"action_failed"})
_ON_NOT_OPENED: frozenset[NoticeKind] = frozenset({"navigation_failed", "download_refused"})


def _vertical(direction: str) -> Direction:
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
    return _vertical(direction)


def _fill(arguments: _FillPoint | _FillId) -> Fill:
    return Fill(arguments.target, arguments.value, arguments.press_enter, arguments.delete_existing)


def _press(arguments: _Keys) -> Press:
    names = (arguments.keys,) if isinstance(arguments.keys, str) else tuple(arguments.keys)
    try:
        keys_of(names)
        return Press(names)
    except ValueError as error:
        raise BadCommand(str(error)) from None


def _sleep(arguments: _Duration) -> Iterable[AnyAction]:
    if not arguments.duration >= 0:
        raise BadCommand("duration is a number of seconds")
    remaining = min(arguments.duration, SLEEP_SECONDS)
    return [
        Wait(min(MAX_WAIT_SECONDS, remaining - n * MAX_WAIT_SECONDS))
        for n in range(math.ceil(remaining / MAX_WAIT_SECONDS))
    ]


def _hover_and_scroll(arguments: _ScrollPoint) -> HoverAndScroll:
    return HoverAndScroll(arguments.target, _vertical(arguments.direction))


_ACTION_COMMANDS = {
    "visit_page": _ActionCommand(_Url, lambda args: Navigate(args.url), _ON_NOT_OPENED),
    "back": _ActionCommand(_None, lambda _: GoBack(), frozenset({"navigation_failed"})),
    "click_coords": _ActionCommand(_Point, lambda args: Click(args.target)),
    "click_id": _ActionCommand(_Id, lambda args: Click(args.target), _ON_ACTION_FAILED),
    "fill_coords": _ActionCommand(_FillPoint, _fill, _ON_ACTION_FAILED),
    "fill_id": _ActionCommand(_FillId, _fill, _ON_ACTION_FAILED),
    "select_option": _ActionCommand(_Id, lambda args: Choose(args.number), _ON_ACTION_FAILED),
    "hover_id": _ActionCommand(_Id, lambda args: HoverOver(args.target), _ON_ACTION_FAILED),
    "hover_coords": _ActionCommand(_Point, lambda args: HoverOver(args.target)),
    "hover_and_scroll_coords": _ActionCommand(_ScrollPoint, _hover_and_scroll),
    "scroll_coords": _ActionCommand(_ScrollPoint, _hover_and_scroll),
    "scroll_id": _ActionCommand(
        _ScrollId, lambda args: ScrollElement(args.number, _side(args.direction)), _ON_ACTION_FAILED
    ),
    "page_down": _ActionCommand(_Amount, lambda args: Wheel(args.distance)),
    "page_up": _ActionCommand(_Amount, lambda args: Wheel(-args.distance)),
    "keypress": _ActionCommand(_Keys, _press),
    "sleep": _ActionCommand(_Duration, _sleep),
    "tab_and_enter": _ActionCommand(_None, lambda _: (Press(("Tab",)), Press(("Enter",)))),
}
"""``scroll_coords`` is sent by the authors' client for a scroll at a point, but supported by none of their
servers."""


# --- elements, as the clients take them --------------------------------------------------------------


def regions_of(elements: Iterable[DocumentElement]) -> dict[str, Json]:
    """Elements by id."""
    regions: dict[str, Json] = {}
    for element in elements:
        tag = f"{element.tag}, type={element.type}" if element.type else element.tag
        region = _region(tag, element.role, element.name, element.scrolls, element.boxes)
        regions[str(element.number)] = region
    return regions


def screenshot_info(
    marked: Iterable[Element], elements: Iterable[DocumentElement], viewport: tuple[int, int]
) -> Json:
    """The elements on a screenshot with marks, and those above and below the viewport.

    Options of dropdowns always count as visible: no screenshot shows them, but they can be chosen.
    """
    elements = tuple(elements)
    regions = regions_of(elements)
    visible = []
    for mark in marked:
        visible.append(str(mark.number))
        if str(mark.number) not in regions:
            tag = _TAG_OF_ROLE.get(mark.role, mark.role)
            regions[str(mark.number)] = _region(tag, mark.role, mark.name, False, (mark.box,))
    shown = set(visible)
    visible += [str(it.number) for it in elements if it.tag == "option" and str(it.number) not in shown]
    above, below = [], []
    width, height = viewport
    for element in elements:
        if str(element.number) in shown or not element.boxes:
            continue
        x, y, wide, tall = element.boxes[0]
        if 0 <= x + wide / 2 < width:
            if y + tall / 2 < 0:
                above.append(str(element.number))
            elif y + tall / 2 >= height:
                below.append(str(element.number))
    return {
        "visible_rects": visible,
        "rects_above": above,
        "rects_below": below,
        "interactive_regions": regions,
        "id_mapping": {number: number for number in (*visible, *above, *below)},
    }


def _region(tag: str, role: str, name: str, scrolls: bool, boxes: Iterable[tuple[float, ...]]) -> Json:
    return {
        "tag_name": tag,
        "role": role,
        "aria_name": name,
        "v_scrollable": scrolls,
        "rects": [
            {
                "x": x,
                "y": y,
                "width": width,
                "height": height,
                "top": y,
                "right": x + width,
                "bottom": y + height,
                "left": x,
            }
            for x, y, width, height in boxes
        ],
    }


# --- commands that read -------------------------------------------------------------------------------


async def picture(instance: Instance, session: Session, interaction_mode: str) -> bytes:
    """The viewport as PNG, with or without marks. The marked elements are stored for
    ``get_screenshot_info``."""
    if interaction_mode != MARKS:
        return await session.screenshot()
    document = await session.read(ReadRequest(elements=True))
    view = await session.step()
    instance.shown = screenshot_info(view.observation.elements or (), document.elements, VIEWPORT)
    return view.image


async def _text(_: Instance, session: Session, arguments: _Lines) -> Json:
    return {"text": (await session.read(ReadRequest(lines=max(0, arguments.n_lines)))).text}


async def _metadata(_: Instance, session: Session, __: _None) -> Json:
    document = await session.read(ReadRequest(meta=True))
    result: Json = {"title": document.title.strip() or _UNTITLED, "url": document.url}
    if document.linked:
        parsed = [_parsed(text) for text in document.linked]
        result["jsonld"] = parsed[0] if len(parsed) == 1 else parsed
    if document.meta:
        result["meta_tags"] = document.meta
    if document.items:
        result["microdata"] = document.items
    return result


def _parsed(text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError):  # not JSON, truncated, or nested too deeply
        return text


async def _rects(_: Instance, session: Session, __: _None) -> Json:
    return regions_of((await session.read(ReadRequest(elements=True))).elements)


async def _info(instance: Instance, _: Session, __: _None) -> Json:
    return instance.shown or {"error": "no picture with marks was taken yet"}


async def _screenshot(instance: Instance, session: Session, arguments: _Picture) -> Json:
    await picture(instance, session, arguments.interaction_mode)
    return {"status": "screenshot_taken"}


class _ReadCommand(msgspec.Struct, frozen=True):
    """A command that reads the page.

    Attributes:
        shape: type of its arguments.
        read: returns the reply.
    """

    shape: type[msgspec.Struct]
    read: Callable[[Instance, Session, Any], Awaitable[Json]]


_READ_COMMANDS = {
    "get_webpage_text": _ReadCommand(_Lines, _text),
    "get_page_metadata": _ReadCommand(_None, _metadata),
    "get_interactive_rects": _ReadCommand(_None, _rects),
    "get_screenshot_info": _ReadCommand(_None, _info),
    "screenshot": _ReadCommand(_Picture, _screenshot),
}

COMMANDS = (*_ACTION_COMMANDS, *_READ_COMMANDS)
"""Every command by name."""


# --- one command --------------------------------------------------------------------------------------


class Command(msgspec.Struct, frozen=True):
    """A parsed command.

    Attributes:
        name: its name.
        arguments: its arguments.
        actions: the actions to carry out; empty for a command that reads.
    """

    name: str
    arguments: msgspec.Struct
    actions: tuple[AnyAction, ...] = ()

    async def run(self, instance: Instance, session: Session) -> Json:
        """Carry it out, and return the reply.

        Raises:
            CommandRefused: it could not be carried out on the page.
        """
        if self.name in _READ_COMMANDS:
            return await _READ_COMMANDS[self.name].read(instance, session, self.arguments)
        for action in self.actions:
            if isinstance(action, Navigate):
                metadata = await session.navigate(action.url)
            else:
                metadata = await session.execute(action)
            for notice in metadata.notices:
                if notice.kind in _ACTION_COMMANDS[self.name].fails_on:
                    raise CommandRefused(notice.text)
        return {"status": "success"}


def parse_command(commands: dict[str, Any]) -> Command:
    """Parse the command of a request.

    Raises:
        BadCommand: there is not exactly one command, it is unknown, or its arguments are invalid.
    """
    if len(commands) != 1:
        names = ", ".join(sorted(commands)[:8]) or "none"
        raise BadCommand(f"a request contains exactly one command, not {len(commands)} ({names})")
    [(name, values)] = commands.items()
    command: _ActionCommand | _ReadCommand | None = _ACTION_COMMANDS.get(name) or _READ_COMMANDS.get(name)
    if command is None:
        raise BadCommand(f'unsupported command "{name[:40]}"', hint=f"supported are {', '.join(COMMANDS)}")
    try:
        arguments = msgspec.convert(values or {}, command.shape, strict=False)
    except msgspec.ValidationError as error:
        raise BadCommand(f"{name}: {error}") from None
    if isinstance(command, _ReadCommand):
        return Command(name, arguments)
    actions = command.actions(arguments)
    return Command(name, arguments, tuple(actions) if isinstance(actions, Iterable) else (actions,))
