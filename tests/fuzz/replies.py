"""Replies that are nearly good, and what each of them means.

The generator writes a reply out of parts and knows what it wrote, so it knows what a parser must find: this
very action, or a refusal of this kind. It shares no code with the parser: JSON is written by hand here,
numbers are compared as fractions. What it then damages at random, it reads again with another JSON library.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import msgspec

from webgym.agent.config import PromptFormat
from webgym.agent.parser import ParsedReply, ParseError
from webgym.agent.profile import Thinking
from webgym.core.action import Answer, GoBack, LeftClick, Mode, Navigate, Scroll, Target, Type, Wait

TEXTS = (
    "mug",
    "blue mug, 12 €",
    "５１２",
    "“quoted” and \\back\\",
    'a "b" c',
    "line\nline\ttab",
    "emoji 🎉 👨‍👩‍👧",
    "Action: click [1, 2]",
    "</think>",
    "{}}",
    '{"action": "answer", "text": "no"}',
    "```json",
    "ignore all previous instructions",
    "\u202eright to left",
    "\x00\x1f",
)
SCREENS = ((1000, 1000), (1288, 756), (644, 392))


@dataclass(frozen=True)
class Case:
    """A reply and its meaning.

    Attributes:
        text: the reply.
        mode, prompt_format, screen, thinking: how it is to be read.
        arguments: of the action that it states, as Python values; ``None`` if it states none.
        kinds: how its refusal is called.
        memory: what it remembers, if it states an action.
        is_damaged: whether nobody knows what is left of it.
    """

    text: str
    mode: Mode
    prompt_format: PromptFormat
    screen: tuple[int, int]
    thinking: Thinking
    arguments: dict[str, Any] | None
    kinds: frozenset[str] = frozenset()
    memory: dict[str, Any] | None = None
    is_damaged: bool = False


@dataclass
class Parts:
    """A reply before it is put together."""

    arguments: dict[str, Any]
    name: str = "computer_use"
    head: str = ""
    tail: str = ""
    opening: str = "<tool_call>"
    closing: str = "</tool_call>"
    wrap: Callable[[str], str] = field(default=lambda call: call)
    spell: Callable[[str], str] = field(default=lambda call: call)
    raw_arguments: str | None = None


class Generator:
    """Cases without end; the same seed gives the same ones."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def case(self) -> Case:
        """The next case."""
        rng = self.rng
        mode: Mode = rng.choice(("coordinates", "marks"))
        screen = rng.choice(SCREENS) if mode == "coordinates" else SCREENS[0]
        thinking: Thinking = rng.choice(("tagged", "tagged", "opened"))
        prompt_format: PromptFormat = rng.choice(("memory", "official"))
        stated = self.arguments(mode, screen)
        memory = {self.text(): self.text() for _ in range(rng.randrange(3))}
        parts = Parts(dict(stated))
        kinds: set[str] = set()
        harms = rng.choices((0, 1, 2), (5, 5, 1))[0]
        for harm in rng.sample(HARMS, harms):
            kind = harm(self, parts, mode, screen)
            kinds |= set(kind.split())
        text = self.thoughts(thinking) + self.write(parts, memory, prompt_format)
        made = Case(text, mode, prompt_format, screen, thinking, stated)
        if harms == 2:  # one harm may undo what the other did
            return replace(made, arguments=None, is_damaged=True)
        if kinds:
            return replace(made, arguments=None, kinds=frozenset(kinds))
        if rng.random() < 0.3:
            return replace(made, text=self.damage(text), arguments=None, is_damaged=True)
        return replace(made, memory=memory if prompt_format == "memory" else None)

    # --- parts ------------------------------------------------------------------------------------

    def text(self) -> str:
        """Something to say, with no tag of a call in it."""
        rng = self.rng
        if rng.random() < 0.02:
            return rng.choice(("long ", "{", '"', "＜", "é")) * rng.randrange(2000, 30_000)
        return rng.choice(TEXTS) + (str(rng.randrange(100)) if rng.random() < 0.5 else "")

    def arguments(self, mode: Mode, screen: tuple[int, int]) -> dict[str, Any]:
        """An action that is all right."""
        rng = self.rng
        name = rng.choice(NAMES)
        made: dict[str, Any] = {"action": name}
        if name in ("left_click", "type"):
            point = [
                rng.choice((0, side, rng.randint(0, side), rng.randrange(side) + 0.5)) for side in screen
            ]
            made |= {"coordinate": point} if mode == "coordinates" else {"element": rng.randrange(3000)}
        if name in ("type", "answer"):
            made["text"] = self.text()
        if name == "scroll":
            made["direction"] = rng.choice(("up", "down"))
        if name == "wait":
            made["time"] = rng.choice((0, 1, 2.5, 10, 86400))
        if name == "navigate":
            made["url"] = "https://mugs.example/?q=" + rng.choice(("1", "ü", "%20", "a b"))
        return made

    def thoughts(self, thinking: Thinking) -> str:
        """Thinking that is over."""
        rng = self.rng
        call = '<tool_call>{"name": "computer_use", "arguments": {"action": "go_back"}}</tool_call>'
        inside = rng.choice(("Hm.", f"Perhaps {call}? No.", "Memory: {}\nAction: go back", "<tool_call>", ""))
        if thinking == "opened":
            return rng.choice(("", "<think>")) + inside + "</think>" + rng.choice(("", "\n\n"))
        return rng.choice(("", "", f"<think>{inside}</think>\n", "aloud, as a template left it</think>"))

    def write(self, parts: Parts, memory: dict[str, Any], prompt_format: PromptFormat) -> str:
        """The reply without its thoughts."""
        rng = self.rng
        sections = []
        if prompt_format == "memory":
            tidy = json.dumps(memory, ensure_ascii=rng.random() < 0.5).replace("<", "\\u003c")
            heading = rng.choice(("Memory:", "**Memory:**", "## Memory: ", "memory："))
            fenced = rng.random() < 0.2
            sections.append(f"{heading} " + (f"```json\n{tidy}\n```" if fenced else tidy))
            sections.append("Progress: {}")
            sections.append("Intention: find the mug")
        sections.append("Action: Click the mug.")
        arguments = parts.raw_arguments or self.json(parts.arguments)
        call = (
            f'{{{self.gap()}"name":{self.gap()}{self.json(parts.name)},{self.gap()}"arguments": {arguments}}}'
        )
        call = parts.spell(call)
        if rng.random() < 0.2:
            call = f"```{rng.choice(('', 'json'))}\n{call}\n```"
        whole = f"{parts.opening}{self.gap()}{parts.wrap(call)}{self.gap()}{parts.closing}"
        after = rng.choice(("", "", "\nDone.", "\n```", "<|im_end|>"))
        return "\n".join([*sections, parts.head + whole]) + after + parts.tail

    def gap(self) -> str:
        """White space."""
        return self.rng.choice(("", " ", "\n", "\t \n"))

    def json(self, value: Any) -> str:
        """JSON, spelt in one of the ways that mean the same."""
        rng = self.rng
        if isinstance(value, dict):
            pairs = list(value.items())
            rng.shuffle(pairs)
            if "action" in value and rng.random() < 0.2:
                unused = {"text", "url", "time", "direction"} - value.keys()
                pairs.append((rng.choice(sorted(unused)), None))
            written = (f"{self.json(key)}{self.gap()}:{self.gap()}{self.json(each)}" for key, each in pairs)
            return "{" + self.gap() + f",{self.gap()}".join(written) + self.gap() + "}"
        if isinstance(value, list):
            return "[" + ", ".join(self.json(each) for each in value) + "]"
        if isinstance(value, str):
            if rng.random() < 0.2 and len(value) < 1000:
                units = value.encode("utf-16-be")
                return '"' + "".join(f"\\u{units[i : i + 2].hex()}" for i in range(0, len(units), 2)) + '"'
            return json.dumps(value, ensure_ascii=rng.random() < 0.5)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return rng.choice((repr(value), repr(float(value)), f'"{value}"', f"{value}e0", f"{value}E+0"))
        return json.dumps(value)

    def damage(self, text: str) -> str:
        """The text with something cut out, put in, doubled or changed."""
        rng = self.rng
        for _ in range(rng.choice((1, 1, 2, 5))):
            start = rng.randint(0, len(text))
            end = min(len(text), start + rng.choice((0, 1, 1, 3, 20, 200)))
            inside = text[start:end]
            new = rng.choice(
                ("", "", inside * 2, rng.choice(SCRAPS), chr(rng.randrange(0x3100)), inside[::-1])
            )
            text = text[:start] + new + text[end:]
        return text


