"""Parses a reply into an action, or into the reason why it contains none.

The parser is total: any text gives one or the other, never an exception, and never an action that the text
does not state explicitly. It is linear in the length of the reply. Its rules:

1. Thinking is ignored. It extends from ``<think>`` to the next ``</think>``, or from the beginning if the
   chat template opens it; also with the tags of other families (:data:`webgym.core.text.THOUGHT`). If the
   thinking does not end, there is no reply. If thinking begins or ends after the tool call, it is unclear
   whether the call was part of it, so the call is rejected; :mod:`webgym.agent.agent` rejects one after which
   the reply was cut off.
2. Outside of the thinking there is exactly one ``<tool_call>`` with its ``</tool_call>``. Text after it is
   ignored, unless it contains another call.
3. The call is one JSON object, bare or in a code fence, with ``name`` ``"computer_use"`` and an object as
   ``arguments``. Duplicate keys, NaN and infinity are invalid.
4. The arguments are parsed by :mod:`webgym.agent.computer_use`.
5. The sections before the call (Memory, Progress, Intention, Action) do not affect the call: one that is
   missing or invalid is ``None`` or empty.

These are the rules of the standard formats. Rule 1 holds in every format (:mod:`webgym.agent.formats`).
"""

from __future__ import annotations

import json
import re
from typing import Any, Final, NoReturn

import msgspec

from webgym.agent.computer_use import TOOL_NAME, ParseProblem, Refused, from_arguments
from webgym.agent.image_sizing import Size
from webgym.agent.profile import Thinking
from webgym.core.action import Action, Mode, Space
from webgym.core.text import THOUGHT, THOUGHT_END

CALL_TAGS: Final = ("<tool_call>", "</tool_call>")
"""What begins and ends the call in a reply."""

_CALL, _END_CALL = CALL_TAGS
_HEADING = re.compile(
    r"^[ \t>*#_]*(memory|progress|intention|action)[ \t*_]*[:：][*_]*",
    re.IGNORECASE | re.MULTILINE | re.ASCII,
)
_TAG = re.compile(f"(?P<start>{THOUGHT.pattern})|(?P<end>{THOUGHT_END.pattern})|(?-i:{_CALL})", re.IGNORECASE)
_FENCE = re.compile(r"```[a-zA-Z]{0,16}\s*\n?")
_MOST_DEPTH: Final = 20
"""Most levels of memory and progress: what is deeper cannot be compared, written or stored."""


class ParsedReply(msgspec.Struct, frozen=True):
    """The content of a reply.

    Attributes:
        action: the action.
        memory: the Memory object; ``None`` if it was missing, not a JSON object, or too deep.
        progress: the Progress object; ``None`` likewise.
        intention: the current subtask; empty if none was named.
        description: the Action sentence; empty if there was none.
    """

    action: Action
    memory: dict[str, Any] | None = None
    progress: dict[str, Any] | None = None
    intention: str = ""
    description: str = ""


class ParseError(msgspec.Struct, frozen=True):
    """Why a reply contains no valid action.

    Attributes:
        kind: category of the problem.
        message: one sentence for the agent.
    """

    kind: ParseProblem
    message: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


def read_sections(
    text: str, mode: Mode, screen: Size, thinking: Thinking, space: Space, *, has_memory: bool
) -> ParsedReply:
    """A reply in a standard format, with memory, progress and intention or without.

    Raises:
        Refused: it contains no valid action.
    """
    before, call = _split(text, thinking)
    action = _read_call(call, mode, screen, space)
    sections = _sections(before)
    description = _line(sections.get("action", ""))
    if not has_memory:
        return ParsedReply(action, description=description)
    return ParsedReply(
        action,
        memory=_object_or_none(sections.get("memory", "")),
        progress=_object_or_none(sections.get("progress", "")),
        intention=_line(sections.get("intention", "")),
        description=description,
    )


def without_thinking(text: str, thinking: Thinking = "tagged") -> str:
    """The reply without its thinking, as the history shows it; empty if the thinking does not end.

    Chat templates do the same to earlier turns. Tags inside of a tool call belong to the call.
    """
    start, unfinished = _reply_start(text, thinking)
    return text[start:unfinished].strip()


