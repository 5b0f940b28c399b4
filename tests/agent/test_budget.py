"""No request is longer than the endpoint takes: estimates err upwards, and what goes first is fixed."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import AsyncIterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from starlette.requests import Request as HttpRequest
from starlette.responses import JSONResponse, Response
from tests.agent.shop import task
from tests.agent.test_context import observation, past, pictures, said
from tests.llm.endpoint import Endpoint, serve

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig
from webgym.agent.context import AttemptPosition, Cut, Request, request_tokens, text_tokens
from webgym.agent.formats import build_request, render_reply
from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.profiles import all_profiles
from webgym.agent.prompts import system_prompt
from webgym.core.action import Scroll
from webgym.core.errors import PolicyBadReply, PolicyError
from webgym.core.trajectory import Message, Step
from webgym.llm.config import ChatConfig, Sampling

QWEN = all_profiles()["qwen3-vl"]
ROUNDS = [past(index) for index in range(9)]
MEMORY = {f"fact {number}": "x" * 100 for number in range(5)}


def build(**config: Any) -> Request:
    settings = AgentConfig(**{"rounds": 3} | config)
    return build_request(task(), ROUNDS, AttemptPosition(observation(9), 9, 15, MEMORY), settings, QWEN)


def replies(messages: tuple[Message, ...]) -> int:
    return sum(message.role == "assistant" for message in messages)


@pytest.mark.parametrize(
    ("text", "tokens"),
    [  # as the vocabulary of Qwen counts
        ("You carry out tasks on the web for a user. You see the browser as screenshots.", 18),
        ("https://www.example-shop.co.uk/products/search?q=blue%20mug&sort=price_asc&sid=8f3a9c22-77bd", 37),
        ('{"price of the mug": "12 €", "n": [1, 2, 3]}', 23),
        ("größere Übersicht der Öffnungszeiten", 14),
        ("Epäjärjestelmällisyydestään huolimatta käyttäjä löysi haluamansa tuotteen", 29),
        ("Все люди рождаются свободными и равными в своём достоинстве и правах", 21),
        ("Όλοι οι άνθρωποι γεννιούνται ελεύθεροι και ίσοι στην αξιοπρέπεια", 57),
        ("人人生而自由，在尊严和权利上一律平等。", 12),
        ("すべての人間は、生まれながらにして自由であり", 10),
        ("모든 인간은 태어날 때부터 자유로우며", 14),
        ("सभी मनुष्यों को गौरव और अधिकारों के मामले में", 41),
        ("🎉🔥👨‍👩‍👧‍👦🏳️‍🌈🇩🇪🇯🇵✨💯🤷🏽‍♀️", 29),
        ("8f3a9c2277bd4a1e", 15),
        ("zqxjkvbwpyfmgdlhrcuntisoaezqxjkvbwpyfmgdlhr", 24),
        ("123456789012 3.14159", 20),
        ("a   \n\n\n  b\t\t\tc", 7),
    ],
)
def test_texts_are_never_longer_than_they_are_taken_for(text: str, tokens: int) -> None:
    assert tokens <= text_tokens(text) <= 6 * tokens


def test_the_prompt_is_taken_for_little_more_than_it_is() -> None:
    assert 800 < text_tokens(system_prompt(AgentConfig())) < 1.7 * 814  # as the vocabulary of Qwen counts


@given(st.text(max_size=200), st.text(max_size=200))
def test_longer_texts_are_not_shorter(one: str, other: str) -> None:
    assert 0 <= text_tokens(one) <= text_tokens(f"{one}\n{other}")
    assert text_tokens(one) <= 3 * len(one)


def test_what_fits_is_not_trimmed() -> None:
    request = build()
    assert request.cut == Cut()
    assert pictures(request.messages) == ["picture-6", "picture-7", "picture-8", "picture-9"]
    length = request_tokens(request.messages, QWEN)
    assert 4 * 962 < length < 4 * 962 + 3000
    assert build(request_tokens=length) == request
    assert build(request_tokens=length - 1).cut == Cut(pictures=1)


def test_what_goes_first() -> None:
    """Screenshots, lines, rounds, entries, oldest first each; never the task and the present."""
    seen = [build()]
    while seen[-1].cut.entries < len(MEMORY):
        length = request_tokens(seen[-1].messages, QWEN) - 1
        seen.append(build(request_tokens=length))
        assert request_tokens(seen[-1].messages, QWEN) <= length
    order = [(each.cut.pictures, each.cut.lines, each.cut.rounds, each.cut.entries) for each in seen]
    assert order == sorted(order)
    stages = [sum(part > 0 for part in each) for each in order]
    assert stages == sorted(stages)
    assert order[-1] == (3, 9, 3, 5)
    one, *_, last = seen
    assert one.cut == Cut()
    for request in seen:
        assert pictures(request.messages)[-1] == "picture-9"
        assert task().instruction in said(request.messages[1])
        left_out = str(request.messages).count("The screenshot of this step is left out")
        assert left_out == request.cut.pictures - request.cut.rounds
        assert replies(request.messages) == 3 - request.cut.rounds
    assert [message.role for message in last.messages] == ["system", "user"]
    assert "(The first 9 are left out.)" in said(last.messages[1])
    assert "(The 5 oldest entries are kept but left out here.)" in said(last.messages[1])
    with pytest.raises(PolicyError, match="at its shortest") as caught:
        build(request_tokens=request_tokens(last.messages, QWEN) - 1)
    assert "request_tokens" in caught.value.hint


def test_an_endpoint_may_limit_the_pictures() -> None:
    request = build(max_images=2)
    assert pictures(request.messages) == ["picture-8", "picture-9"]
    assert replies(request.messages) == 3
    assert pictures(build(max_images=1).messages) == ["picture-9"]


class Narrow(Endpoint):
    """Answers 400 to what is longer than its context, as its own way of counting has it."""

    context = 0
    longest = 0

    async def do_narrow(self, request: HttpRequest) -> Response:
        length = sum(self._length(message["content"]) for message in (await request.json())["messages"])
        self.longest = max(self.longest, length)
        if length > self.context:
            told = f"This model's maximum context length is {self.context} tokens, you sent {length}"
            return JSONResponse({"error": {"message": told}}, 400)
        return JSONResponse(self.completion())

    def _length(self, content: Any) -> int:
        if isinstance(content, str):
            return 5 + len(re.findall(r"[a-z]{1,6}|\d|\S", content, re.IGNORECASE))
        texts = [self._length(part["text"]) for part in content if part["type"] == "text"]
        urls = [part["image_url"]["url"] for part in content if part["type"] == "image_url"]
        sizes = [Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))).size for url in urls]
        return sum(texts) + sum(width * height // 1024 + 2 for width, height in sizes)


@pytest.fixture
async def narrow(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Narrow]:
    monkeypatch.setattr("tests.llm.endpoint.Endpoint", Narrow)
    async with serve() as endpoint:
        assert isinstance(endpoint, Narrow)
        yield endpoint


async def converse(endpoint: Narrow, png: bytes, context: int, turns: int) -> list[Step]:
    endpoint.context = context
    chat = ChatConfig(
        base_url=endpoint.url("narrow"), model="Qwen/Qwen3-VL-8B-Instruct", sampling=Sampling(max_tokens=512)
    )
    steps = []
    async with Agent(OpenAIPolicy(chat), AgentConfig(request_tokens=context)) as agent:
        conversation = agent.begin(task(), 0, 99)
        for index in range(turns):
            memory = {f"fact {number}": f"The price is {number} €." for number in range(index + 1)}
            endpoint.text = render_reply(
                Scroll("down"), "memory", description=f"Scroll on {index}", memory=memory
            )
            steps.append(await conversation.turn(observation(index), png, 0))
        assert len(conversation.memory) == turns
        assert not conversation.revisions
    return steps


@pytest.mark.parametrize("context", [3000, 4500, 30_000])
async def test_an_endpoint_never_has_to_refuse(narrow: Narrow, png: bytes, context: int) -> None:
    steps = await converse(narrow, png, context, 25)
    assert all(step.action for step in steps)
    assert narrow.longest > 0.55 * min(context, 8000)  # and its context is made use of


async def test_without_a_budget_it_would(narrow: Narrow, png: bytes) -> None:
    narrow.context = 4500
    chat = ChatConfig(base_url=narrow.url("narrow"), model="Qwen/Qwen3-VL-8B-Instruct")
    narrow.text = render_reply(Scroll("down"), "memory", description="Scroll")
    async with Agent(OpenAIPolicy(chat)) as agent:
        conversation = agent.begin(task(), 0, 99)
        for index in range(3):
            await conversation.turn(observation(index), png, 0)
        with pytest.raises(PolicyBadReply, match="400"):
            await conversation.turn(observation(3), png, 0)


async def test_what_was_left_out_of_sight_may_be_left_out_of_a_reply(narrow: Narrow, png: bytes) -> None:
    """An agent that repeats only the memory it was shown has dropped nothing."""
    narrow.context = 30_000
    chat = ChatConfig(base_url=narrow.url("narrow"), model="qwen3-vl")
    memory = {f"fact {number}": "word " * 60 for number in range(20)}
    narrow.text = render_reply(Scroll("down"), "memory", description="Scroll", memory=memory)
    async with Agent(OpenAIPolicy(chat), AgentConfig(request_tokens=3500)) as agent:
        conversation = agent.begin(task(), 0, 99)
        await conversation.turn(observation(0), png, 0)
        shown = {key: memory[key] for key in list(memory)[-5:]}
        narrow.text = render_reply(Scroll("down"), "memory", description="Scroll", memory=shown)
        step = await conversation.turn(observation(1), png, 0)
    assert "oldest entries are kept" in said(step.messages[1])
    assert len(conversation.memory) == 20
    left_out = 20 - said(step.messages[1]).count('"fact ')
    assert step.revision is None or len(step.revision.dropped) == 20 - left_out - 5
