"""From a reply to an action, or to the reason why there is none.

The parser is total: any text gives one or the other, never an exception and never an action that the
text does not spell out. It is linear in the length of the reply. Its rules:

1. Thinking says nothing. It runs from ``<think>`` to the next ``</think>``; where a chat template has opened
   it, from the beginning. Thinking that never ends leaves no reply. Thinking that begins or ends after the
   tool call leaves open whether the call was meant, so it is none.
2. Outside of the thinking there is exactly one ``<tool_call>`` with its ``</tool_call>``. What follows it is
   ignored, unless it holds another.
3. Between the two stands one JSON object, bare or in a code fence, with ``name`` ``"computer_use"`` and
   an object as ``arguments``. No key stands twice; NaN and infinity are no JSON.
4. The arguments are read by :mod:`webgym.agent.computer_use`.
   The compact formats have a line in their place (:mod:`webgym.agent.compact`); the rest holds for them too.
5. The sections before the call (Memory, Progress, Intention, Action) never spoil a good call: one that
   is missing or unreadable is ``None`` or empty.
"""

from __future__ import annotations

import json
import re
from typing import Any, NoReturn

import msgspec

from webgym.agent.compact import COMPACT_FORMATS, parse_compact
from webgym.agent.computer_use import TOOL_NAME, ParseProblem, Refused, from_arguments
from webgym.agent.config import WITH_MEMORY, PromptFormat
from webgym.agent.image_sizing import Size
from webgym.agent.profile import Thinking
from webgym.core.action import GRID, Action, Mode, Space

_THINK, _END_THINK = "<think>", "</think>"
_CALL, _END_CALL = "<tool_call>", "</tool_call>"
_HEADING = re.compile(
    r"^[ \t>*#_]*(memory|progress|intention|action)[ \t*_]*[:：][*_]*",
    re.IGNORECASE | re.MULTILINE | re.ASCII,
)
_TAG = re.compile("|".join((_THINK, _END_THINK, _CALL)))
_FENCE = re.compile(r"```[a-zA-Z]{0,16}\s*\n?")


class ParsedReply(msgspec.Struct, frozen=True):
    """What a reply says.

    Attributes:
        action: what to do.
        memory: the Memory object; ``None`` if it was missing or no JSON object.
        progress: the Progress object; ``None`` likewise.
        intention: the subtask that is worked on; empty if none was named.
        description: the Action sentence; empty if there was none.
    """

    action: Action
    memory: dict[str, Any] | None = None
    progress: dict[str, Any] | None = None
    intention: str = ""
    description: str = ""


class ParseError(msgspec.Struct, frozen=True):
    """Why a reply holds no action.

    Attributes:
        kind: for counting.
        message: for the agent, one sentence.
    """

    kind: ParseProblem
    message: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


def parse_reply(
    text: str,
    mode: Mode,
    prompt_format: PromptFormat,
    *,
    screen: Size = (GRID, GRID),
    thinking: Thinking = "tagged",
    space: Space = "paper",
) -> ParsedReply | ParseError:
    """What ``text`` says. Never raises.

    Args:
        text: a reply.
        mode: how a target is named.
        prompt_format: which sections are read.
        screen: where the reply's points end, to the right and below.
        thinking: whether a chat template has opened the thinking.
        space: which actions there are; the compact formats have the paper's.
    """
    try:
        if prompt_format in COMPACT_FORMATS:
            return _read_compact(text, mode, prompt_format, screen, thinking)
        before, call = _split(text, thinking)
        action = _read_call(call, mode, screen, space)
    except Refused as refused:
        return ParseError(refused.kind, refused.message)
    sections = _sections(before)
    if prompt_format == "official":
        return ParsedReply(action, description=_line(sections.get("action", "")))
    return ParsedReply(
        action,
        memory=_object_or_none(sections.get("memory", "")),
        progress=_object_or_none(sections.get("progress", "")),
        intention=_line(sections.get("intention", "")),
        description=_line(sections.get("action", "")),
    )


def _read_compact(
    text: str, mode: Mode, prompt_format: PromptFormat, screen: Size, thinking: Thinking
) -> ParsedReply:
    start, unfinished = _thought(text, thinking)
    if unfinished is not None:
        raise Refused("unfinished_thinking", "the reply ended before the thinking did")
    with_memory = prompt_format in WITH_MEMORY
    return ParsedReply(*parse_compact(text[start:], mode, with_memory=with_memory, screen=screen))


def said_aloud(text: str, thinking: Thinking = "tagged") -> str:
    """The reply without its thinking, as it stands in the history; empty where the thinking never ends.

    Chat templates do the same to earlier turns. What looks like thinking inside of a tool call is the call's.
    """
    start, unfinished = _thought(text, thinking)
    return text[start:unfinished].strip()


def _thought(text: str, thinking: Thinking) -> tuple[int, int | None]:
    """Where the reply proper begins; and where thinking begins that does not end, if there is any.

    Looks no further than to the tool call.
    """
    start, began = 0, 0 if thinking == "opened" else None
    for tag in _TAG.finditer(text):
        if tag[0] == _END_THINK:
            start, began = tag.end(), None
        elif began is None and tag[0] == _CALL:
            break
        elif began is None:
            began = tag.start()
    return start, began


def _split(text: str, thinking: Thinking) -> tuple[str, str]:
    """The reply proper up to its tool call, and what stands in the call."""
    start, unfinished = _thought(text, thinking)
    if unfinished is not None:
        raise Refused("unfinished_thinking", "the reply ended before the thinking did")
    before, opened, rest = text[start:].partition(_CALL)
    if not opened:
        raise Refused("no_tool_call", f"the reply holds no {_CALL}")
    if _CALL in rest:
        raise Refused("several_tool_calls", f"the reply holds more than one {_CALL}")
    call, closed, after = rest.partition(_END_CALL)
    if not closed:
        raise Refused("unclosed_tool_call", f"the tool call does not end with {_END_CALL}")
    if _THINK in after or _END_THINK in after:
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
    """JSON without the liberties of :mod:`json`: no NaN, no doubled key, no half of a surrogate pair."""
    try:
        value = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_object)
        text.encode()
        json.dumps(value, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        reason = getattr(error, "msg", None) or "it cannot be read"
        raise Refused("bad_json", f"the tool call is no valid JSON: {reason}") from error
    return value


def _refuse_constant(name: str) -> NoReturn:
    raise json.JSONDecodeError(f"{name} is not a number", name, 0)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise json.JSONDecodeError("a key stands twice", "", 0)
    return found


def _sections(text: str) -> dict[str, str]:
    """The text under each heading, up to the next one. Of doubled headings the last counts."""
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
    return value if isinstance(value, dict) else None


def _line(text: str) -> str:
    return " ".join(text.split())
