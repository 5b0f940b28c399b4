"""Actions as arguments of the ``computer_use`` tool, and back.

The names and arguments follow the computer-use convention that Qwen3-VL was trained on:
``{"action": "left_click", "coordinate": [x, y]}``. In marks mode ``element`` replaces ``coordinate``; in the
extended space both are allowed, because some places carry no number. The actions and their arguments follow
from :func:`webgym.core.action.actions_of`. Parsing is strict:

- every required argument of the action must be present, and no other than its own (``null`` counts as
  absent);
- a coordinate is a list of exactly two finite numbers from 0 to 1000, or to the size of the picture where
  the model points at pixels; an element is a whole number from 0;
- a number may be written as a string of plain ASCII digits (``"512"``, ``"0.5"``), nothing looser;
- a target of the other mode is rejected, never converted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Final, Literal, TypeAlias, get_args

import msgspec

from webgym.agent.image_sizing import Size
from webgym.core.action import (
    DIRECTIONS,
    GRID,
    Action,
    Mode,
    Modifier,
    Space,
    Target,
    actions_of,
    fields_of,
    name_of,
)

TOOL_NAME: Final = "computer_use"

ParseProblem: TypeAlias = Literal[
    "unfinished_thinking",  # the reply ended before the thinking did
    "late_thinking",  # thinking after the tool call: it is unclear whether the call was part of the thinking
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
    """A reply contains no valid action. The parser turns it into a
    :class:`~webgym.agent.parser.ParseError`."""

    def __init__(self, kind: ParseProblem, message: str) -> None:
        super().__init__(message)
        self.kind: ParseProblem = kind
        self.message = message


_TARGET_PREFIXES: Final = {"target": "", "start": "start_"}
"""Fields that are targets, with the prefix of ``coordinate`` and ``element`` in the names of their
arguments."""

_LARGEST_ELEMENT: Final = 2**53
"""From here on, a float does not represent every whole number."""

_NUMBER = re.compile(r"-?[0-9]{1,20}(\.[0-9]{1,20})?", re.ASCII)


def keys_of(field: str, mode: Mode, space: Space) -> tuple[str, ...]:
    """The names of the arguments that may give a field of an action, exactly one of which is used."""
    if field not in _TARGET_PREFIXES:
        return (field,)
    names = ["coordinate"] if mode == "coordinates" else ["element"]
    if space == "extended" and mode == "marks":
        names.append("coordinate")
    return tuple(_TARGET_PREFIXES[field] + name for name in names)


def to_arguments(action: Action, screen: Size = (GRID, GRID)) -> dict[str, Any]:
    """The tool's arguments for this action, its points scaled to ``screen`` (largest x and y)."""
    arguments: dict[str, Any] = {"action": name_of(action)}
    for field, default in fields_of(type(action), "extended").items():
        value = getattr(action, field)
        if value == default:
            continue
        if field == "path":
            arguments[field] = [_scaled_point(point, screen) for point in value]
        elif isinstance(value, Target):
            key = "element" if value.coordinate is None else "coordinate"
            point = value.element if value.coordinate is None else _scaled_point(value.coordinate, screen)
            arguments[_TARGET_PREFIXES[field] + key] = point
        else:
            arguments[field] = list(value) if isinstance(value, tuple) else value
    return arguments


def _scaled_point(coordinate: tuple[float, float], screen: Size) -> list[float]:
    point = [_rescaled(value, GRID, side) for value, side in zip(coordinate, screen, strict=True)]
    return [int(value) if value == int(value) else value for value in point]


def _rescaled(value: float, old: int, new: int) -> float:
    """A position on an axis of length ``old``, scaled to length ``new``; unchanged if they are equal."""
    return value if old == new else min(float(new), value * new / old)


def from_arguments(
    arguments: dict[str, Any], mode: Mode, screen: Size = (GRID, GRID), space: Space = "paper"
) -> Action:
    """The action that these arguments describe.

    Args:
        arguments: the arguments of the tool call.
        mode: how a target is named.
        screen: largest x and y of points.
        space: the action space.

    Raises:
        Refused: they do not describe a valid action.
    """
    given = {key: value for key, value in arguments.items() if value is not None}
    name = given.pop("action", None)
    actions = actions_of(space)
    if not isinstance(name, str) or name not in actions:
        raise Refused("unknown_action", f"the action must be one of {', '.join(actions)}")
    fields = fields_of(actions[name], space)
    keys = {field: keys_of(field, mode, space) for field in fields}
    _check_keys(name, set(given), keys, fields)
    values = {
        field: _read(name, field, key, given[key], screen, space)
        for field, options in keys.items()
        for key in options
        if key in given
    }
    try:
        return actions[name](**values)
    except ValueError as error:
        raise Refused("bad_arguments", f"{name}: {error}") from None


