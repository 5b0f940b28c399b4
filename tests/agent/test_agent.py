from __future__ import annotations

import asyncio
import hashlib
import io
from typing import Any, Self

import msgspec
import pytest
from PIL import Image
from tests.agent.conftest import Play
from tests.agent.shop import Shop, task

from webgym.agent.agent import Agent, Dialogue
from webgym.agent.config import AgentConfig
from webgym.agent.formats import render_reply
from webgym.agent.policy import PolicyInput, PolicySession
from webgym.agent.profiles import choose_profile
from webgym.agent.scripted import RandomPolicy, ScriptedPolicy, create_policy
from webgym.core.action import Answer, DoubleClick, Drag, Hover, Press, RightClick, Scroll
from webgym.core.errors import ConfigError, PolicyBadReply, PolicyError, PolicyUnreachable, ProtocolError
from webgym.core.observation import Element, Observation
from webgym.core.task import Task
from webgym.core.trajectory import ImageRef, Reply, Revision, Step
from webgym.llm.config import ChatConfig

SCROLL = render_reply(Scroll("down"), "memory", description="Scroll down")


class Parrot:
    """Says what it was told to say, one reply after the other; raises what is an error."""

    name = "parrot"
    wants_elements = False

    def __init__(self, *replies: str | Reply | BaseException) -> None:
        self.replies = list(replies)
        self.turns: list[PolicyInput] = []
        self.entered = 0

    def begin(self, task: Task, seed: int) -> PolicySession:
        return self

    async def reply(self, turn: PolicyInput) -> Reply:
        self.turns.append(turn)
        said = self.replies.pop(0)
        if isinstance(said, BaseException):
            raise said
        return said if isinstance(said, Reply) else Reply(said, self.name)

    async def __aenter__(self) -> Self:
        self.entered += 1
        return self

    async def __aexit__(self, *exc: object) -> None:
        self.entered -= 1


class Silent(Parrot):
    async def reply(self, turn: PolicyInput) -> Reply:
        await asyncio.Event().wait()
        raise AssertionError


def observation(name: object) -> Observation:
    return Observation(f"picture-{name}", "http://mugs.webgym.test/", "Mugs", (1280, 768))


async def talk(policy: Parrot, *names: object, image: bytes = b"\x89PNG", **config: Any) -> list[Step]:
    conversation = Agent(policy, AgentConfig(**config)).begin(task(), 0, 15)
    return [await conversation.turn(observation(name), image, 1.5) for name in names]


async def test_a_step_is_the_exact_record() -> None:
    policy = Parrot(SCROLL, "Hm.")
    first, second = await talk(policy, 0, 1)
    assert (first.index, second.index) == (0, 1)
    assert first.action == Scroll("down")
    assert (second.action, second.parse_error) == (None, "no_tool_call: the reply holds no tool_call tag")
    assert first.reply == Reply(SCROLL, "parrot")
    assert second.messages == policy.turns[1].messages
    assert (first.changed, second.changed, first.at) == (None, None, 1.5)
    decoded = msgspec.json.decode(msgspec.json.encode(second), type=Step)
    assert decoded == second


async def test_the_effect_of_a_step_is_known_at_the_next() -> None:
    policy = Parrot(*[SCROLL] * 3)
    await talk(policy, 0, 0, 1)
    assert [step.changed for step in policy.turns[2].steps] == [False, True]
    assert "The screen is the same" in str(policy.turns[1].messages[-1])


async def test_only_the_pictures_of_the_window_are_kept() -> None:
    policy = Parrot(*[SCROLL] * 9)
    conversation = Agent(policy, AgentConfig(rounds=2)).begin(task(), 0, 15)
    for index in range(9):
        await conversation.turn(observation(index), f"{index}".encode(), 0)
    assert policy.turns[8].images == {"picture-6": b"6", "picture-7": b"7", "picture-8": b"8"}
    assert conversation._images.keys() == {"picture-7", "picture-8"}
    assert len(conversation.steps) == 9


