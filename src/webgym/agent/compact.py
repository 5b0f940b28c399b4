"""The compact prompt formats: the content of the memory format in as few tokens as possible.

For models so small that every token counts (``webgym.study``). A request is a system message of a few words
and, for every round, the picture and one line of text; a reply is one line::

    memory 1 = 7 ; progress 1 + 2 - ; intention 2 red moon ; left_click 375 437

Memory lists the new entries only; earlier ones stay (it is append-only anyway). Progress gives every
subtask, ``+`` finished or ``-`` not. The intention is the subtask and the target of the action, in words: a
small model that has named the target points at it far better. ``compact_official`` has only intention and
action. Keys and values that are more than words and digits are written as JSON strings. The text of ``type``,
``navigate`` and ``answer`` extends to the end of the reply.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final

from webgym.agent.computer_use import Refused, from_arguments, to_arguments
from webgym.agent.image_sizing import Size
from webgym.core.action import GRID, Action, Mode

COMPACT_FORMATS: Final = frozenset({"compact", "compact_official"})

_SECTION = re.compile(r"\s*(memory|progress|intention)(?=\s|;|$)", re.ASCII)
_QUOTED = r'"(?:[^"\\]|\\.)*"'
_TO_SEMICOLON = re.compile(rf'(?:{_QUOTED}|[^;"])*', re.DOTALL)
_TOKEN = re.compile(rf'\s*({_QUOTED}|[,="]|[^\s,="]+)', re.DOTALL)
_PLAIN = re.compile(r"[\w.:'#/ ]*\w", re.DOTALL)
_CALL = re.compile(r"\s*([a-z_]+)(?:\s+(.*))?", re.DOTALL)
_POINT = re.compile(r"(\S+)\s+(\S+)(?:\s+(.*))?", re.DOTALL)
_ELEMENT = re.compile(r"(\S+)(?:\s+(.*))?", re.DOTALL)
_TEXT_ARGUMENT: Final = {"scroll": "direction", "wait": "time", "navigate": "url", "answer": "text"}


def render_compact(
    action: Action,
    *,
    with_memory: bool,
    memory: Mapping[str, Any],
    progress: Mapping[str, Any],
    intention: str,
    screen: Size = (GRID, GRID),
) -> str:
    """A reply in the compact format, the inverse of :func:`parse_compact`.

    Args:
        action: the action.
        with_memory: whether memory and progress precede intention and action.
        memory: entries to add; values that are not strings are written as JSON.
        progress: state of each subtask: ``"finished"`` or anything else.
        intention: the current subtask, and the target of the action.
        screen: largest x and y of points.
    """
    sections = [_render_action(action, screen)]
    if intention or with_memory:
        sections.insert(0, f"intention {_quoted(intention, spaces=True)}" if intention else "intention")
    if with_memory:
        notes = f"memory {memory_line(memory)}".rstrip(), f"progress {progress_line(progress)}".rstrip()
        sections = [*notes, *sections]
    return " ; ".join(sections)


def memory_line(memory: Mapping[str, Any]) -> str:
    """Memory entries in the form of requests and replies: ``1 = 7 , 2 = red moon``."""
    entries = (
        f"{_quoted(key, spaces=True)} = {_quoted(value, spaces=True)}" for key, value in memory.items()
    )
    return " , ".join(entries)


def progress_line(progress: Mapping[str, Any]) -> str:
    """Subtasks in the form of requests and replies: ``1 + 2 -``."""
    return " ".join(
        f"{_quoted(key, spaces=False)} {'+' if state == 'finished' else '-'}"
        for key, state in progress.items()
    )


def action_line(action: Action, screen: Size = (GRID, GRID)) -> str:
    """The action in the form of a reply."""
    return _render_action(action, screen)


def parse_compact(
    text: str, mode: Mode, *, with_memory: bool, screen: Size = (GRID, GRID)
) -> tuple[Action, dict[str, Any] | None, dict[str, Any] | None, str]:
    """Action, memory, progress and intention of a reply without its thinking.

    A section that is missing or invalid is ``None`` or empty; the action is parsed all the same.

    Raises:
        Refused: the reply contains no valid action.
    """
    sections: dict[str, str] = {}
    at = 0
    while (heading := _SECTION.match(text, at)) and (with_memory or heading[1] == "intention"):
        content = _TO_SEMICOLON.match(text, heading.end())
        end = content.end() if content else heading.end()
        if text[end : end + 1] != ";":
            raise Refused("no_tool_call", "the reply ends before its action")
        sections[heading[1]] = text[heading.end() : end].strip()
        at = end + 1
    action = _read_action(text[at:], mode, screen)
    return (
        action,
        _entries(sections["memory"]) if "memory" in sections else None,
        _subtasks(sections["progress"]) if "progress" in sections else None,
        str(_value(sections.get("intention", ""))),
    )


def _render_action(action: Action, screen: Size) -> str:
    arguments = to_arguments(action, screen)
    words = [arguments.pop("action")]
    for value in arguments.values():
        words += [_plain(part) for part in (value if isinstance(value, list) else [value])]
    return " ".join(words).rstrip()


def _plain(value: object) -> str:
    return f"{value:.3f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def _read_action(text: str, mode: Mode, screen: Size) -> Action:
    call = _CALL.fullmatch(text.rstrip())
    if call is None:
        raise Refused("no_tool_call", "the reply holds no action")
    name, rest = call[1], (call[2] or "").strip()
    arguments: dict[str, Any] = {"action": name}
    if name in ("left_click", "type"):
        arguments |= _target(name, rest, mode)
    elif name in _TEXT_ARGUMENT:
        if not rest:
            raise Refused("bad_arguments", f"{name} needs {_TEXT_ARGUMENT[name]}")
        arguments[_TEXT_ARGUMENT[name]] = rest
    elif rest:
        raise Refused(
            "unknown_action" if name != "go_back" else "bad_arguments", f"{name} takes no arguments"
        )
    return from_arguments(arguments, mode, screen)


def _target(name: str, rest: str, mode: Mode) -> dict[str, Any]:
    if mode == "coordinates":
        point = _POINT.fullmatch(rest)
        if point is None:
            raise Refused("bad_target", f"{name} needs two numbers, x y")
        arguments: dict[str, Any] = {"coordinate": [point[1], point[2]]}
        text = point[3]
    else:
        element = _ELEMENT.fullmatch(rest)
        if element is None:
            raise Refused("bad_target", f"{name} needs the number of an element")
        arguments = {"element": element[1]}
        text = element[2]
    if name == "type":
        return arguments | {"text": text or ""}
    return arguments | ({"text": text} if text else {})


def _entries(text: str) -> dict[str, Any] | None:
    """``1 = 7 , 2 = red moon``; ``None`` if it is anything else."""
    entries: dict[str, Any] = {}
    sides: list[list[str]] = [[]]
    for word in [*(_tokens(text) or ["?"]), ","] if text else []:
        if word == "," and len(sides) == 2 and all(sides) and (key := " ".join(sides[0])) not in entries:
            entries[key] = " ".join(sides[1])
            sides = [[]]
        elif word == "," or (word == "=" and len(sides) == 2):
            return None
        elif word == "=":
            sides.append([])
        else:
            sides[-1].append(_value(word))
    return entries


def _subtasks(text: str) -> dict[str, Any] | None:
    """``1 + 2 -``; ``None`` if it is anything else."""
    tokens = _tokens(text)
    if tokens is None or len(tokens) % 2:
        return None
    keys = [_value(key) for key in tokens[::2]]
    if len(set(keys)) != len(keys) or not set(tokens[1::2]) <= {"+", "-"}:
        return None
    states = ("finished" if sign == "+" else "not finished" for sign in tokens[1::2])
    return dict(zip(keys, states, strict=True))


def _tokens(text: str) -> list[str] | None:
    """Words, JSON strings and the signs ``,`` and ``=``; ``None`` if a string does not end."""
    tokens, at = [], 0
    while token := _TOKEN.match(text, at):
        if token[1] == '"':
            return None
        tokens.append(token[1])
        at = token.end()
    return tokens


def _quoted(value: Any, *, spaces: bool) -> str:
    """A key or a value, as a JSON string if it is more than words and digits."""
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    is_plain = _PLAIN.fullmatch(text) and text == text.strip() and (spaces or " " not in text)
    if isinstance(value, str) and is_plain and "\n" not in text:
        return text
    return json.dumps(value if isinstance(value, str) else text, ensure_ascii=False)


def _value(text: str) -> str:
    if text.startswith('"'):
        try:
            return str(json.loads(text, strict=False))
        except ValueError:
            return text
    return text
