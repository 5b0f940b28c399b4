from __future__ import annotations

import datetime
import json
from typing import Any, get_args

import pytest
from msgspec.structs import replace
from tests.agent.shop import task

from webgym.agent.config import AgentConfig
from webgym.agent.context import AttemptPosition, Round, describe, picture_names
from webgym.agent.formats import build_request, parse_reply, render_reply
from webgym.agent.profiles import choose_profile
from webgym.agent.prompts import system_prompt, tool_declaration
from webgym.core.action import Answer, GoBack, LeftClick, Scroll, Target
from webgym.core.observation import Notice, NoticeKind, Observation
from webgym.core.task import MAX_ATTACHED_BYTES, Attachment
from webgym.core.trajectory import ImageRef, Message, Reply, Revision, Step, TextPart

TASK = task()
THOUGHT = "<think>Secret thought.</think>"


def observation(index: int, **changes: Any) -> Observation:
    seen = Observation(f"picture-{index}", f"http://mugs.webgym.test/{index}", f"Page {index}", (1280, 768))
    return replace(seen, **changes)


def past(index: int, *, changed: bool = True, text: str | None = None, **seen: Any) -> Round:
    said = text or THOUGHT + render_reply(
        LeftClick(Target(coordinate=(index, index))),
        "memory",
        description=f"Click number {index}.",
        memory={},
    )
    step = Step(index, observation(index, **seen), (), Reply(said, "test"), changed=changed)
    return Round(step, parse_reply(said, "coordinates", "memory"))


def build(before: list[Round], /, now: AttemptPosition | None = None, **config: Any) -> tuple[Message, ...]:
    now = now or AttemptPosition(observation(len(before)), len(before), 15)
    settings = AgentConfig(**config)
    return build_request(TASK, before, now, settings, choose_profile(None, "test", settings.mode)).messages


def said(message: Message) -> str:
    return "".join(part.text for part in message.content if isinstance(part, TextPart))


def pictures(messages: tuple[Message, ...]) -> list[str]:
    return [part.screenshot for m in messages for part in m.content if isinstance(part, ImageRef)]


def test_the_first_request() -> None:
    system, user = build([])
    assert system.role == "system"
    assert said(system) == system_prompt(AgentConfig())
    assert user.role == "user"
    assert TASK.instruction in said(user)
    assert TASK.website in said(user)
    assert "Memory so far: {}" in said(user)
    assert "Step 1 of 15" in said(user)
    assert user.content[-1] == ImageRef("picture-0", 1280, 768)


def test_the_window_holds_the_last_rounds_and_the_rest_is_told() -> None:
    rounds = [past(index, changed=index != 1) for index in range(7)]
    messages = build(rounds, rounds=3)
    assert [m.role for m in messages] == ["system", "user", *(["assistant", "user"] * 3)]
    assert pictures(messages) == ["picture-4", "picture-5", "picture-6", "picture-7"]
    opening = said(messages[1])
    assert "1. Click number 0. - the page changed." in opening
    assert "2. Click number 1. - nothing changed." in opening
    assert "Click number 4" not in opening
    assert sum(TASK.instruction in said(message) for message in messages) == 1
    assert picture_names(messages) == {"picture-4", "picture-5", "picture-6", "picture-7"}


def test_no_window_at_all() -> None:
    messages = build([past(0), past(1)], rounds=0)
    assert [m.role for m in messages] == ["system", "user"]
    assert pictures(messages) == ["picture-2"]
    assert "2. Click number 1." in said(messages[1])


def test_thoughts_are_left_out_of_the_history() -> None:
    rounds = [past(0), past(1, text="<think>Secret, and never done"), past(2, text=f"{THOUGHT}\n\nHm.")]
    messages = build(rounds)
    replies = [said(message) for message in messages if message.role == "assistant"]
    assert replies[0].startswith("Memory: {}")
    assert replies[0].endswith("</tool_call>")
    assert replies[1:] == ["(no reply)", "Hm."]
    assert "Secret" not in str(messages)


@pytest.mark.parametrize("prompt_format", ["memory", "official", "compact", "compact_official"])
def test_no_message_of_a_request_is_empty(prompt_format: str) -> None:
    """Some endpoints answer it with 400."""
    rounds = [past(0, text=" "), past(1, text="<think>Hm"), past(2, text="<think>Hm</think>\n")]
    messages = build(rounds, prompt_format=prompt_format)
    assert [said(message) for message in messages if message.role == "assistant"] == ["(no reply)"] * 3


def test_nothing_hidden_is_told() -> None:
    hidden = replace(observation(0), text="HIDDEN TEXT", elements=())
    assert "HIDDEN" not in str(build([], AttemptPosition(hidden, 0, 15)))


@pytest.mark.parametrize("kind", get_args(NoticeKind))
def test_every_notice_is_told_with_its_observation(kind: NoticeKind) -> None:
    messages = build([past(0, notices=(Notice(kind, "what\nhappened"),)), past(1)])
    assert "Note: " in said(messages[1])
    assert "what happened" in said(messages[1])
    assert "what happened" not in said(messages[-1])


def test_an_unchanged_screen_is_told_once() -> None:
    (*_, last) = build([past(0, changed=False)])
    assert said(last).count("The screen is the same as before") == 1
    noticed = observation(1, notices=(Notice("unchanged", ""),))
    (*_, last) = build([past(0, changed=False)], AttemptPosition(noticed, 1, 15))
    assert said(last).count("The screen is the same as before") == 1
    (*_, last) = build([past(0, changed=True)])
    assert "The screen is the same" not in said(last)


