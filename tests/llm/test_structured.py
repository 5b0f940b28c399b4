from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import pytest
from tests.llm.endpoint import Endpoint

from webgym.core.errors import LLMUnusable
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient, EndpointRefused
from webgym.llm.completion import Completion
from webgym.llm.config import ChatConfig, Retry, Sampling
from webgym.llm.structured import ask_for, strict_schema

MESSAGES = [{"role": "system", "content": "Be brief."}, {"role": "user", "content": "How old is she?"}]


class Age(msgspec.Struct):
    name: str
    years: int
    notes: list[str] = []


class Tree(msgspec.Struct):
    leaf: str
    children: list[Tree] = []


GOOD = '{"name": "Ada", "years": 36}'


def says(content: str | None, finish_reason: str = "stop", **message: Any) -> dict[str, Any]:
    return {"message": {"role": "assistant", "content": content} | message, "finish_reason": finish_reason}


def client(endpoint: Endpoint, cache: ReplyCache | None = None, **changes: Any) -> ChatClient:
    retry = Retry(tries=1)
    config = ChatConfig(base_url=endpoint.url("scripted"), model="tiny", retry=retry, **changes)
    return ChatClient(config, cache=cache)


async def test_a_value_of_the_type(endpoint: Endpoint) -> None:
    endpoint.replies = [says(GOOD)]
    async with client(endpoint, sampling=Sampling(temperature=0, extra_body={"top_k": 1})) as model:
        assert await ask_for(model, MESSAGES, Age) == Age("Ada", 36)
    [request] = endpoint.requests
    assert request["messages"] == MESSAGES
    assert (request["temperature"], request["top_k"]) == (0, 1)
    form = request["response_format"]
    assert form["type"] == "json_schema"
    assert form["json_schema"]["strict"]
    schema = form["json_schema"]["schema"]
    assert list(schema["properties"]) == schema["required"] == ["name", "years", "notes"]
    assert schema["additionalProperties"] is False


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (says("Sure! Here it is:"), "not valid JSON"),
        (says('{"name": "Ada", "years":'), "not valid JSON"),
        (says('{"name": "Ada", "years": "36"}'), "$.years"),
        (says('{"name": "Ada"}'), "years"),
        (says("[1, 2]"), "not as asked for"),
        (says(""), "empty"),
        (says(None), "empty"),
        (says(GOOD, "length"), "cut off"),
        (says(GOOD, "MAX_TOKENS"), "cut off"),
        (says(GOOD, "content_filter"), "refusal"),
        (says(None, refusal="I'd rather not."), "refusal"),
        (says("<think>hm, " + GOOD), "all thinking"),
        (says(GOOD + GOOD), "not valid JSON"),
        (says("[" * 100_000), "not as asked for"),
        (says('{"name": "\\ud800", "years": 1}'), "not valid JSON"),
        (says('{"name": "Ada", "years": -1}'), "no age"),
    ],
)
async def test_a_reply_that_is_refused_is_asked_for_again_with_the_reason(
    endpoint: Endpoint, bad: dict[str, Any], reason: str
) -> None:
    endpoint.replies = [bad, says(GOOD)]

    def check(age: Age) -> str | None:
        return "that is no age" if age.years < 0 else None

    async with client(endpoint) as model:
        assert await ask_for(model, MESSAGES, Age, check=check) == Age("Ada", 36)
    first, second = endpoint.requests
    assert second["messages"][:2] == first["messages"] == MESSAGES
    assistant, user = second["messages"][2:]
    assert assistant["role"] == "assistant"
    assert assistant["content"]
    assert len(assistant["content"]) < 5000
    assert user["role"] == "user"
    assert reason in user["content"]