def _check_keys(
    name: str, given: set[str], keys: Mapping[str, tuple[str, ...]], fields: Mapping[str, Any]
) -> None:
    for field in keys.keys() & _TARGET_PREFIXES:
        options = keys[field]
        prefix = _TARGET_PREFIXES[field]
        for other in {prefix + "coordinate", prefix + "element"} - {*options}:
            if other in given:
                raise Refused("wrong_mode", f"{name} takes {options[0]} here, not {other}")
        if len(given & {*options}) > 1:
            raise Refused("bad_arguments", f"{name} takes {' or '.join(options)}, not both")
    needed = [options for field, options in keys.items() if fields[field] is msgspec.NODEFAULT]
    if missing := [" or ".join(options) for options in needed if not given & {*options}]:
        raise Refused("bad_arguments", f"{name} needs {' and '.join(sorted(missing))}")
    if extra := given - {key for options in keys.values() for key in options}:
        named = ", ".join(" ".join(key[:40].split()) for key in sorted(extra)[:5])
        raise Refused("bad_arguments", f"{name} does not take {named}")


def _read(name: str, field: str, key: str, value: Any, screen: Size, space: Space) -> Any:
    """The value of an action's field, parsed from the argument ``key``."""
    match field:
        case "target" | "start":
            if key.endswith("element"):
                return _element(key, value)
            return Target(coordinate=_point(key, value, screen))
        case "path":
            return _path(key, value, screen)
        case "text":
            return _text(key, value, empty=name in ("type", "answer_dialog"))
        case "url":
            return _text(key, value).strip()
        case "direction":
            return _choice(key, value, DIRECTIONS[space])
        case "time":
            return _seconds(value)
        case "enter" | "accept":
            return _flag(key, value)
        case "modifiers":
            return tuple(_choice(key, name, get_args(Modifier)) for name in _texts(key, value))
        case _:
            return _texts(key, value)


def _element(key: str, value: Any) -> Target:
    number = _number(value)
    if number is None or number != int(number) or not 0 <= number < _LARGEST_ELEMENT:
        raise Refused("bad_target", f"{key} must be a whole number, as drawn on the screenshot")
    return Target(element=int(number))


def _path(key: str, points: Any, screen: Size) -> tuple[tuple[float, float], ...]:
    if not isinstance(points, list):
        raise Refused("bad_arguments", f"{key} must be a list of points, [[x, y], ...]")
    return tuple(_point(f"each point of {key}", point, screen) for point in points)


def _point(key: str, point: Any, screen: Size) -> tuple[float, float]:
    if not isinstance(point, list) or len(point) != 2:
        raise Refused("bad_target", f"{key} must be a list of two numbers, [x, y]")
    x, y = _number(point[0]), _number(point[1])
    if x is None or y is None:
        raise Refused("bad_target", f"{key} must be a list of two numbers, [x, y]")
    if not (0 <= x <= screen[0] and 0 <= y <= screen[1]):
        where = f"0 and {GRID}" if screen == (GRID, GRID) else f"[0, 0] and [{screen[0]}, {screen[1]}]"
        raise Refused("bad_target", f"{key} must lie between {where}")
    return _rescaled(x, screen[0], GRID), _rescaled(y, screen[1], GRID)


def _number(value: Any) -> float | None:
    """The value as a finite number, or ``None``. A boolean is not a number."""
    if isinstance(value, str) and _NUMBER.fullmatch(value):
        return float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _text(key: str, value: Any, *, empty: bool = False) -> str:
    if not isinstance(value, str):
        raise Refused("bad_arguments", f"{key} must be a string")
    if not empty and not value.strip():
        raise Refused("bad_arguments", f"{key} must not be empty")
    return value


def _texts(key: str, value: Any) -> tuple[str, ...]:
    """A list of non-empty strings; a single string is also accepted. A space is valid: it names a key."""
    values = [value] if isinstance(value, str) else value
    if not isinstance(values, list) or not values or not all(isinstance(v, str) and v for v in values):
        raise Refused("bad_arguments", f"{key} must be a list of strings")
    return tuple(values)


def _choice(key: str, value: Any, choices: tuple[str, ...]) -> str:
    if value not in choices:
        raise Refused("bad_arguments", f"{key} must be {', '.join(choices[:-1])} or {choices[-1]}")
    return str(value)


def _flag(key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise Refused("bad_arguments", f"{key} must be true or false")
    return value


def _seconds(value: Any) -> float:
    seconds = _number(value)
    if seconds is None or seconds < 0:
        raise Refused("bad_arguments", "time must be a number of seconds from 0")
    return seconds