def test_an_unreadable_reply_is_told_with_its_reason() -> None:
    rounds = [past(0, text="Let me think.", changed=False)]
    (*_, last) = build(rounds)
    assert "Your last reply held no action" in said(last)
    assert "holds no tool_call tag" in said(last)
    assert "The screen is the same" not in said(last)
    (_, user) = build(rounds, rounds=0)
    assert "1. Your reply held no action (no_tool_call)." in said(user)


def test_http_errors_and_scrolling_are_told() -> None:
    seen = observation(0, status=404, scroll=(200.0, 3000.0))
    (_, user) = build([], AttemptPosition(seen, 0, 15))
    assert "HTTP error 404" in said(user)
    assert "scrolled to 200 of 3000 px" in said(user)
    assert "HTTP error" not in str(build([]))


def test_the_memory_and_what_was_mended_are_told() -> None:
    revision = Revision(dropped=("a",), rewritten=("b",), refused=("c",))
    now = AttemptPosition(observation(1), 1, 15, {"a": 1, "ü": "€"}, revision)
    messages = build([past(0)], now)
    assert 'Memory so far: {"a": 1, "ü": "€"}' in said(messages[1])
    assert "append-only" in said(messages[-1])
    assert all(f"'{key}'" in said(messages[-1]) for key in "abc")


def test_the_official_prompt_has_no_memory() -> None:
    messages = build([past(0)], prompt_format="official")
    assert "Memory" not in str(messages[0]) + str(messages[-1])
    assert "Memory so far" not in str(messages)


def test_long_things_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.agent.standard.SUMMARY_LINE_MAX_CHARS", 50)
    rounds = [past(0, text=render_reply(Answer("a" * 900), "memory", description="b" * 900))]
    seen = observation(
        1, title="t" * 9000, url="http://h/" + "u" * 9000, notices=(Notice("dialog", "d" * 9000),)
    )
    (_, user) = build(rounds, AttemptPosition(seen, 1, 15), rounds=0)
    assert len(said(user)) < 2500


def test_pictures_are_told_at_the_size_at_which_they_are_sent() -> None:
    (_, user) = build([], image_max_side=640)
    assert user.content[-1] == ImageRef("picture-0", 640, 384)


@pytest.mark.parametrize("mode", ["coordinates", "marks"])
def test_the_tool_is_declared_for_its_mode(mode: Any) -> None:
    prompt = system_prompt(AgentConfig(), mode)
    declared = json.loads(prompt.partition("<tools>\n")[2].partition("\n</tools>")[0])
    assert declared == tool_declaration(mode)
    assert declared["function"]["name"] == "computer_use"
    # Marks are named, not pointed at: a size would be of no use there, and would not be the picture's.
    assert ("1000x1000" in declared["function"]["description"]) == (mode != "marks")
    properties = declared["function"]["parameters"]["properties"]
    assert ("element" in properties, "coordinate" in properties) == (mode == "marks", mode != "marks")
    assert properties["action"]["enum"] == [
        "left_click",
        "type",
        "scroll",
        "wait",
        "go_back",
        "navigate",
        "answer",
    ]
    other = "coordinate" if mode == "marks" else "element`"
    assert other not in prompt


def test_the_prompt_names_captchas_and_the_date_if_there_is_one() -> None:
    assert "CAPTCHA" in system_prompt(AgentConfig())
    assert "Today is" not in system_prompt(AgentConfig())
    today = AgentConfig(today=datetime.date(2026, 3, 1))
    assert "Today is Sunday, 1 March 2026." in system_prompt(today)


def test_the_parts_of_a_reply_are_asked_for_in_order() -> None:
    prompt = system_prompt(AgentConfig())
    places = [prompt.index(f"\n{part}:") for part in ("Memory", "Progress", "Intention", "Action")]
    assert places == sorted(places)
    assert '{"name": "computer_use", "arguments": {"action": ..., ...}}' in prompt
    official = system_prompt(AgentConfig(prompt_format="official"))
    assert "\nMemory:" not in official
    assert "\nAction:" in official


def test_actions_in_few_words() -> None:
    assert describe(LeftClick(Target(coordinate=(512, 300)))) == "left_click coordinate [512, 300]"
    assert describe(Scroll("down")) == "scroll direction 'down'"
    assert describe(GoBack()) == "go_back"
    assert len(describe(Answer("a" * 1000))) == 200


def test_files_of_the_task_are_named_where_they_can_be_chosen() -> None:
    files = (Attachment("cv.txt", text="Ann"), Attachment("photo.png", data=b"1234"))

    def opening(**config: Any) -> str:
        settings = AgentConfig(**config)
        now = AttemptPosition(observation(0), 0, 15)
        profile = choose_profile(None, "test", settings.mode)
        return said(build_request(replace(TASK, files=files), [], now, settings, profile).messages[1])

    assert "'cv.txt' (3 bytes), 'photo.png' (4 bytes)" in opening(actions="extended")
    assert "cv.txt" not in opening()


@pytest.mark.parametrize("name", ["../x", "a/b", "", "..", "a\x00b", "x" * 300, "a\\b"])
def test_a_file_has_a_plain_name(name: str) -> None:
    with pytest.raises(ValueError, match="not a valid file name"):
        Attachment(name)


def test_files_of_a_task_have_bounds() -> None:
    with pytest.raises(ValueError, match="have the same name"):
        replace(TASK, files=(Attachment("a"), Attachment("a")))
    with pytest.raises(ValueError, match="bytes"):
        replace(TASK, files=(Attachment("a", text="x" * MAX_ATTACHED_BYTES), Attachment("b", text="x")))
