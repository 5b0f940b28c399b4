from __future__ import annotations

import base64
import json
from collections.abc import AsyncIterator
from typing import Any

import pytest
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from tests.agent.shop import task
from tests.llm.endpoint import Endpoint, serve

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig
from webgym.agent.formats import render_reply
from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.profile import DEFAULT_SAMPLING
from webgym.core.action import LeftClick, Target
from webgym.core.errors import PolicyBadReply, PolicyError, PolicyTimeout, PolicyUnreachable
from webgym.core.observation import Observation
from webgym.core.trajectory import Step
from webgym.llm.config import ChatConfig, Retry, Sampling

CLICK = LeftClick(Target(coordinate=(512, 300)))


class Chooses(Endpoint):
    """Replies with the choice that a test sets."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.choice: dict[str, Any] = {}

    async def do_choice(self, request: Request) -> Response:
        return JSONResponse(self.completion(**self.choice))


@pytest.fixture
async def endpoint(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Chooses]:
    monkeypatch.setattr("tests.llm.endpoint.Endpoint", Chooses)
    async with serve() as endpoint:
        assert isinstance(endpoint, Chooses)
        endpoint.text = render_reply(CLICK, "memory", description="Click it")
        yield endpoint


async def talk(base_url: str, png: bytes, *, turns: int = 1, **config: Any) -> list[Step]:
    settings: dict[str, Any] = {"model": "tiny", "retry": Retry(tries=2, first_seconds=0.01)}
    chat = ChatConfig(base_url=base_url, **(settings | config))
    async with Agent(OpenAIPolicy(chat), AgentConfig(rounds=1)) as agent:
        conversation = agent.begin(task(), 0, 15)
        return [
            await conversation.turn(Observation(f"picture-{n}", "http://h/", "Mugs", (1280, 768)), png, 0)
            for n in range(turns)
        ]


async def test_a_turn_over_the_wire(endpoint: Endpoint, png: bytes) -> None:
    first, second = await talk(endpoint.url(), png, turns=2)
    assert first.action == CLICK
    assert (first.reply.policy, first.reply.finish_reason) == ("tiny-1", "stop")
    assert (first.reply.prompt_tokens, first.reply.completion_tokens) == (12, 3)
    assert first.reply.seconds > 0
    sent = endpoint.requests[1]["messages"]
    assert [message["role"] for message in sent] == ["system", "user", "assistant", "user"]
    assert isinstance(sent[0]["content"], str)
    assert sent[2]["content"] == endpoint.text
    text, image = sent[3]["content"]
    assert "Step 2 of 15" in text["text"]
    assert text["text"] == getattr(second.messages[3].content[0], "text", None)
    kind, _, data = image["image_url"]["url"].partition(";base64,")
    assert kind == "data:image/png"
    assert base64.b64decode(data) == png


@pytest.mark.parametrize(
    "sampling",
    [
        Sampling(),
        Sampling(top_p=0.9, extra_body={"top_k": 2}),
        Sampling(temperature=0, extra_body={"seed": 1}),
    ],
)
async def test_the_sampling_is_recorded_as_it_was_sent(
    endpoint: Endpoint, png: bytes, sampling: Sampling
) -> None:
    (step,) = await talk(endpoint.url(), png, sampling=sampling)
    sent = {k: v for k, v in endpoint.requests[0].items() if k not in ("model", "messages", "stream")}
    assert step.reply.sampling == sent
    assert sent == sampling.over(DEFAULT_SAMPLING).body()


@pytest.mark.parametrize(
    ("behaviour", "error"),
    [
        ("500", PolicyBadReply),
        ("html", PolicyBadReply),
        ("nothing", PolicyBadReply),
        ("stream", PolicyBadReply),
        ("flood", PolicyBadReply),
        ("truncated", PolicyBadReply),
        ("silent", PolicyTimeout),
    ],
)
async def test_a_bad_endpoint_is_a_policy_error(
    endpoint: Endpoint, png: bytes, behaviour: str, error: type[PolicyError]
) -> None:
    with pytest.raises(error) as caught:
        await talk(endpoint.url(behaviour), png, total_seconds=2, read_seconds=0.3)
    assert caught.value.hint
    assert caught.value.__cause__ is not None


async def test_nobody_listens(png: bytes) -> None:
    with pytest.raises(PolicyUnreachable):
        await talk("http://127.0.0.1:1/v1", png)


async def test_a_reply_without_an_action_is_a_step(endpoint: Chooses, png: bytes) -> None:
    endpoint.choice = {"message": {"content": None}}
    (step,) = await talk(endpoint.url("choice"), png)
    assert step.action is None
    assert step.parse_error.startswith("no_tool_call")


@pytest.mark.parametrize(
    ("reason", "tries"),
    [
        *((reason, 2) for reason in ("error", "abort", "CANCELLED", "insufficient_system_resource")),
        *((reason, 1) for reason in ("content_filter", "SAFETY", "content_filter: PROHIBITED_CONTENT")),
    ],
)
@pytest.mark.parametrize("content", [None, render_reply(CLICK, "memory", description="Click it")])
async def test_a_reply_that_the_endpoint_ended_is_its_fault(
    endpoint: Chooses, png: bytes, reason: str, tries: int, content: str | None
) -> None:
    endpoint.choice = {"message": {"role": "assistant", "content": content}, "finish_reason": reason}
    with pytest.raises(PolicyBadReply, match=f"finish_reason '{reason}'"):
        await talk(endpoint.url("choice"), png)
    assert len(endpoint.requests) == tries


async def test_an_unreadable_reply_is_the_models_only_if_the_model_is_known_to_have_ended_it(
    endpoint: Chooses, png: bytes
) -> None:
    for reason in ("stop", "LENGTH", "model_length", "end_turn", None):
        endpoint.choice = {"message": {"role": "assistant", "content": "Hm"}, "finish_reason": reason}
        (step,) = await talk(endpoint.url("choice"), png)
        assert step.parse_error
    endpoint.choice["finish_reason"] = "no_more_money"
    endpoint.requests.clear()
    with pytest.raises(PolicyBadReply, match="no_more_money"):
        await talk(endpoint.url("choice"), png)
    assert len(endpoint.requests) == 2
    endpoint.choice["message"]["content"] = endpoint.text
    (step,) = await talk(endpoint.url("choice"), png)
    assert step.action == CLICK


THOUGHT_CALL = render_reply(CLICK, "memory", description="Perhaps")


@pytest.mark.parametrize(
    ("message", "finish_reason", "found"),
    [
        ({"content": f"Hm.</think>{THOUGHT_CALL}"}, "stop", CLICK),
        ({"content": f"I could {THOUGHT_CALL} but"}, "length", "unfinished_thinking"),
        ({"content": f"I could {THOUGHT_CALL}"}, "stop", "unfinished_thinking"),
        ({"content": THOUGHT_CALL, "reasoning_content": "Hm."}, "stop", CLICK),
        ({"content": THOUGHT_CALL, "reasoning": "Hm.", "reasoning_content": None}, "stop", CLICK),
        ({"content": THOUGHT_CALL, "reasoning_content": ""}, "stop", CLICK),
        ({"content": THOUGHT_CALL, "reasoning": "", "reasoning_content": "Hm."}, "stop", CLICK),
        ({"content": None, "reasoning_content": f"I could {THOUGHT_CALL} but"}, "length", "no_tool_call"),
    ],
)
async def test_a_call_that_was_only_thought_of_is_none(
    endpoint: Chooses, png: bytes, message: dict[str, Any], finish_reason: str, found: object
) -> None:
    """A Thinking model's template opens the thinking; an endpoint may take it out of the reply."""
    endpoint.choice = {"message": {"role": "assistant"} | message, "finish_reason": finish_reason}
    first, second = await talk(endpoint.url("choice"), png, model="Qwen/Qwen3-VL-8B-Thinking", turns=2)
    assert found in (first.action, first.parse_error.partition(":")[0])
    assert first.reply.reasoning == (message.get("reasoning_content") or message.get("reasoning") or "")
    assert ("nothing but thinking" in first.parse_error) == (message["content"] is None)
    assert ("it was too long and was cut off" in str(second.messages[-1])) == (finish_reason == "length")
    assert "I could" not in str(second.messages)
    assert "Hm." not in str(second.messages)


