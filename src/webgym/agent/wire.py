"""Actions as arguments of the ``computer_use`` tool, and back.

The names and arguments follow the computer-use convention that Qwen3-VL was trained on:
``{"action": "left_click", "coordinate": [x, y]}``. In marks mode ``element`` stands in place of
``coordinate``. Reading is strict:

- every argument that the action needs must be there, and no other (``null`` counts as absent);
- a coordinate is a list of exactly two finite numbers from 0 to 1000, or to the size of the picture where
  the model points at pixels; an element is a whole number from 0;
- a number may be written as a string of plain ASCII digits (``"512"``, ``"0.5"``), nothing looser;
- a target of the other mode is refused, never converted.
"""

from __future__ import annotations

import math
import re
from typing import Any, Final, Literal, TypeAlias

from webgym.agent.pictures import Size
from webgym.core.action import (
    GRID,
    Action,
    Answer,
    GoBack,
    LeftClick,
    Mode,
    Navigate,
    Scroll,
    Target,
    Type,
    Wait,
)

TOOL_NAME: Final = "computer_use"

ParseProblem: TypeAlias = Literal[
    "unfinished_thinking",  # the reply ended before the thinking did
    "late_thinking",  # thinking after the tool call: was the call thought or meant?
    "no_tool_call",
    "several_tool_calls",  # also one inside the other
    "unclosed_tool_call",  # cut off, or never closed
    "bad_json",
    "wrong_tool",
    "unknown_action",
    "bad_arguments",  # one is missing, superfluous or of the wrong kind
    "bad_target",  # no point on the grid, no element number
    "wrong_mode",  # a coordinate where marks are drawn, an element number where none are
]


class Refused(Exception):
    """A reply holds no action. Stays inside the room: the parser turns it into a value."""

    def __init__(self, kind: ParseProblem, message: str) -> None:
        super().__init__(message)
        self.kind: ParseProblem = kind
        self.message = message


ARGUMENTS: Final[dict[str, tuple[str, ...]]] = {
    "left_click": ("target",),
    "type": ("target", "text"),
    "scroll": ("direction",),
    "wait": ("time",),
    "go_back": (),
    "navigate": ("url",),
    "answer": ("text",),
}
"""What every action takes. ``target`` is ``coordinate`` or ``element``, by the mode."""

_TARGETS: Final[dict[Mode, str]] = {"coordinates": "coordinate", "marks": "element"}
_LARGEST_ELEMENT: Final = 2**53
"""From here on, not every whole number is one of its own once it was read."""

_NUMBER = re.compile(r"-?[0-9]{1,20}(\.[0-9]{1,20})?", re.ASCII)


def target_key(mode: Mode) -> str:
    """The name of the argument that says where an action lands."""
    return _TARGETS[mode]


def to_arguments(action: Action, screen: Size = (GRID, GRID)) -> dict[str, Any]:
    """The tool's arguments that mean this action, on a screen whose points end here."""
    match action:
        case LeftClick(target=target):
            return {"action": "left_click"} | _target_argument(target, screen)
        case Type(target=target, text=text):
            return {"action": "type"} | _target_argument(target, screen) | {"text": text}
        case Scroll(direction=direction):
            return {"action": "scroll", "direction": direction}
        case Wait(time=time):
            return {"action": "wait", "time": time}
        case GoBack():
            return {"action": "go_back"}
        case Navigate(url=url):
            return {"action": "navigate", "url": url}
        case Answer(text=text):
            return {"action": "answer", "text": text}


def _target_argument(target: Target, screen: Size) -> dict[str, Any]:
    if target.coordinate is None:
        return {"element": target.element}
    point = [_rescaled(value, GRID, side) for value, side in zip(target.coordinate, screen, strict=True)]
    return {"coordinate": [int(value) if value == int(value) else value for value in point]}