async def test_memory_is_carried_and_mended() -> None:
    def said(**memory: Any) -> str:
        return render_reply(
            Scroll("up"), "memory", description="Up", memory=memory, progress={"a": "finished"}
        )

    policy = Parrot(said(price=5), said(size=7), SCROLL.replace("Memory: {}", "Memory: none"))
    conversation = Agent(policy).begin(task(), 0, 15)
    for index in range(3):
        await conversation.turn(observation(index), b"", 0)
    assert conversation.memory == {"price": 5, "size": 7}
    assert conversation.revisions == {1: Revision(dropped=("price",))}
    assert conversation.progress == {}
    third = str(policy.turns[2].messages)
    assert '"price": 5, "size": 7' in third
    assert "left out 'price'" in third


@pytest.mark.parametrize(
    "finish_reason", ["length", "LENGTH", "max_tokens", "max_output_tokens", "model_length"]
)
async def test_what_was_cut_off_is_not_an_action(finish_reason: str) -> None:
    """A compact action does not show where it ends: cut off, it could be another one."""

    def cut(text: str) -> Parrot:
        return Parrot(Reply(text, "parrot", finish_reason))

    for text in (
        "left_click 375 43",
        "answer The price is 1",
        "memory 1 = 7 ; progress ; intention ; wait 1",
    ):
        for prompt_format in ("compact", "compact_official"):
            (step,) = await talk(cut(text), 0, prompt_format=prompt_format)
            assert step.action is None
            assert "was too long and was cut off" in step.parse_error
    (step,) = await talk(cut(SCROLL), 0)
    assert step.action == Scroll("down"), "its end is marked"
    (step,) = await talk(cut(SCROLL[:-1]), 0)
    assert step.parse_error.endswith("; it was too long and was cut off")


@pytest.mark.parametrize("model", ["Qwen/Qwen3.5-9B", "somebody/new-thinker", "Qwen/Qwen3-VL-8B-Instruct"])
async def test_a_call_in_a_thought_that_was_cut_off_is_not_an_action(model: str) -> None:
    """The template may have opened the thinking, and no tag of it is in the reply."""
    draft = render_reply(Answer("not sure"), "memory", description="A draft")
    said = f"The user wants the price. A draft would be\n{draft}\nbut first I must open the page, becau"
    for name, finish_reason in ((model, "length"), (model, "max_tokens")):
        dialogue = Dialogue(task(), 15, AgentConfig(), choose_profile(None, name))
        await dialogue.request(observation(0), b"")
        step = dialogue.receive(Reply(said, name, finish_reason), 0)
        assert step.action is None
        assert step.parse_error.startswith("unfinished_thinking")
        assert dialogue.memory == {}


async def test_a_compact_reply_under_an_unknown_reason_is_the_endpoints_fault() -> None:
    policy = Parrot(*[Reply("wait 1", "parrot", "paused")] * 2)
    with pytest.raises(PolicyBadReply, match="paused"):
        await talk(policy, 0, prompt_format="compact")
    assert not policy.replies


async def test_a_policys_own_errors_pass_and_others_are_wrapped() -> None:
    with pytest.raises(PolicyUnreachable):
        await talk(Parrot(PolicyUnreachable("gone")), 0)
    with pytest.raises(PolicyError, match="the policy parrot failed: KeyError: 'x'") as caught:
        await talk(Parrot(KeyError("x")), 0)
    assert isinstance(caught.value.__cause__, KeyError)
    with pytest.raises(PolicyError, match="the policy parrot failed: CancelledError"):  # nobody cancelled us
        await talk(Parrot(asyncio.CancelledError()), 0)
    cancelled = asyncio.create_task(talk(Silent(), 0))
    await asyncio.sleep(0.01)
    cancelled.cancel()
    with pytest.raises(asyncio.CancelledError):
        await cancelled
    with pytest.raises(PolicyBadReply, match="not valid Unicode"):
        await talk(Parrot("\ud800"), 0)


@pytest.mark.parametrize(
    "rubbish",
    [
        {"seconds": float("nan")},
        {"seconds": -1.0},
        {"completion_tokens": -1},
        {"text": None},
        {"weight_version": 3},
        {"sampling": {"a": object()}},
    ],
)
async def test_a_reply_that_no_record_can_hold_is_the_policys_error(rubbish: dict[str, Any]) -> None:
    with pytest.raises(PolicyError, match="the reply cannot be recorded"):
        await talk(Parrot(Reply(**{"text": SCROLL, "policy": "parrot"} | rubbish)), 0)