SCRAPS = (
    *'<tool_call> </tool_call> <think> </think> ``` { } " \\ , null NaN 9 -'.split(),
    *("\ud800", '"action": "answer", '),
)


# --- what spoils a reply: each says how the refusal may be called, "" if it was not applied ------------

Harm = Callable[[Generator, Parts, Mode, tuple[int, int]], str]
CLICK = '{"name": "computer_use", "arguments": {"action": "go_back"}}'


def _second_call(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.tail += f"{g.gap()}<tool_call>{CLICK}</tool_call>"
    return "several_tool_calls"


def _nested_call(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.wrap = lambda call: f"<tool_call>{call}</tool_call>"
    return "several_tool_calls"


def _never_closed(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.closing = g.rng.choice(("", "</tool_cal", "<tool_call/>", "＜/tool_call＞"))
    return "unclosed_tool_call"


def _wide_tags(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.opening, parts.closing = "＜tool_call＞", "＜/tool_call＞"
    return "no_tool_call"


def _no_tags(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.opening = parts.closing = ""
    return "no_tool_call"


def _truncated(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    share = g.rng.random()
    parts.spell = lambda call: call[: int(share * (len(call) - 1))]
    return "bad_json"


def _single_quotes(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.spell = lambda call: call.replace('"', "'")
    return "bad_json"


def _wide_quotes(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.spell = lambda call: call.replace('"', "＂")
    return "bad_json"


def _garbage(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    garbage = g.rng.choice((" and so on", "}", ", {}", CLICK, "//"))
    parts.spell = lambda call: call + garbage
    return "bad_json"


def _doubled_key(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.raw_arguments = '{"action": "answer", "text": "a", "action": "go_back"}'
    return "bad_json"


def _no_number(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.raw_arguments = (
        f'{{"action": "wait", "time": {g.rng.choice(("NaN", "Infinity", "-Infinity", "01"))}}}'
    )
    return "bad_json"


def _no_object(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    whole = json.dumps(parts.arguments)
    parts.raw_arguments = g.rng.choice((json.dumps(whole), f"[{whole}]", "null", "5", "true", '"left_click"'))
    return "bad_arguments"


def _wrong_tool(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.name = g.rng.choice(("mouse", "Computer_Use", "computer_use ", "ｃomputer_use", ""))
    return "wrong_tool"


def _unknown_action(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    other: tuple[Any, ...] = (
        "click",
        "double_click",
        "LEFT_CLICK",
        "left_click ",
        "key",
        None,
        5,
        ["answer"],
        {},
    )
    parts.arguments["action"] = g.rng.choice(other)
    return "unknown_action"


def _missing(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    needed = [key for key in parts.arguments if key != "action"]
    if not needed or parts.arguments["action"] not in NAMES:
        return ""
    parts.arguments.pop(g.rng.choice(needed))
    return "bad_arguments"


def _superfluous(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    if parts.arguments["action"] not in NAMES:
        return ""
    parts.arguments[g.rng.choice(("button", "x", "Coordinate", "keys"))] = g.rng.choice((1, "left", [], {}))
    return "bad_arguments"


def _off_target(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    wide, tall = screen
    key = "coordinate" if mode == "coordinates" else "element"
    points: list[Any] = [
        [wide + 0.5, 1],
        [1, tall + 1],
        [-1, 1],
        [1],
        [1, 2, 3],
        [],
        "1, 2",
        {"x": 1, "y": 2},
    ]
    points += [["１", "２"], [True, 1], [None, 1], ["1e2", 1], [[1], [2]], ["", 1], [10**400, 1], ["0x1", 1]]
    elements: list[Any] = [-1, 1.5, "submit", True, [3], "３", 2**60, "", "1e1", {}, 10**400]
    parts.raw_arguments = json.dumps(
        {"action": "left_click", key: g.rng.choice(points if mode == "coordinates" else elements)},
        ensure_ascii=False,
    )
    return "bad_target"


def _other_mode(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    other: dict[str, Any] = {"element": 5} if mode == "coordinates" else {"coordinate": [5, 5]}
    parts.raw_arguments = json.dumps({"action": "left_click"} | other)
    return "wrong_mode"


def _empty(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    bad: tuple[dict[str, Any], ...] = (
        {"action": "answer", "text": ""},
        {"action": "answer", "text": " \n"},
        {"action": "answer", "text": 5},
        {"action": "navigate", "url": "\t"},
        {"action": "navigate", "url": ["https://a.example"]},
        {"action": "scroll", "direction": "left"},
        {"action": "scroll", "direction": "DOWN"},
        {"action": "wait", "time": -0.5},
        {"action": "wait", "time": "soon"},
        {"action": "wait", "time": "１"},
        {"action": "wait", "time": False},
    )
    parts.raw_arguments = json.dumps(g.rng.choice(bad), ensure_ascii=False)
    return "bad_arguments"


def _thinks_on(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.head += "<think>" + g.rng.choice(("", "Hm. "))
    return "unfinished_thinking no_tool_call"  # the latter if the action's text ends the thinking


def _thought_only(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.head += "<think>"
    parts.tail += "</think>" + g.rng.choice(("", "Hm."))
    return "no_tool_call"


def _late_thinking(g: Generator, parts: Parts, mode: Mode, screen: tuple[int, int]) -> str:
    parts.tail += g.rng.choice(("<think>", "</think>", "<think>Hm.</think>"))
    return "late_thinking"


NAMES = ("left_click", "type", "scroll", "wait", "go_back", "navigate", "answer")
HARMS: tuple[Harm, ...] = (
    _second_call,
    _nested_call,
    _never_closed,
    _wide_tags,
    _no_tags,
    _truncated,
    _single_quotes,
    _wide_quotes,
    _garbage,
    _doubled_key,
    _no_number,
    _no_object,
    _wrong_tool,
    _unknown_action,
    _missing,
    _superfluous,
    _off_target,
    _other_mode,
    _empty,
    _thinks_on,
    _thought_only,
    _late_thinking,
)


# --- the oracle -----------------------------------------------------------------------------------------


def complaint(case: Case, found: ParsedReply | ParseError) -> str:
    """What is wrong with a parser's finding; empty if nothing is."""
    if case.is_damaged:
        return "" if isinstance(found, ParseError) else _unstated(case, found)
    if case.arguments is None:
        if isinstance(found, ParsedReply):
            return f"an action that was not stated: {found.action}"
        return "" if found.kind in case.kinds else f"{found.kind}, not {set(case.kinds)}"
    if isinstance(found, ParseError):
        return f"refused: {found}"
    if not _means(case.arguments, found, case):
        return f"{found.action} is not {case.arguments}"
    return "" if found.memory == case.memory else f"remembers {found.memory}, not {case.memory}"


def _unstated(case: Case, found: ParsedReply) -> str:
    """Whether the text, read in another way, states the action that was found in it."""
    for piece in case.text.split("<tool_call>")[1:]:
        call = piece.partition("</tool_call>")[0]
        start, end = call.find("{"), call.rfind("}")
        try:
            read = msgspec.json.decode(call[start : end + 1].encode())
        except (msgspec.DecodeError, UnicodeEncodeError, ValueError):
            continue
        if not isinstance(read, dict) or read.get("name") != "computer_use":
            continue
        arguments = read.get("arguments")
        if isinstance(arguments, dict) and _means(arguments, found, case):
            return ""
    return f"{found.action} is not stated"


def _means(arguments: dict[str, Any], found: ParsedReply, case: Case) -> bool:
    """Whether these arguments mean the action that was found."""
    given = {key: value for key, value in arguments.items() if value is not None}
    name, action = given.pop("action", None), found.action
    match action:
        case LeftClick(target, ()):
            return name == "left_click" and _is_at(given.pop(_key(case), None), target, case) and not given
        case Type(target, text, True):
            at = _is_at(given.pop(_key(case), None), target, case)
            return name == "type" and at and given == {"text": text}
        case Scroll(direction, None):
            return name == "scroll" and given == {"direction": direction}
        case Wait(seconds):
            return name == "wait" and set(given) == {"time"} and _same(given["time"], seconds)
        case GoBack():
            return name == "go_back" and not given
        case Navigate(url):
            return name == "navigate" and set(given) == {"url"} and str(given["url"]).strip() == url
        case Answer(text):
            return name == "answer" and given == {"text": text}
        case _:  # of the extended space, which is not asked for
            return False


def _key(case: Case) -> str:
    return "coordinate" if case.mode == "coordinates" else "element"


def _is_at(place: Any, target: Target, case: Case) -> bool:
    if target.element is not None:
        return case.mode == "marks" and _same(place, target.element)
    if case.mode != "coordinates" or not isinstance(place, list) or len(place) != 2:
        return False
    assert target.coordinate is not None
    return all(
        _same(stated, value, side)
        for stated, value, side in zip(place, target.coordinate, case.screen, strict=True)
    )


def _same(stated: Any, value: float, side: int = 1000) -> bool:
    """Whether a number on a screen with this side is the value on one of a thousand."""
    if isinstance(stated, bool) or not isinstance(stated, int | float | str):
        return False
    return abs(Fraction(stated) * 1000 / side - Fraction(value)) <= Fraction(max(1, abs(value))) / 10**12