@pytest.mark.parametrize("as_text", [True, False])
@pytest.mark.parametrize("content", [None, "Memory: {}\nAction: Click it"])
async def test_tool_calls_that_the_endpoint_has_parsed_are_read(
    endpoint: Chooses, png: bytes, *, as_text: bool, content: str | None
) -> None:
    arguments: Any = {"action": "left_click", "coordinate": [512, 300]}
    function = {"name": "computer_use", "arguments": json.dumps(arguments) if as_text else arguments}
    call = {"id": "1", "type": "function", "function": function}
    message = {"role": "assistant", "content": content, "tool_calls": [call]}
    endpoint.choice = {"message": message, "finish_reason": "tool_calls"}
    (step,) = await talk(endpoint.url("choice"), png)
    assert step.action == CLICK
    endpoint.choice["message"] = message | {"tool_calls": [call, call]}
    (step,) = await talk(endpoint.url("choice"), png)
    assert step.action is None, "two calls are no one action"
    for calls, problem in (([call, {"function": 7}], "several_tool_calls"), ({"name": 7}, "bad_arguments")):
        endpoint.choice["message"] = message | {"tool_calls": calls}
        (step,) = await talk(endpoint.url("choice"), png)
        assert step.parse_error.startswith(problem), "a call of another form is reported, not left out"
