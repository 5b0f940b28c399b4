from __future__ import annotations

import base64
from collections.abc import AsyncIterator
from typing import Any

import pytest
from tests.agent.shop import task
from tests.llm.endpoint import Endpoint, serve

from webgym.agent import Agent, AgentConfig, OpenAIPolicy
from webgym.agent.profile import DEFAULT_SAMPLING, PAPER_SAMPLING
from webgym.agent.prompts import render_reply
from webgym.core.action import LeftClick, Target
from webgym.core.errors import PolicyBadReply, PolicyError, PolicyTimeout, PolicyUnreachable
from webgym.core.observation import Observation
from webgym.core.trajectory import Step
from webgym.llm import ChatConfig, Retry, Sampling

CLICK = LeftClick(Target(coordinate=(512, 300)))


@pytest.fixture
async def endpoint() -> AsyncIterator[Endpoint]:
    async with serve() as endpoint:
        endpoint.text = render_reply(CLICK, "memory", description="Click it")
        yield endpoint


async def talk(base_url: str, png: bytes, *, turns: int = 1, **config: Any) -> list[Step]:
    settings: dict[str, Any] = {"retry": Retry(tries=2, first_seconds=0.01)}
    chat = ChatConfig(base_url=base_url, model="tiny", **(settings | config))
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
    "sampling", [Sampling(), PAPER_SAMPLING, Sampling(temperature=0, extra_body={"seed": 1})]
)
async def test_the_sampling_is_recorded_as_it_was_sent(
    endpoint: Endpoint, png: bytes, sampling: Sampling
) -> None:
    (step,) = await talk(endpoint.url(), png, sampling=sampling)
    sent = {k: v for k, v in endpoint.requests[0].items() if k not in ("model", "messages", "stream")}
    assert step.reply.sampling == sent
    assert sent == (DEFAULT_SAMPLING if sampling == Sampling() else sampling).body()


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


async def test_a_reply_without_an_action_is_a_step(endpoint: Endpoint, png: bytes) -> None:
    (step,) = await talk(endpoint.url("bare"), png)
    assert step.action is None
    assert step.parse_error.startswith("no_tool_call")