async def test_after_an_error_the_same_turn_can_be_taken_again() -> None:
    policy = Parrot(SCROLL, PolicyUnreachable("gone"), SCROLL)
    conversation = Agent(policy).begin(task(), 0, 15)
    await conversation.turn(observation(0), b"", 0)
    with pytest.raises(PolicyUnreachable):
        await conversation.turn(observation(1), b"", 0)
    assert (await conversation.turn(observation(1), b"", 0)).index == 1
    assert policy.turns[1] == policy.turns[2]


def test_an_error_at_the_beginning_is_the_policys() -> None:
    class Fails(Parrot):
        def begin(self, task: Task, seed: int) -> PolicySession:
            raise RuntimeError("no")

    with pytest.raises(PolicyError, match="no"):
        Agent(Fails()).begin(task(), 0, 15)


async def test_pictures_are_scaled_down_once(png: bytes) -> None:
    policy = Parrot(SCROLL, SCROLL)
    steps = await talk(policy, 0, 0, image=png, image_max_side=320)
    sent = policy.turns[1].images["picture-0"]
    assert Image.open(io.BytesIO(sent)).size == (320, 192)
    assert sent is policy.turns[0].images["picture-0"]
    assert steps[0].messages[-1].content[-1] == ImageRef("picture-0", 320, 192)
    with pytest.raises(ProtocolError):
        await talk(Parrot(SCROLL), 0, image=b"no picture", image_max_side=320)


async def test_entering_the_agent_enters_the_policy() -> None:
    policy = Parrot()
    async with Agent(policy):
        assert policy.entered == 1
    assert policy.entered == 0


def test_who_wants_elements() -> None:
    assert Agent(ScriptedPolicy()).traits.elements
    assert not Agent(Parrot()).traits.elements
    assert Agent(Parrot(), AgentConfig(mode="marks")).traits.elements


# --- random play ----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["coordinates", "marks"])
async def test_random_play_is_readable_repeatable_and_ends(play: Play, mode: Any) -> None:
    async def digest(seed: int) -> str:
        agent = Agent(RandomPolicy(), AgentConfig(mode=mode))
        steps = await play(agent, Shop(banner=True), task(), seed=seed, budget=25)
        assert isinstance(steps[-1].action, Answer)
        assert {step.parse_error for step in steps} == {""}
        return hashlib.sha256("\n".join(step.reply.text for step in steps).encode()).hexdigest()

    first = [await digest(seed) for seed in range(6)]
    assert first == [await digest(seed) for seed in range(6)]
    assert len(set(first)) == 6


async def test_random_play_in_the_extended_space() -> None:
    agent = Agent(RandomPolicy(), AgentConfig(mode="marks", actions="extended"))
    conversation = agent.begin(task(), 1, 300)
    button = Element(1, "button", "Go", (0, 0, 50, 20))
    seen = msgspec.structs.replace(observation(0), elements=(button,))
    steps = [await conversation.turn(seen, b"", 0) for _ in range(150)]
    assert {step.parse_error for step in steps} == {""}
    done = {type(step.action) for step in steps}
    assert {Hover, DoubleClick, RightClick, Drag, Press} <= done


async def test_random_play_without_elements() -> None:
    conversation = Agent(RandomPolicy()).begin(task(), 1, 30)
    steps = [await conversation.turn(observation(index), b"", 0) for index in range(30)]
    assert all(step.action is not None for step in steps)
    assert isinstance(steps[-1].action, Answer)


# --- the factory ----------------------------------------------------------------------------------


def test_policies_by_name() -> None:
    assert create_policy("scripted", mistake_rate=0.2).name == "scripted"
    assert create_policy("random").name == "random"
    chat = ChatConfig(base_url="http://127.0.0.1:1/v1", model="tiny")
    assert create_policy("openai", chat=chat).name == "tiny"
    with pytest.raises(ConfigError, match="scripted, random, openai"):
        create_policy("clever")
    with pytest.raises(ConfigError, match="base URL"):
        create_policy("openai")