def _rescaled(value: float, old: int, new: int) -> float:
    """The same place on a side of another length; exactly the same where the lengths are the same."""
    return value if old == new else min(float(new), value * new / old)


def from_arguments(arguments: dict[str, Any], mode: Mode, screen: Size = (GRID, GRID)) -> Action:
    """The action that these arguments mean.

    Args:
        arguments: of the tool.
        mode: how a target is named.
        screen: where the points end, to the right and below.

    Raises:
        Refused: they mean none.
    """
    given = {key: value for key, value in arguments.items() if value is not None}
    name = given.pop("action", None)
    if not isinstance(name, str) or name not in ARGUMENTS:
        raise Refused("unknown_action", f"the action must be one of {', '.join(ARGUMENTS)}")
    wanted = {target_key(mode) if key == "target" else key for key in ARGUMENTS[name]}
    _check_keys(name, set(given), wanted, mode)
    match name:
        case "left_click":
            return LeftClick(_target(given, mode, screen))
        case "type":
            return Type(_target(given, mode, screen), _text(given, "text", empty=True))
        case "scroll":
            return Scroll(_direction(given["direction"]))
        case "wait":
            return Wait(_seconds(given["time"]))
        case "go_back":
            return GoBack()
        case "navigate":
            return Navigate(_text(given, "url").strip())
        case _:
            return Answer(_text(given, "text"))


def _check_keys(name: str, given: set[str], wanted: set[str], mode: Mode) -> None:
    other = _TARGETS["marks" if mode == "coordinates" else "coordinates"]
    if other in given and target_key(mode) in wanted:
        raise Refused("wrong_mode", f"{name} takes {target_key(mode)} here, not {other}")
    if missing := wanted - given:
        raise Refused("bad_arguments", f"{name} needs {' and '.join(sorted(missing))}")
    if extra := given - wanted:
        named = ", ".join(" ".join(key[:40].split()) for key in sorted(extra)[:5])
        raise Refused("bad_arguments", f"{name} does not take {named}")


def _target(given: dict[str, Any], mode: Mode, screen: Size) -> Target:
    if mode == "marks":
        number = _number(given["element"])
        if number is None or number != int(number) or not 0 <= number < _LARGEST_ELEMENT:
            raise Refused("bad_target", "element must be a whole number, as drawn on the screenshot")
        return Target(element=int(number))
    point = given["coordinate"]
    if not isinstance(point, list) or len(point) != 2:
        raise Refused("bad_target", "coordinate must be a list of two numbers, [x, y]")
    x, y = _number(point[0]), _number(point[1])
    if x is None or y is None:
        raise Refused("bad_target", "coordinate must be a list of two numbers, [x, y]")
    if not (0 <= x <= screen[0] and 0 <= y <= screen[1]):
        where = f"0 and {GRID}" if screen == (GRID, GRID) else f"[0, 0] and [{screen[0]}, {screen[1]}]"
        raise Refused("bad_target", f"coordinate must lie between {where}")
    return Target(coordinate=(_rescaled(x, screen[0], GRID), _rescaled(y, screen[1], GRID)))


def _number(value: Any) -> float | None:
    """The finite number that was given, or ``None``. A boolean is no number."""
    if isinstance(value, str) and _NUMBER.fullmatch(value):
        return float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _text(given: dict[str, Any], key: str, *, empty: bool = False) -> str:
    value = given[key]
    if not isinstance(value, str):
        raise Refused("bad_arguments", f"{key} must be a string")
    if not empty and not value.strip():
        raise Refused("bad_arguments", f"{key} must not be empty")
    return value


def _direction(value: Any) -> Literal["up", "down"]:
    if value == "up":
        return "up"
    if value == "down":
        return "down"
    raise Refused("bad_arguments", "direction must be up or down")


def _seconds(value: Any) -> float:
    seconds = _number(value)
    if seconds is None or seconds < 0:
        raise Refused("bad_arguments", "time must be a number of seconds from 0")
    return seconds
