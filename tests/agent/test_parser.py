from __future__ import annotations

import json
import re
import time
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.agent.strategies import JSON_OBJECTS, LINES, actions

from webgym.agent.computer_use import keys_of
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.formats import parse_reply, render_reply
from webgym.agent.parser import ParsedReply, ParseError, without_thinking
from webgym.agent.prompts import tool_declaration
from webgym.core.action import (
    Action,
    Answer,
    Drag,
    GoBack,
    LeftClick,
    Mode,
    Press,
    Scroll,
    Space,
    Target,
    Type,
    Wait,
    actions_of,
    fields_of,
)
from webgym.server.messages import ExecuteRequest

MODES: tuple[Mode, ...] = ("coordinates", "marks")
FORMATS: tuple[PromptFormat, ...] = ("memory", "official")
SPACES: tuple[Space, ...] = ("paper", "extended")


def call(arguments: Any, name: Any = "computer_use") -> str:
    return f"<tool_call>\n{json.dumps({'name': name, 'arguments': arguments})}\n</tool_call>"


def read(text: str, mode: Mode = "coordinates", prompt_format: PromptFormat = "memory") -> Any:
    return parse_reply(text, mode, prompt_format)


def action_of(text: str, mode: Mode = "coordinates") -> Action:
    parsed = read(text, mode)
    assert isinstance(parsed, ParsedReply), parsed
    return parsed.action


def problem_of(text: str, mode: Mode = "coordinates") -> str:
    parsed = read(text, mode)
    assert isinstance(parsed, ParseError), parsed
    assert parsed.message
    return parsed.kind


CLICK = {"action": "left_click", "coordinate": [512, 300]}
CLICKED = LeftClick(Target(coordinate=(512, 300)))


def test_a_whole_memory_reply() -> None:
    parsed = read(
        'Memory: {"price of the mug": "12 €"}\n'
        'Progress: {"find the mug": "finished",\n "buy it": "not finished"}\n'
        "Intention: buy it\n"
        "Action: Click the cart: it is at the top.\n" + call(CLICK)
    )
    assert parsed == ParsedReply(
        CLICKED,
        memory={"price of the mug": "12 €"},
        progress={"find the mug": "finished", "buy it": "not finished"},
        intention="buy it",
        description="Click the cart: it is at the top.",
    )


def test_line_breaks_within_strings_may_stand_as_they_are() -> None:
    escaped = call({"action": "answer", "text": "12 €\n\tthe mug"})
    raw = escaped.replace("\\n\\t", "\n\t")
    assert raw != escaped
    assert read(raw).action == Answer("12 €\n\tthe mug")


@given(st.data(), st.sampled_from(MODES), st.sampled_from(FORMATS), st.sampled_from(SPACES))
def test_what_is_rendered_is_read(
    data: st.DataObject, mode: Mode, prompt_format: PromptFormat, space: Space
) -> None:
    action = data.draw(actions(mode, space))
    memory, progress = data.draw(JSON_OBJECTS), data.draw(JSON_OBJECTS)
    intention, description = data.draw(LINES), data.draw(LINES)
    text = render_reply(
        action, prompt_format, description=description, memory=memory, progress=progress, intention=intention
    )
    expected = (
        ParsedReply(action, memory, progress, intention, description)
        if prompt_format == "memory"
        else ParsedReply(action, description=description)
    )
    assert parse_reply(text, mode, prompt_format, space=space) == expected
    sent = msgspec.json.encode(ExecuteRequest(action)) if not isinstance(action, Answer) else b""
    assert not sent or msgspec.json.decode(sent, type=ExecuteRequest).action == action, "the server takes it"


PIECES = [
    *"<tool_call> </tool_call> <think> </think> ``` } Action: NaN".split(),
    "```json\n",
    '{"name": "computer_use", "arguments": ',
    '{"action": "left_click", "coordinate": [1, 2]}',
    '{"action": "answer", "text": "yes"}',
    "Memory: ",
    "\ud800",
]


@given(
    st.lists(st.sampled_from(PIECES) | st.text(max_size=8), max_size=12).map("".join),
    st.sampled_from(MODES),
    st.sampled_from(FORMATS),
)
def test_any_text_gives_an_action_or_a_reason(text: str, mode: Mode, prompt_format: PromptFormat) -> None:
    parsed = parse_reply(text, mode, prompt_format)
    assert isinstance(parsed, ParsedReply | ParseError)
    if isinstance(parsed, ParsedReply):
        assert "<tool_call>" in text
        if isinstance(parsed.action, LeftClick):
            assert parsed.action == LeftClick(Target(coordinate=(1, 2)))
        elif isinstance(parsed.action, Answer):
            assert parsed.action.text in text


