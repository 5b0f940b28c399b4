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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from webgym.agent.computer_use import Refused, from_arguments, to_arguments
from webgym.agent.context import Cut, Round, picture_of, shown_reply
from webgym.agent.formats import Format, Turn
from webgym.agent.image_sizing import Size
from webgym.agent.parser import ParsedReply, ParseError, after_thinking
from webgym.agent.profile import Thinking
from webgym.core.action import GRID, Action, Mode, Space
from webgym.core.observation import Observation
from webgym.core.text import visible
from webgym.core.trajectory import Message, TextPart

_SECTION = re.compile(r"\s*(memory|progress|intention)(?=\s|;|$)", re.ASCII)
_QUOTED = r'"(?:[^"\\]|\\.)*"'
_TO_SEMICOLON = re.compile(rf'(?:{_QUOTED}|[^;"])*', re.DOTALL)
_TOKEN = re.compile(rf'\s*({_QUOTED}|[,="]|[^\s,="]+)', re.DOTALL)
_PLAIN = re.compile(r"[\w.:'#/ ]*\w", re.DOTALL)
_CALL = re.compile(r"\s*([a-z_]+)(?:\s+(.*))?", re.DOTALL)
_POINT = re.compile(r"(\S+)\s+(\S+)(?:\s+(.*))?", re.DOTALL)
_ELEMENT = re.compile(r"(\S+)(?:\s+(.*))?", re.DOTALL)
_TEXT_ARGUMENT: Final = {"scroll": "direction", "wait": "time", "navigate": "url", "answer": "text"}


@dataclass(frozen=True)
class CompactFormat(Format):
    """One line of text beside each picture, and a reply of one line; the paper's actions only."""

    has_memory: bool
    adds_memory = True
    has_end = False
    spaces: ClassVar[Sequence[Space]] = ("paper",)

    def messages(self, turn: Turn, cut: Cut) -> tuple[Message, ...]:
        """The request: each picture comes first, and the task is in the last message."""
        task, past, now, config, profile = turn
        rounds = min(config.rounds, len(past)) - cut.rounds
        screen = profile.screen(profile.picture_size(now.observation.picture_size, config.image_max_side))
        blind = cut.pictures - cut.rounds
        messages = [Message("system", (TextPart("act with memory" if self.has_memory else "act"),))]
        for number, shown in enumerate(past[len(past) - rounds :]):
            picture = () if number < blind else (picture_of(shown.step.observation, config, profile),)
            said = TextPart(f"step {shown.step.index + 1} of {now.budget}")
            messages += [Message("user", (*picture, said)), shown_reply(shown.step.reply, profile)]
        lines = [f"task {task.instruction}"]
        if self.has_memory:
            lines.append(f"memory {_memory_line(dict(list(now.memory.items())[cut.entries :]))}".rstrip())
            lines.append(f"progress {_progress_line(now.progress)}".rstrip())
        lines.append(_last_line(past[-1] if past else None, screen))
        lines += [f"note {kind}" for kind in _notices(now.observation)]
        lines.append(f"step {now.index + 1} of {now.budget}")
        shown_now = (picture_of(now.observation, config, profile), TextPart(visible("\n".join(lines))))
        return (*messages, Message("user", shown_now))

    def read(
        self,
        text: str,
        mode: Mode,
        screen: Size,
        thinking: Thinking,
        space: Space,  # noqa: ARG002
    ) -> ParsedReply:
        """A section that is missing or invalid is ``None`` or empty; the action is parsed all the same."""
        text = after_thinking(text, thinking)
        sections: dict[str, str] = {}
        at = 0
        while (heading := _SECTION.match(text, at)) and (self.has_memory or heading[1] == "intention"):
            content = _TO_SEMICOLON.match(text, heading.end())
            end = content.end() if content else heading.end()
            if text[end : end + 1] != ";":
                raise Refused("no_tool_call", "the reply ends before its action")
            sections[heading[1]] = text[heading.end() : end].strip()
            at = end + 1
        return ParsedReply(
            _read_action(text[at:], mode, screen),
            memory=_entries(sections["memory"]) if "memory" in sections else None,
            progress=_subtasks(sections["progress"]) if "progress" in sections else None,
            intention=str(_value(sections.get("intention", ""))),
        )

    def write(
        self,
        action: Action,
        *,
        description: str,  # noqa: ARG002
        memory: Mapping[str, Any],
        progress: Mapping[str, Any],
        intention: str,
        screen: Size = (GRID, GRID),
    ) -> str:
        """Values of the memory that are not strings are written as JSON; there is no description."""
        sections = [_render_action(action, screen)]
        if intention or self.has_memory:
            sections.insert(0, f"intention {_quoted(intention, spaces=True)}" if intention else "intention")
        if self.has_memory:
            notes = f"memory {_memory_line(memory)}".rstrip(), f"progress {_progress_line(progress)}".rstrip()
            sections = [*notes, *sections]
        return " ; ".join(sections)


COMPACT: Final = CompactFormat(has_memory=True)
COMPACT_OFFICIAL: Final = CompactFormat(has_memory=False)


def _memory_line(memory: Mapping[str, Any]) -> str:
    """Memory entries in the form of requests and replies: ``1 = 7 , 2 = red moon``."""
    entries = (
        f"{_quoted(key, spaces=True)} = {_quoted(value, spaces=True)}" for key, value in memory.items()
    )
    return " , ".join(entries)


def _progress_line(progress: Mapping[str, Any]) -> str:
    """Subtasks in the form of requests and replies: ``1 + 2 -``."""
    return " ".join(
        f"{_quoted(key, spaces=False)} {'+' if state == 'finished' else '-'}"
        for key, state in progress.items()
    )


def _last_line(before: Round | None, screen: Size) -> str:
    match before.parsed if before else None:
        case None:
            return "last nothing"
        case ParseError():
            return "last unreadable"
        case ParsedReply(action=action):
            assert before is not None
            effect = "changed" if before.step.changed else "unchanged"
            return f"last {_render_action(action, screen)} {effect}"


def _notices(observation: Observation) -> list[str]:
    kinds = {notice.kind for notice in observation.notices} - {"unchanged", "no_effect", "reply_unreadable"}
    return sorted(kinds)


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