def _reply_start(text: str, thinking: Thinking) -> tuple[int, int | None]:
    """Offsets of the end of the thinking, and of the start of thinking that does not end (or ``None``).

    Stops at the tool call. Thinking that a tag begins ends at the tag of the same name.
    """
    start, unfinished, name = 0, 0 if thinking == "opened" else None, ""
    for tag in _TAG.finditer(text):
        if tag["end"]:
            if unfinished is None or name in ("", _name(tag["end"])):
                start, unfinished = tag.end(), None
        elif unfinished is None and tag["start"]:
            unfinished, name = tag.start(), _name(tag["start"])
        elif unfinished is None:
            break
    return start, unfinished


def _name(tag: str) -> str:
    return "".join(tag.replace("/", "").split()).casefold()


def after_thinking(text: str, thinking: Thinking) -> str:
    """The reply from the end of its thinking.

    Raises:
        Refused: the thinking does not end.
    """
    start, unfinished = _reply_start(text, thinking)
    if unfinished is not None:
        raise Refused("unfinished_thinking", "the reply ended before the thinking did")
    return text[start:]


def _split(text: str, thinking: Thinking) -> tuple[str, str]:
    """The text between the thinking and the tool call, and the content of the call."""
    before, opened, rest = after_thinking(text, thinking).partition(_CALL)
    if not opened:
        raise Refused("no_tool_call", "the reply holds no tool_call tag")
    if _CALL in rest:
        raise Refused("several_tool_calls", "the reply holds more than one tool_call tag")
    call, closed, after = rest.partition(_END_CALL)
    if not closed:
        raise Refused("unclosed_tool_call", "the tool call has no closing tag")
    if THOUGHT.search(after) or THOUGHT_END.search(after):
        raise Refused("late_thinking", "the thinking must end before the tool call")
    return before, call


def _read_call(text: str, mode: Mode, screen: Size, space: Space) -> Action:
    call = _read_json(_without_fence(text))
    if not isinstance(call, dict) or set(call) != {"name", "arguments"}:
        raise Refused("bad_arguments", "the tool call must be an object with name and arguments")
    if call["name"] != TOOL_NAME:
        raise Refused("wrong_tool", f"the only tool is {TOOL_NAME}")
    if not isinstance(call["arguments"], dict):
        raise Refused("bad_arguments", "arguments must be an object")
    return from_arguments(call["arguments"], mode, screen, space)


def _without_fence(text: str) -> str:
    text = text.strip()
    opening = _FENCE.match(text)
    if opening is None:
        return text
    return text[opening.end() :].removesuffix("```").strip()


def _read_json(text: str) -> Any:
    """Parse JSON more strictly than :mod:`json`: no NaN, no duplicate key, no lone surrogate.

    A line break within a string may stand as it is: many models do not escape it, and it means nothing else.
    """
    try:
        value = json.loads(text, strict=False, parse_constant=_refuse_constant, object_pairs_hook=_object)
        text.encode()
        json.dumps(value, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        reason = getattr(error, "msg", None) or "it cannot be read"
        raise Refused("bad_json", f"the tool call is not valid JSON: {reason}") from error
    return value


def _refuse_constant(name: str) -> NoReturn:
    raise json.JSONDecodeError(f"{name} is not a number", name, 0)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        raise json.JSONDecodeError("a key is repeated", "", 0)
    return members


def _sections(text: str) -> dict[str, str]:
    """The text under each heading, up to the next one. Of repeated headings the last counts."""
    headings = list(_HEADING.finditer(text))
    ends = [heading.start() for heading in headings[1:]] + [len(text)]
    return {
        heading[1].lower(): text[heading.end() : end].strip()
        for heading, end in zip(headings, ends, strict=False)
    }


def _object_or_none(text: str) -> dict[str, Any] | None:
    try:
        value = _read_json(_without_fence(text))
    except Refused:
        return None
    return value if isinstance(value, dict) and not _is_deep(value, _MOST_DEPTH) else None


def _is_deep(value: Any, levels: int) -> bool:
    if not isinstance(value, dict | list):
        return False
    inner = value.values() if isinstance(value, dict) else value
    return levels == 0 or any(_is_deep(each, levels - 1) for each in inner)


def _line(text: str) -> str:
    return " ".join(text.split())