@given(st.data(), st.sampled_from(MODES))
def test_a_damaged_reply_never_means_another_target(data: st.DataObject, mode: Mode) -> None:
    """Cut a piece out of a good reply: it means the same, or nothing, or what still stands there."""
    action = data.draw(actions(mode))
    text = render_reply(action, "memory", description="Do it", memory={"a": 1})
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, len(text)))
    left = text[:start] + text[end:]
    parsed = parse_reply(left, mode, "memory")
    if isinstance(parsed, ParsedReply) and isinstance(parsed.action, LeftClick | Type):
        target = parsed.action.target
        shown = [target.element] if mode == "marks" else list(target.coordinate or ())
        inside = left.partition("<tool_call>")[2]
        assert all(f"{value:.0f}" in inside for value in shown if value is not None and value == int(value))


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("", "no_tool_call"),
        ("I will click the button.", "no_tool_call"),
        (json.dumps({"name": "computer_use", "arguments": CLICK}), "no_tool_call"),
        ("＜tool_call＞" + json.dumps({"name": "computer_use", "arguments": CLICK}), "no_tool_call"),
        (call(CLICK) + call(CLICK), "several_tool_calls"),
        (f"<tool_call>{call(CLICK)}</tool_call>", "several_tool_calls"),
        (call(CLICK).removesuffix("</tool_call>"), "unclosed_tool_call"),
        (call(CLICK)[:40], "unclosed_tool_call"),
        ("<think>Let me see. " + call(CLICK), "unfinished_thinking"),
        ("<think>a</think> b <think>c " + call(CLICK), "unfinished_thinking"),
        ("<tool_call></tool_call>", "bad_json"),
        ('<tool_call>{"name": "computer_use", "argum</tool_call>', "bad_json"),
        ("<tool_call>{'name': 'computer_use'}</tool_call>", "bad_json"),
        (f"<tool_call>{{“name”: “computer_use”, “arguments”: {json.dumps(CLICK)}}}</tool_call>", "bad_json"),
        (call(CLICK).replace("512", "NaN"), "bad_json"),
        (call(CLICK).replace("512", "-Infinity"), "bad_json"),
        (call(CLICK).replace("512", "9" * 5000), "bad_json"),
        (call(CLICK).replace("512", "512]"), "bad_json"),
        (call(CLICK).replace("512", "[" * 100_000), "bad_json"),
        (call(CLICK).replace('"action"', '"action": "answer", "action"'), "bad_json"),
        (call({"action": "answer", "text": "\ud800"}), "bad_json"),
        (call(CLICK).replace("}}", "}} and so on"), "bad_json"),
        ("<tool_call>[1]</tool_call>", "bad_arguments"),
        ("<tool_call>{}</tool_call>", "bad_arguments"),
        (call("left_click"), "bad_arguments"),
        (call(json.dumps(CLICK)), "bad_arguments"),
        (call([CLICK]), "bad_arguments"),
        (call(None), "bad_arguments"),
        (call(CLICK, name="mouse"), "wrong_tool"),
        (call(CLICK, name=["computer_use"]), "wrong_tool"),
        (call({}), "unknown_action"),
        (call({"action": "double_click", "coordinate": [1, 2]}), "unknown_action"),
        (call({"action": ["left_click"], "coordinate": [1, 2]}), "unknown_action"),
        (call({"action": "left_click"}), "bad_arguments"),
        (call({"action": "left_click", "coordinate": None}), "bad_arguments"),
        (call(CLICK | {"text": "mug"}), "bad_arguments"),
        (call({"action": "left_click", "element": 5}), "wrong_mode"),
        (call(CLICK | {"element": 5}), "wrong_mode"),
        (call({"action": "left_click", "coordinate": [1, 2, 3, 4]}), "bad_target"),
        (call({"action": "left_click", "coordinate": {"x": 1, "y": 2}}), "bad_target"),
        (call({"action": "left_click", "coordinate": "1, 2"}), "bad_target"),
        (call({"action": "left_click", "coordinate": [1, True]}), "bad_target"),
        (call({"action": "left_click", "coordinate": [1, None]}), "bad_target"),
        (call({"action": "left_click", "coordinate": [1, "２"]}), "bad_target"),
        (call({"action": "left_click", "coordinate": [1, "1e2"]}), "bad_target"),
        (call({"action": "left_click", "coordinate": [1, " 2"]}), "bad_target"),
        (call(CLICK).replace("512", "1e999"), "bad_target"),
        (call({"action": "left_click", "coordinate": [1, 1000.5]}), "bad_target"),
        (call({"action": "left_click", "coordinate": [-1, 5]}), "bad_target"),
        (call({"action": "left_click", "coordinate": [1, 10**400]}), "bad_target"),
        (call({"action": "type", "coordinate": [1, 2]}), "bad_arguments"),
        (call({"action": "type", "coordinate": [1, 2], "text": 5}), "bad_arguments"),
        (call({"action": "scroll"}), "bad_arguments"),
        (call({"action": "scroll", "direction": "left"}), "bad_arguments"),
        (call({"action": "scroll", "direction": "down", "coordinate": [1, 2]}), "bad_arguments"),
        (call({"action": "wait", "time": -1}), "bad_arguments"),
        (call({"action": "wait", "time": "soon"}), "bad_arguments"),
        (call({"action": "navigate", "url": "  "}), "bad_arguments"),
        (call({"action": "answer", "text": ""}), "bad_arguments"),
        (call({"action": "answer", "text": ["a"]}), "bad_arguments"),
    ],
)
def test_no_action(text: str, kind: str) -> None:
    assert problem_of(text) == kind


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        (CLICK, "wrong_mode"),
        ({"action": "left_click", "coordinate": [5, 5], "element": 5}, "wrong_mode"),
        ({"action": "left_click", "element": 1.5}, "bad_target"),
        ({"action": "left_click", "element": -1}, "bad_target"),
        ({"action": "left_click", "element": True}, "bad_target"),
        ({"action": "left_click", "element": [3]}, "bad_target"),
        ({"action": "left_click", "element": "submit"}, "bad_target"),
    ],
)
def test_no_action_in_marks_mode(arguments: dict[str, Any], kind: str) -> None:
    assert problem_of(call(arguments), "marks") == kind


