"""What an agent can do, in two interaction modes and two action spaces.

In *coordinates* mode a target is a point on a 0-1000 grid over the viewport, whatever its size in
pixels. In *marks* mode (Set-of-Marks) a target is the number drawn on an element.

The *paper* space has the paper's seven actions (§5, appendix C), each with its required fields only. The
*extended* space has every action here, with all of its fields.

An action is added here, and carried out in :func:`webgym.browser.actions.perform`, as the type checker
demands. Prompt, parser, server, histories and pages derive the rest from these types.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final, Literal, TypeAlias, TypeGuard, get_args

import msgspec

GRID = 1000
"""Coordinates run from 0 to this, left to right and top to bottom (Qwen3-VL's convention)."""

Mode: TypeAlias = Literal["coordinates", "marks"]
Space: TypeAlias = Literal["paper", "extended"]
Direction: TypeAlias = Literal["up", "down"]
Side: TypeAlias = Literal["up", "down", "left", "right"]
Modifier: TypeAlias = Literal["Alt", "Control", "Meta", "Shift"]

MAX_WAIT_SECONDS = 10.0
"""The longest ``wait`` that is carried out; longer ones are shortened to it."""

MAX_WAY_POINTS = 100
"""The most points in the path of a ``drag``."""


class Target(msgspec.Struct, frozen=True, omit_defaults=True):
    """Where an action lands: exactly one of a grid point or an element number.

    Attributes:
        coordinate: ``(x, y)`` on the 0-1000 grid.
        element: the number of a marked element in the observation that the agent saw.

    Raises:
        ValueError: neither or both are given, or the point is off the grid.
    """

    coordinate: tuple[float, float] | None = None
    element: int | None = None

    def __post_init__(self) -> None:
        if (self.coordinate is None) == (self.element is None):
            raise ValueError("a target is either a coordinate or an element number")
        if self.coordinate is not None:
            _check_on_grid(self.coordinate)


def _check_on_grid(point: tuple[float, float]) -> None:
    if not all(0 <= value <= GRID for value in point):
        raise ValueError(f"a coordinate lies between 0 and {GRID}")


class _Action(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="name"):
    """Base of all actions. A field that has its default is not written, so that records of the paper's space
    are the same whatever fields the extended space adds.

    Attributes:
        does: what the prompt says of the action, with ``{target}`` and ``{start}`` for places.
        does_extended: the same in the extended space, if that has more fields.
        did: what was done, in words of the past, with its fields.
        did_also: words to add if a field has another value than its default.
        joint: what stands between keys, or files, in words.
    """

    does: ClassVar[str]
    does_extended: ClassVar[str] = ""
    did: ClassVar[str]
    did_also: ClassVar[Mapping[str, str]] = {}
    joint: ClassVar[str] = "+"

    @property
    def targets(self) -> tuple[Target, ...]:
        """Where it lands, in the order in which the mouse gets there."""
        values = (getattr(self, name) for name in self.__struct_fields__)
        return tuple(value for value in values if isinstance(value, Target))

    @property
    def entered(self) -> str:
        """What the agent wrote or chose: a text, address, keys, files or direction; empty without any."""
        values = (getattr(self, name) for name in self.__struct_fields__)
        texts = (self.joint.join(value) if _is_texts(value) else value for value in values)
        return next((text for text in texts if isinstance(text, str)), "")

    def told(self, named: Callable[[Target], str]) -> str:
        """What was done, in words of the past.

        Args:
            named: the words for a target.
        """
        values = {name: getattr(self, name) for name in self.__struct_fields__}
        words = {name: self._in_words(value, named) for name, value in values.items()}
        # The last fields have defaults. msgspec.structs.fields gives them, too, a hundred times slower.
        defaults = zip(reversed(self.__struct_fields__), reversed(self.__struct_defaults__), strict=False)
        unchanged = {name for name, default in defaults if values[name] == default}
        also = (text for name, text in self.did_also.items() if name not in unchanged)
        return "".join((self.did, *also)).format_map(words)

    def _in_words(self, value: object, named: Callable[[Target], str]) -> str:
        if isinstance(value, Target):
            return named(value)
        if isinstance(value, tuple):
            return self.joint.join(value) if _is_texts(value) else str(len(value))
        return f"{value:g}" if isinstance(value, float) else str(value)


def _is_texts(value: object) -> TypeGuard[tuple[str, ...]]:
    return isinstance(value, tuple) and all(isinstance(part, str) for part in value)


class LeftClick(_Action, frozen=True, tag="left_click"):
    """Press and release the left mouse button on the target.

    Attributes:
        target: where to click.
        modifiers: keys that are held down during the click.
    """

    does = "click {target}."
    does_extended = "click {target}, with the keys `modifiers` held down if there are any."
    did = "clicked {target}"
    did_also = {"modifiers": " with {modifiers} held"}

    target: Target
    modifiers: tuple[Modifier, ...] = ()


class Type(_Action, frozen=True, tag="type"):
    """Click the target, clear it, type the text, press Enter.

    Attributes:
        target: the field to type into.
        text: what to type; it replaces what the field holds.
        enter: whether Enter is pressed afterwards.
    """

    does = "click {target}, clear the field, type `text` into it and press Enter."
    does_extended = "click {target}, clear the field, type `text` and press Enter, unless `enter` is false."
    did = 'typed "{text}" into {target}'
    did_also = {"enter": " without Enter"}

    target: Target
    text: str
    enter: bool = True


class Scroll(_Action, frozen=True, tag="scroll"):
    """Turn the mouse wheel.

    Attributes:
        direction: where the view moves: ``down`` shows what is below. ``left`` and ``right`` belong to the
            extended space.
        target: where the mouse is meanwhile; by default in the middle of the viewport.
    """

    does = "scroll the page `direction`, which is up or down, by most of a screen."
    does_extended = (
        "scroll `direction` by most of what is shown: the box at {target} if given, else the page."
    )
    did = "scrolled {direction}"
    did_also = {"target": " at {target}"}

    direction: Side
    target: Target | None = None


class Wait(_Action, frozen=True, tag="wait"):
    """Let the page go on for a while.

    Attributes:
        time: seconds; longer than :data:`MAX_WAIT_SECONDS` counts as that.
    """

    does = f"wait `time` seconds for the page to change, at most {MAX_WAIT_SECONDS:g}."
    did = "waited {time} s"

    time: float


class GoBack(_Action, frozen=True, tag="go_back"):
    """Go one entry back in the tab's history."""

    does = "go back to the previous page."
    did = "went back"


class Navigate(_Action, frozen=True, tag="navigate"):
    """Open a URL in the tab.

    Attributes:
        url: absolute, http or https.
    """

    does = "open `url` in the tab."
    did = "opened {url}"

    url: str


class Answer(_Action, frozen=True, tag="answer"):
    """End the attempt. Never sent to a browser.

    Attributes:
        text: the answer, which the judge reads; an empty one is refused when it is played.
    """

    does = "end the task and give the user `text`, the final answer."
    did = "gave its answer"

    text: str


class DoubleClick(_Action, frozen=True, tag="double_click"):
    """Click the target twice in a row."""

    does = "click {target} twice in a row."
    did = "double-clicked {target}"

    target: Target


class RightClick(_Action, frozen=True, tag="right_click"):
    """Press and release the right mouse button on the target."""

    does = "click {target} with the right mouse button."
    did = "right-clicked {target}"

    target: Target


class Hover(_Action, frozen=True, tag="hover"):
    """Move the mouse to the target and leave it there."""

    does = "move the mouse to {target} and leave it there, so that a menu or a hint opens."
    did = "moved the mouse to {target}"

    target: Target


class Hold(_Action, frozen=True, tag="hold"):
    """Press the left mouse button on the target, and release it after a while.

    Attributes:
        time: seconds; longer than :data:`MAX_WAIT_SECONDS` counts as that.
    """

    does = "press the mouse button at {target} and let go after `time` seconds, 1 by default."
    did = "held the mouse button down on {target} for {time} s"

    target: Target
    time: float = 1.0


class Drag(_Action, frozen=True, tag="drag"):
    """Press the left mouse button at the start, move to the target, release it there.

    Attributes:
        path: points on the 0-1000 grid to pass on the way, for a drag that is not a straight line.
        time: seconds to keep the button down before it moves, as for :class:`Hold`.

    Raises:
        ValueError: a point is off the grid, or there are more than ``MAX_WAY_POINTS``.
    """

    does = (
        "press the mouse button at {start}, wait `time` seconds if given, move to {target}, through the "
        "points `path` if there are any, and let go there."
    )
    did = "dragged {start} to {target}"
    did_also = {"path": " through {path} points", "time": " after {time} s"}

    start: Target
    target: Target
    path: tuple[tuple[float, float], ...] = ()
    time: float = 0.0

    def __post_init__(self) -> None:
        if len(self.path) > MAX_WAY_POINTS:
            raise ValueError(f"a path has at most {MAX_WAY_POINTS} points")
        for point in self.path:
            _check_on_grid(point)


class Press(_Action, frozen=True, tag="press"):
    """Press keys together: down in this order, up in the reverse one.

    Attributes:
        keys: names of :mod:`webgym.browser.chords`; ``("Control", "a")`` means the same as
            ``("Control+a",)``.

    Raises:
        ValueError: no key is named.
    """

    does = "press the keys `keys` together, wherever the focus is."
    did = "pressed {keys}"

    keys: tuple[str, ...]

    def __post_init__(self) -> None:
        if not all(key.strip() or key == " " for key in self.keys) or not self.keys:
            raise ValueError("no key is named")


class Upload(_Action, frozen=True, tag="upload"):
    """Click the target, which opens a file chooser, and choose these files; if none opens, drop them there.

    Attributes:
        files: names of files that the task comes with; no others can be chosen.

    Raises:
        ValueError: no file is named.
    """

    does = (
        "click {target}, which asks for a file, and choose `files`, by the names of the task's files; where "
        "nothing asks, they are dropped there."
    )
    joint = ", "
    did = "chose the files {files} at {target}"

    target: Target
    files: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.files:
            raise ValueError("no file is named")


class AnswerDialog(_Action, frozen=True, tag="answer_dialog"):
    """Answer a question of the page (``confirm``, ``prompt``, before it is left) that stays open.

    Attributes:
        accept: whether to press OK rather than Cancel.
        text: what to enter into a prompt; by default what stands in it.
    """

    does = (
        "answer a dialog that is open: with OK, or with Cancel if `accept` is false; `text` is what a prompt "
        "is answered."
    )
    did = "answered the dialog"
    did_also = {"accept": " with Cancel", "text": ' with "{text}"'}

    accept: bool = True
    text: str | None = None


BrowserAction: TypeAlias = (
    LeftClick
    | Type
    | Scroll
    | Wait
    | GoBack
    | Navigate
    | DoubleClick
    | RightClick
    | Hover
    | Drag
    | Hold
    | Press
    | Upload
    | AnswerDialog
)
"""The actions that a browser carries out."""

Action: TypeAlias = BrowserAction | Answer

_PAPER: Final[tuple[type[Action], ...]] = (LeftClick, Type, Scroll, Wait, GoBack, Navigate, Answer)
_EXTENDED: Final[tuple[type[Action], ...]] = (
    LeftClick,
    DoubleClick,
    RightClick,
    Hover,
    Drag,
    Hold,
    Type,
    Press,
    Scroll,
    Upload,
    AnswerDialog,
    Wait,
    GoBack,
    Navigate,
    Answer,
)
DIRECTIONS: Final[dict[Space, tuple[Side, ...]]] = {"paper": get_args(Direction), "extended": get_args(Side)}
"""The directions in which a page can be scrolled, by action space."""


_SCHEMES: Final = ("http://", "https://")
_OTHER_SCHEMES: Final = frozenset(
    {"about", "blob", "chrome", "data", "file", "ftp", "javascript", "mailto", "view-source"}
)


def typed_addresses(text: str) -> tuple[str, ...]:
    """The URLs to try for the address that an agent gave, as an address bar does: https first if it has no
    scheme. Empty if it has another scheme than http and https."""
    address = text.strip()
    if address.lower().startswith(_SCHEMES):
        return (address,)
    if not address or "://" in address or address.split(":")[0].lower() in _OTHER_SCHEMES:
        return ()
    return (f"https://{address}", f"http://{address}")


def name_of(action: Action) -> str:
    """The action's name in prompts, replies and records."""
    return str(type(action).__struct_config__.tag)


def actions_of(space: Space) -> dict[str, type[Action]]:
    """The actions of a space by name, in the order in which the prompt lists them."""
    chosen = _PAPER if space == "paper" else _EXTENDED
    return {str(action.__struct_config__.tag): action for action in chosen}


def tool_text(action: type[Action], space: Space) -> str:
    """What the prompt says of an action in a space, with ``{target}`` and ``{start}`` for places."""
    return (space == "extended" and action.does_extended) or action.does


def fields_of(action: type[Action], space: Space) -> dict[str, Any]:
    """The fields of an action in a space, with their defaults; ``msgspec.NODEFAULT`` for a required field. In
    the paper's space, actions have their required fields only."""
    fields = {field.name: field.default for field in msgspec.structs.fields(action)}
    return {
        name: default
        for name, default in fields.items()
        if space == "extended" or default is msgspec.NODEFAULT
    }