async def test_asking_is_bounded_and_all_replies_are_told(endpoint: Endpoint) -> None:
    endpoint.replies = [says("no"), says(None, refusal="never"), says('{"name": 1, "years": 2}')]
    async with client(endpoint) as model:
        with pytest.raises(LLMUnusable, match="asked 3 times") as caught:
            await ask_for(model, MESSAGES, Age)
    assert caught.value.replies == ("no", "never", '{"name": 1, "years": 2}')
    assert "$.name" in caught.value.reason
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        f"```json\n{GOOD}\n```",
        f"```\n{GOOD}\n```",
        f"<think>{{}}</think>\n\n{GOOD}",
        f"The template opened this.</think>\n\n{GOOD}",
        f"<think>One </think> tag.</think>{GOOD}",
        f"\n{GOOD} ",
    ],
)
async def test_fences_and_thinking_are_no_part_of_the_value(endpoint: Endpoint, text: str) -> None:
    endpoint.replies = [says(text)]
    async with client(endpoint) as model:
        assert await ask_for(model, MESSAGES, Age) == Age("Ada", 36)


@pytest.mark.parametrize(
    ("refused", "taken"),
    [({"json_schema"}, {"type": "json_object"}), ({"json_schema", "json_object"}, None)],
)
async def test_an_endpoint_that_knows_no_schemas_is_told_in_words(
    endpoint: Endpoint, refused: set[str], taken: dict[str, str] | None
) -> None:
    endpoint.refused_formats = refused
    endpoint.replies = [says(GOOD), says(GOOD)]
    async with client(endpoint) as model:
        for _ in range(2):
            assert await ask_for(model.labelled("ages"), MESSAGES, Age) == Age("Ada", 36)
    forms = [request.get("response_format") for request in endpoint.requests]
    assert forms[-2:] == [taken, taken]
    assert len(forms) == len(refused) + 2  # each was tried once
    last = endpoint.requests[-1]["messages"][-1]["content"]
    assert last.startswith(MESSAGES[-1]["content"])
    assert '"required":["name","years","notes"]' in last


async def test_what_was_refused_outlasts_the_process(endpoint: Endpoint, tmp_path: Any) -> None:
    endpoint.refused_formats = {"json_schema"}
    endpoint.replies = [says(GOOD)]
    for _ in range(2):
        async with ReplyCache(tmp_path / "replies") as cache, client(endpoint, cache) as model:
            assert await ask_for(model, MESSAGES, Age) == Age("Ada", 36)
    assert len(endpoint.requests) == 2  # one refused, one answered; nothing the second time


async def test_what_is_wrong_in_any_format_teaches_nothing(endpoint: Endpoint) -> None:
    endpoint.refused_formats = {"json_schema", "json_object", "text"}
    async with client(endpoint) as model:
        with pytest.raises(EndpointRefused, match="json_schema is not supported"):
            await ask_for(model, MESSAGES, Age)
        assert await model.formats.known() == "json_schema"


async def test_pictures_keep_their_place(endpoint: Endpoint) -> None:
    endpoint.refused_formats = {"json_schema"}
    endpoint.replies = [says(GOOD)]
    parts = [{"type": "text", "text": "Look."}]
    async with client(endpoint) as model:
        await ask_for(model, [{"role": "user", "content": parts}], Age)
    content = endpoint.requests[-1]["messages"][-1]["content"]
    assert content[0] == parts[0]
    assert "schema" in content[1]["text"]
    assert len(parts) == 1


async def test_anything_that_completes_can_be_asked() -> None:
    class Parrot:
        async def complete(
            self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
        ) -> Completion:
            return Completion(GOOD, "stop", 1, 1, 0.0, "parrot")

    assert await ask_for(Parrot(), MESSAGES, Age) == Age("Ada", 36)


def test_schemas_have_an_object_at_their_root() -> None:
    tree = {
        "title": "Tree",
        "type": "object",
        "properties": {
            "leaf": {"type": "string"},
            "children": {"type": "array", "items": {"$ref": "#/$defs/Tree"}},
        },
        "required": ["leaf", "children"],
        "additionalProperties": False,
    }
    assert strict_schema(Tree) == tree | {"$defs": {"Tree": tree}}
    assert "$defs" not in strict_schema(Age)