@pytest.mark.parametrize(
    ("text", "action"),
    [
        (call(CLICK), CLICKED),
        (call(CLICK) + "\nThat should do.", CLICKED),
        ("<think>" + call({"action": "go_back"}) + "</think>" + call(CLICK), CLICKED),
        ("thinking that a template opened</think>\n" + call(CLICK), CLICKED),
        (call(CLICK).replace("{", "```json\n{", 1).replace("}}", "}}\n```"), CLICKED),
        (f"```\n{call(CLICK)}\n```", CLICKED),
        (call({"action": "left_click", "coordinate": ["512", "300.0"]}), CLICKED),
        (call(CLICK | {"text": None}), CLICKED),
        (call({"action": "left_click", "coordinate": [0, 1000]}), LeftClick(Target(coordinate=(0, 1000)))),
        (call({"action": "type", "coordinate": [1, 2], "text": ""}), Type(Target(coordinate=(1, 2)), "")),
        (call({"action": "answer", "text": " ５ １/２ "}), Answer(" ５ １/２ ")),
        (call({"action": "wait", "time": "2"}), Wait(2)),
        (call({"action": "scroll", "direction": "up"}), Scroll("up")),
        (call({"action": "go_back"}), GoBack()),
    ],
)
def test_actions(text: str, action: Action) -> None:
    assert action_of(text) == action


@pytest.mark.parametrize("number", [7, 7.0, "7"])
def test_element_numbers(number: object) -> None:
    assert action_of(call({"action": "left_click", "element": number}), "marks") == LeftClick(
        Target(element=7)
    )


@pytest.mark.parametrize(
    "memory", ["nothing yet", "[1, 2]", '{"a": NaN}', '{"a": 1, "a": 2}', "{" * 50_000, '{"a": "\\ud800"}']
)
def test_an_unreadable_memory_does_not_spoil_the_action(memory: str) -> None:
    parsed = read(f"Memory: {memory}\nAction: Click.\n{call(CLICK)}")
    assert parsed == ParsedReply(CLICKED, description="Click.")


