"""The compact formats: what is written is read back, and nothing else is an action."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.agent.strategies import actions

from webgym.agent.formats import parse_reply, render_reply
from webgym.agent.parser import ParsedReply, ParseError
from webgym.core.action import Action, Answer, LeftClick, Target

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
KEYS = TEXTS.filter(lambda text: bool(text.strip()))


def test_a_reply_is_one_line_of_words() -> None:
    text = render_reply(
        LeftClick(Target(coordinate=(375, 437))),
        "compact",
        description="",
        memory={"1": "7", "2": "red moon"},
        progress={"1": "finished", "2": "not finished"},
        intention="2 red moon",
    )
    assert (
        text == "memory 1 = 7 , 2 = red moon ; progress 1 + 2 - ; intention 2 red moon ; left_click 375 437"
    )


@given(actions("coordinates"), st.dictionaries(KEYS, TEXTS, max_size=3), st.dictionaries(KEYS, st.booleans()))
def test_what_is_written_is_read_back(action: Action, memory: dict[str, str], done: dict[str, bool]) -> None:
    progress = {key: "finished" if value else "not finished" for key, value in done.items()}
    text = render_reply(action, "compact", description="", memory=memory, progress=progress, intention="1")
    parsed = parse_reply(text, "coordinates", "compact")
    call = text.rpartition(" ; intention 1 ; ")[2]
    alone = parse_reply(
        render_reply(action, "compact_official", description=""),
        "coordinates",
        "compact_official",
    )
    assert isinstance(parsed, ParsedReply)
    assert isinstance(alone, ParsedReply)
    assert parsed.memory == memory
    assert parsed.progress == progress
    assert parsed.action == alone.action
    again = render_reply(parsed.action, "compact_official", description="")
    assert again.split() == call.split()


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("", "no_tool_call"),
        ("memory 1 = 2", "no_tool_call"),
        ("memory ; progress 1 -", "no_tool_call"),
        ("answer", "bad_arguments"),
        ("left_click 1", "bad_target"),
        ("left_click 5 2000", "bad_target"),
        ("left_click 1 2 3", "bad_arguments"),
        ("left_click nan 2", "bad_target"),
        ("scroll left", "bad_arguments"),
        ("go_back now", "bad_arguments"),
        ("jump 1 2", "unknown_action"),
        ("I would click 1 2", "no_tool_call"),
        ("<think> answer 1", "unfinished_thinking"),
    ],
)
def test_what_spells_out_no_action_is_none(text: str, kind: str) -> None:
    parsed = parse_reply(text, "coordinates", "compact")
    assert isinstance(parsed, ParseError)
    assert parsed.kind == kind


@pytest.mark.parametrize(
    "memory", ["1", "= 7", "1 =", "1 = 2 = 3", "1 = 7 , 1 = 8", '1 = "open', ", ,", "1 = 7 ,"]
)
def test_a_section_that_cannot_be_read_does_not_spoil_the_action(memory: str) -> None:
    if memory.count('"') % 2:
        assert isinstance(parse_reply(f"memory {memory} ; answer 7", "coordinates", "compact"), ParseError)
        return
    parsed = parse_reply(f"memory {memory} ; progress 1 * ; answer 7", "coordinates", "compact")
    assert isinstance(parsed, ParsedReply)
    assert parsed.memory is None
    assert parsed.progress is None
    assert parsed.action == Answer("7")


def test_the_time_is_linear_in_the_length() -> None:
    started = time.process_time()
    for piece in (" ", '"', '\\"', "a", "1 = 2 ,", "1 + ", ";", "memory "):
        for head in ("memory ", 'memory "', "progress ", "left_click "):
            parse_reply(head + piece * 20_000, "coordinates", "compact")
    assert time.process_time() - started < 20