@pytest.mark.parametrize(
    "text",
    [
        '**Memory**: {"a": 1}\n**Action**: Click it.\n',
        'memory：```json\n{"a": 1}\n```\n- x\nACTION： Click it.\n',
        '## Memory: {\n  "a": 1\n}\n> Action: Click\n   it.\n',
    ],
)
def test_headings_may_be_decorated(text: str) -> None:
    parsed = read(text.replace("- x\n", "") + call(CLICK))
    assert (parsed.memory, parsed.description) == ({"a": 1}, "Click it.")


@pytest.mark.parametrize(
    "filler",
    ["<think>", "</think>", "*" * 50, "Action", "Action:\n", "{", "[", '"', "<tool_call", "```", " \n", "\\"],
)
def test_a_hundred_kilobytes_take_linear_time(filler: str) -> None:
    text = filler * (100_000 // len(filler))
    started = time.process_time()
    for whole in (
        text,
        text + call(CLICK),
        f"Memory: {text}\n{call(CLICK)}",
        f"<tool_call>{text}</tool_call>",
    ):
        read(whole)
    assert time.process_time() - started < 2


# --- the extended space -------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("space", SPACES)
def test_prompt_and_parser_know_the_same_actions(mode: Mode, space: Space) -> None:
    """The declaration has a line for each action and a schema for each argument, and no others."""
    parameters = tool_declaration(mode, space=space)["function"]["parameters"]["properties"]
    action = parameters.pop("action")
    assert action["enum"] == list(actions_of(space))
    assert re.findall(r"^\* `(\w+)`:", action["description"], re.MULTILINE) == action["enum"]
    keys = {
        key
        for kind in actions_of(space).values()
        for field in fields_of(kind, space)
        for key in keys_of(field, mode, space)
    }
    assert set(parameters) == keys
    for name in action["enum"]:
        parsed = parse_reply(call({"action": name, "bogus": 1}), mode, "memory", space=space)
        assert isinstance(parsed, ParseError)
        assert parsed.kind == "bad_arguments", "it is known, and takes no such argument"


EXTENDED = [
    ({"action": "left_click", "coordinate": [1, 2], "modifiers": ["Control"]}, "bad_arguments"),
    ({"action": "scroll", "direction": "left"}, "bad_arguments"),
    ({"action": "scroll", "direction": "down", "coordinate": [1, 2]}, "bad_arguments"),
    ({"action": "type", "coordinate": [1, 2], "text": "x", "enter": False}, "bad_arguments"),
    ({"action": "drag", "start_coordinate": [1, 2], "coordinate": [3, 4]}, "unknown_action"),
    ({"action": "press", "keys": ["Enter"]}, "unknown_action"),
    ({"action": "press", "keys": "Control+a"}, "unknown_action"),
]


@pytest.mark.parametrize(("arguments", "kind"), EXTENDED, ids=str)
def test_the_papers_space_stays_as_it_is(arguments: dict[str, Any], kind: str) -> None:
    assert problem_of(call(arguments)) == kind
    assert isinstance(parse_reply(call(arguments), "coordinates", "memory", space="extended"), ParsedReply)


@pytest.mark.parametrize(
    ("mode", "arguments", "kind"),
    [
        ("coordinates", {"action": "hover", "element": 3}, "wrong_mode"),
        ("coordinates", {"action": "drag", "start_element": 3, "coordinate": [1, 2]}, "wrong_mode"),
        ("coordinates", {"action": "drag", "coordinate": [1, 2]}, "bad_arguments"),
        ("marks", {"action": "hover", "element": 3, "coordinate": [1, 2]}, "bad_arguments"),
        ("marks", {"action": "hover", "coordinate": [1, 2000]}, "bad_target"),
        ("marks", {"action": "left_click", "element": 3, "modifiers": ["ctrl"]}, "bad_arguments"),
        ("marks", {"action": "type", "element": 3, "text": "x", "enter": "no"}, "bad_arguments"),
        ("marks", {"action": "press", "keys": []}, "bad_arguments"),
        ("marks", {"action": "press", "keys": ["Enter", 3]}, "bad_arguments"),
        ("marks", {"action": "press", "keys": ["  "]}, "bad_arguments"),
        ("marks", {"action": "scroll", "direction": "away"}, "bad_arguments"),
        ("marks", {"action": "upload", "element": 3}, "bad_arguments"),
        ("marks", {"action": "drag", "start_element": 3, "element": 4, "path": "[1, 2]"}, "bad_arguments"),
        ("marks", {"action": "drag", "start_element": 3, "element": 4, "path": [[1, 2, 3]]}, "bad_target"),
        ("marks", {"action": "drag", "start_element": 3, "element": 4, "path": [[1, 1001]]}, "bad_target"),
        (
            "marks",
            {"action": "drag", "start_element": 3, "element": 4, "path": [[1, 2]] * 101},
            "bad_arguments",
        ),
    ],
    ids=str,
)
def test_no_action_in_the_extended_space(mode: Mode, arguments: dict[str, Any], kind: str) -> None:
    parsed = parse_reply(call(arguments), mode, "memory", space="extended")
    assert isinstance(parsed, ParseError)
    assert parsed.kind == kind


def test_extended_actions() -> None:
    def read(arguments: dict[str, Any]) -> Action:
        parsed = parse_reply(call(arguments), "marks", "memory", space="extended")
        assert isinstance(parsed, ParsedReply), parsed
        return parsed.action

    drag = {"action": "drag", "start_element": 3, "coordinate": [1, 2]}
    assert read(drag) == Drag(Target(element=3), Target(coordinate=(1, 2)))
    curve = drag | {"path": [[5, 6], [7.5, 8]]}
    assert read(curve) == Drag(Target(element=3), Target(coordinate=(1, 2)), ((5, 6), (7.5, 8)))
    assert read({"action": "press", "keys": "Control+a"}) == Press(("Control+a",))
    assert read({"action": "press", "keys": [" "]}) == Press((" ",)), "the space bar"
    held = {"action": "left_click", "element": 3, "modifiers": "Shift"}
    assert read(held) == LeftClick(Target(element=3), ("Shift",))


def test_records_of_the_papers_space_are_written_as_they_were() -> None:
    written = {
        b'{"name":"left_click","target":{"element":3}}': LeftClick(Target(element=3)),
        b'{"name":"type","target":{"element":3},"text":"x"}': Type(Target(element=3), "x"),
        b'{"name":"scroll","direction":"down"}': Scroll("down"),
    }
    for line, action in written.items():
        assert msgspec.json.encode(action) == line
        assert msgspec.json.decode(line, type=Action) == action


def test_a_compact_reply_has_the_papers_actions_only() -> None:
    with pytest.raises(ValueError, match="compact"):
        AgentConfig(actions="extended", prompt_format="compact")
    assert AgentConfig().actions == "paper"


@pytest.mark.parametrize(("before", "after"), [('{"a": ', "}"), ("[", "]")])
@pytest.mark.parametrize(("depth", "is_read"), [(15, True), (300, False), (900, False), (100_000, False)])
def test_memory_that_is_nested_too_deeply_is_not_read(
    before: str, after: str, depth: int, *, is_read: bool
) -> None:
    deep = f'{{"a": {before * depth}1{after * depth}}}'
    parsed = parse_reply(f"Memory: {deep}\nProgress: {deep}\n{call(CLICK)}", "coordinates", "memory")
    assert isinstance(parsed, ParsedReply)
    assert parsed.action == CLICKED
    assert (parsed.memory is not None, parsed.progress is not None) == (is_read, is_read)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ("<thinking>", "</thinking>"),
        ("<THINK>", "</THINK>"),
        ("<thought>", "</thought>"),
        ("[THINK]", "[/THINK]"),
        ("◁think▷", "◁/think▷"),
    ],
)
def test_thinking_has_the_tags_of_many_families(start: str, end: str) -> None:
    perhaps, meant = call({"action": "go_back"}), call(CLICK)
    assert problem_of(f"{start}Perhaps {perhaps} but no.{end}\nI am not sure.") == "no_tool_call"
    assert problem_of(f"{start}Perhaps {perhaps}") == "unfinished_thinking"
    assert problem_of(f"{meant}{start}") == "late_thinking"
    assert action_of(f"{start}Perhaps {perhaps} but no.{end}\n{meant}") == CLICKED
    other = "</thought>" if "thought" not in start else "</think>"
    assert problem_of(f"{start}A tag {other} and {perhaps}{end}") == "no_tool_call"
    assert without_thinking(f"{start}Hm.{end}Yes.") == "Yes."
    for text in (f"{start}answer 1", f"{start}wait 1{end}"):
        assert isinstance(parse_reply(text, "coordinates", "compact"), ParseError)
