from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Callable
from typing import Any

import pytest
import uvicorn
from pydantic import SecretStr, ValidationError
from tests.llm.endpoint import Endpoint, serve_raw

from webgym.core.errors import ConfigError, LLMBadReply, LLMError, LLMTimeout, LLMUnreachable
from webgym.llm import client as client_module
from webgym.llm.client import ChatClient
from webgym.llm.config import ChatConfig, Retry, Sampling
from webgym.llm.ledger import Ledger

MESSAGES = [{"role": "user", "content": "Hello?"}]
QUICK = Retry(tries=3, first_seconds=0.01, longest_seconds=0.02)


def config(base_url: str, **changes: Any) -> ChatConfig:
    settings: dict[str, Any] = {"base_url": base_url, "model": "tiny", "retry": QUICK}
    return ChatConfig(**(settings | changes))


async def until(holds: Callable[[], object]) -> None:
    async with asyncio.timeout(100):
        while not holds():
            await asyncio.sleep(0.005)


async def ask(base_url: str, **changes: Any) -> str:
    async with ChatClient(config(base_url, **changes)) as client:
        return (await client.complete(MESSAGES)).text


async def test_completion(endpoint: Endpoint) -> None:
    async with ChatClient(config(endpoint.url())) as client:
        reply = await client.complete(MESSAGES, Sampling(temperature=0, extra_body={"top_k": 2}))
    assert (reply.text, reply.finish_reason, reply.model) == ("Hello.", "stop", "tiny-1")
    assert (reply.prompt_tokens, reply.completion_tokens) == (12, 3)
    assert 0 < reply.seconds < 10
    assert endpoint.requests == [
        {"model": "tiny", "messages": MESSAGES, "stream": False, "temperature": 0.0, "top_k": 2}
    ]
    assert "authorization" not in endpoint.headers[0]


async def test_a_reply_without_usage_and_model_is_a_reply(endpoint: Endpoint) -> None:
    async with ChatClient(config(endpoint.url("bare"))) as client:
        reply = await client.complete(MESSAGES)
    assert (reply.text, reply.finish_reason, reply.model) == ("Hello.", "", "tiny")
    assert (reply.prompt_tokens, reply.completion_tokens) == (0, 0)


async def test_a_reply_that_the_engine_broke_off_is_asked_for_again(endpoint: Endpoint) -> None:
    endpoint.replies = [{"message": {"content": None}, "finish_reason": "abort"}, {"finish_reason": "length"}]
    assert await ask(endpoint.url("scripted")) == "Hello."
    assert endpoint.replies == []


@pytest.mark.parametrize("content", [None, ""])
@pytest.mark.parametrize(("finish_reason", "counted"), [(None, 3), ("stop", 0), ("stop", None)])
async def test_a_reply_that_was_not_generated_is_asked_for_again(
    endpoint: Endpoint, content: str | None, finish_reason: str | None, counted: int | None
) -> None:
    endpoint.usage["completion_tokens"] = counted
    nothing = {"message": {"content": content}, "finish_reason": finish_reason}
    endpoint.replies = [nothing, {}]
    assert await ask(endpoint.url("scripted")) == "Hello."
    endpoint.replies = [nothing] * 2
    with pytest.raises(LLMBadReply, match="nothing in it"):
        await ask(endpoint.url("scripted"), retry=Retry(tries=2, first_seconds=0))


@pytest.mark.parametrize(("finish_reason", "counted"), [("stop", 1), ("length", 0)])
async def test_an_empty_reply_that_was_generated_is_the_models(
    endpoint: Endpoint, finish_reason: str, counted: int
) -> None:
    endpoint.usage["completion_tokens"] = counted
    endpoint.replies = [{"message": {"content": None}, "finish_reason": finish_reason}]
    assert await ask(endpoint.url("scripted")) == ""


async def test_another_model_than_before_is_refused_unless_any_is_accepted(endpoint: Endpoint) -> None:
    retry = Retry(tries=2, first_seconds=0.01)
    for any_model in (False, True):
        endpoint.model = "tiny-1"
        async with ChatClient(config(endpoint.url(), retry=retry, any_model=any_model)) as client:
            await client.complete(MESSAGES)
            endpoint.model = "other"
            if any_model:
                assert (await client.complete(MESSAGES)).model == "other"
                continue
            endpoint.requests.clear()
            with pytest.raises(LLMBadReply, match="'other', and replied as 'tiny-1' before") as refused:
                await client.complete(MESSAGES)
            assert "any_model" in refused.value.hint
            assert len(endpoint.requests) == 2
            endpoint.model = "tiny-1"
            await client.complete(MESSAGES)


async def test_connections_are_kept(endpoint: Endpoint) -> None:
    async with ChatClient(config(endpoint.url())) as client:
        for _ in range(5):
            await client.complete(MESSAGES)
    assert len(endpoint.peers) == 1


async def test_a_connection_is_closed_before_a_server_closes_it(
    endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert uvicorn.Config("").timeout_keep_alive > client_module._IDLE_SECONDS
    monkeypatch.setattr(client_module, "_IDLE_SECONDS", 0.01)
    async with ChatClient(config(endpoint.url())) as client:
        for _ in range(2):
            await client.complete(MESSAGES)
            await asyncio.sleep(0.1)
    assert len(endpoint.peers) == 2


@pytest.mark.parametrize(
    ("base_url", "environment", "is_used"),
    [
        ("http://models.invalid/v1", {"http_proxy": "http://me:secret@PROXY"}, True),
        ("http://models.invalid/v1", {"ALL_PROXY": "me:secret@PROXY"}, True),
        ("http://models.invalid/v1", {"https_proxy": "http://me:secret@PROXY"}, False),
        ("http://models.invalid/v1", {"http_proxy": "http://PROXY", "no_proxy": "x,.invalid"}, False),
        ("http://127.0.0.1:1/v1", {"http_proxy": "http://PROXY"}, False),
        ("http://localhost:1/v1", {"http_proxy": "http://PROXY"}, False),
    ],
)
async def test_the_proxy_of_the_environment(
    monkeypatch: pytest.MonkeyPatch, base_url: str, environment: dict[str, str], is_used: bool
) -> None:
    asked: list[bytes] = []
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    async with serve_raw(b"HTTP/1.1 418 I am a proxy\r\nContent-Length: 0\r\n\r\n", asked) as served:
        place = served.removeprefix("http://").removesuffix("/v1")
        for name, value in environment.items():
            monkeypatch.setenv(name, value.replace("PROXY", place))
        error, words = (LLMBadReply, "I am a proxy") if is_used else (LLMUnreachable, "cannot be reached")
        with pytest.raises(error, match=words):
            await ask(base_url, retry=Retry(tries=1))
    if is_used:
        assert asked[0].startswith(b"POST http://models.invalid/v1/chat/completions HTTP/1.1\r\n")
        assert b"Proxy-Authorization: Basic bWU6c2VjcmV0\r\n" in asked[0]


async def test_concurrency_is_limited(endpoint: Endpoint) -> None:
    async with (
        ChatClient(config(endpoint.url("slow"), concurrency=3, total_seconds=5)) as client,
        asyncio.TaskGroup() as group,
    ):
        for _ in range(9):
            group.create_task(client.complete(MESSAGES))
    assert endpoint.most_in_flight == 3
    assert len(endpoint.requests) == 9


async def test_the_queue_does_not_count_towards_the_deadline(endpoint: Endpoint) -> None:
    limits = {"concurrency": 1, "total_seconds": 1.0}
    async with ChatClient(config(endpoint.url("slow"), **limits)) as client, asyncio.TaskGroup() as group:
        for _ in range(24):  # 1.2 s of work in all
            group.create_task(client.complete(MESSAGES))


@pytest.mark.parametrize(
    ("behaviour", "error", "words"),
    [
        ("500", LLMBadReply, "500 Internal Server Error"),
        ("400", LLMBadReply, "context length exceeded"),
        ("401", LLMBadReply, "WEBGYM_API_KEY"),
        ("redirect", LLMBadReply, "redirects are not followed"),
        ("html", LLMBadReply, "a web page"),
        ("nothing", LLMBadReply, "an empty reply"),
        ("truncated", LLMBadReply, "not a completion"),
        ("list", LLMBadReply, "not a completion"),
        ("nested", LLMBadReply, "not a completion"),
        ("empty", LLMBadReply, "model is loading"),
        ("number", LLMBadReply, "not a completion"),
        ("surrogate", LLMBadReply, "not a completion"),
        ("latin", LLMBadReply, "not a completion"),
        ("latin_500", LLMBadReply, "500 Internal Server Error"),
        ("stream", LLMBadReply, "a stream"),
        ("flood", LLMBadReply, "sent more than"),
    ],
)
async def test_misbehaviour_is_one_clear_line(
    endpoint: Endpoint, behaviour: str, error: type[LLMError], words: str
) -> None:
    with pytest.raises(error) as caught:
        await ask(endpoint.url(behaviour), total_seconds=20)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    assert endpoint.url(behaviour) in caught.value.message


@pytest.mark.parametrize(
    ("behaviour", "tries", "why"),
    [("500", QUICK.tries, "500"), ("flaky", 7, "429"), ("quota", 1, "you exceeded your quota")],
)
async def test_a_failing_server_is_tried_as_often_as_agreed(
    endpoint: Endpoint, behaviour: str, tries: int, why: str
) -> None:
    endpoint.fails_left = 1000
    with pytest.raises(LLMBadReply, match=why):
        await ask(endpoint.url(behaviour), retry=QUICK.model_copy(update={"refused_tries": 7}))
    assert len(endpoint.requests) == tries


async def test_what_cannot_pass_is_not_tried_again(endpoint: Endpoint) -> None:
    for behaviour in ("400", "401", "html", "nothing", "truncated"):
        with pytest.raises(LLMBadReply):
            await ask(endpoint.url(behaviour))
    assert len(endpoint.requests) == 5


@pytest.mark.parametrize("behaviour", ["404", "500", "html", "nothing", "truncated", "empty"])
async def test_an_endpoint_that_worked_is_waited_for_while_it_is_away(
    endpoint: Endpoint, behaviour: str
) -> None:
    async with ChatClient(config(endpoint.url("changing"))) as client:
        await client.complete(MESSAGES)
        endpoint.behaviour = behaviour
        asking = [asyncio.create_task(client.complete(MESSAGES)) for _ in range(2)]
        await until(lambda: len(endpoint.requests) > 6 * QUICK.tries)
        assert "2 of 2 requests are sent again: " in client.problem
        endpoint.behaviour = "fine"
        assert [reply.text for reply in await asyncio.gather(*asking)] == ["Hello."] * 2


@pytest.mark.parametrize("behaviour", ["broken_off", "number", "surrogate"])
async def test_a_reply_that_is_paid_for_and_cannot_be_used_counts(endpoint: Endpoint, behaviour: str) -> None:
    """Also of an endpoint that has worked before."""
    ledger, retry = Ledger(), QUICK.model_copy(update={"patience_seconds": 0.5})
    async with ChatClient(config(endpoint.url("changing"), retry=retry), ledger=ledger) as client:
        await client.complete(MESSAGES)
        endpoint.behaviour = behaviour
        with pytest.raises(LLMBadReply):
            await client.complete(MESSAGES)
    assert len(endpoint.requests) == ledger.totals.all.calls == 1 + QUICK.tries


async def test_an_endpoint_is_waited_for_no_longer_than_agreed(endpoint: Endpoint) -> None:
    """Also beyond the deadline of a reply."""
    retry = QUICK.model_copy(update={"patience_seconds": 1.0})
    async with ChatClient(config(endpoint.url("changing"), retry=retry, total_seconds=0.5)) as client:
        await client.complete(MESSAGES)
        endpoint.behaviour, started = "404", time.monotonic()
        with pytest.raises(LLMBadReply, match="answered 404 Not Found: no such model"):
            await client.complete(MESSAGES)
        assert 1 <= time.monotonic() - started < 10
        asked = len(endpoint.requests)
        with pytest.raises(LLMBadReply):
            await client.complete(MESSAGES)
        assert len(endpoint.requests) == asked + QUICK.tries, "nobody waits again"


async def test_an_endpoint_that_answers_what_it_has_before_it_stops_is_waited_for(endpoint: Endpoint) -> None:
    endpoint.work_seconds = 0.05
    async with ChatClient(config(endpoint.url("changing"))) as client:
        await client.complete(MESSAGES)
        endpoint.behaviour = "crowded"
        working = [asyncio.create_task(client.complete(MESSAGES)) for _ in range(2 * QUICK.tries)]
        await until(lambda: len(endpoint.requests) > len(working))
        endpoint.behaviour = "404"
        asking = asyncio.create_task(client.complete(MESSAGES))
        await asyncio.gather(*working)
        endpoint.behaviour = "fine"
        assert (await asking).text == "Hello."


async def test_a_request_that_fails_while_others_are_answered_is_not_waited_for(endpoint: Endpoint) -> None:
    async with ChatClient(config(endpoint.url("poisoned"))) as client:
        asking = asyncio.create_task(client.complete([{"role": "user", "content": "poison"}]))
        async with asyncio.timeout(100):
            while not asking.done():
                await client.complete(MESSAGES)
        with pytest.raises(LLMBadReply, match="answered 500"):
            await asking


async def test_a_completion_is_known_by_what_it_holds(endpoint: Endpoint) -> None:
    assert await ask(endpoint.url("plain")) == "Hello."


async def test_too_many_requests_then_fine(endpoint: Endpoint) -> None:
    endpoint.fails_left = 2
    assert await ask(endpoint.url("flaky")) == "Hello."
    assert len(endpoint.requests) == 3


async def test_retry_after_is_respected(endpoint: Endpoint) -> None:
    endpoint.fails_left, endpoint.retry_after = 1, "1"
    started = time.monotonic()
    assert await ask(endpoint.url("flaky")) == "Hello."
    assert time.monotonic() - started >= 1


async def test_a_retry_after_beyond_the_deadline_fails_at_once(endpoint: Endpoint) -> None:
    endpoint.fails_left, endpoint.retry_after = 1, "Fri, 31 Dec 2199 23:59:59 GMT"
    with pytest.raises(LLMBadReply, match=r"429 Too Many Requests: slow down \(Retry-After: [\d,]+ s\)"):
        await ask(endpoint.url("flaky"), total_seconds=5)
    assert len(endpoint.requests) == 1


async def test_retry_after_of_one_holds_all_back(endpoint: Endpoint) -> None:
    endpoint.fails_left, endpoint.retry_after = 1, "1"
    async with ChatClient(config(endpoint.url("flaky"), concurrency=1)) as client:
        await asyncio.gather(*(client.complete(MESSAGES) for _ in range(5)))
    first, *others = endpoint.times
    assert len(others) == 5
    assert min(others) - first >= 1


async def test_a_retry_after_beyond_all_patience_holds_nobody_back(endpoint: Endpoint) -> None:
    endpoint.fails_left, endpoint.retry_after = 1, "86400"
    async with ChatClient(config(endpoint.url("flaky"), total_seconds=5)) as client:
        with pytest.raises(LLMBadReply, match="slow down"):
            await client.complete(MESSAGES)
        async with asyncio.timeout(100):
            assert (await client.complete(MESSAGES)).text == "Hello."


async def test_refusals_lose_no_request(endpoint: Endpoint) -> None:
    endpoint.allowed = 4
    retry = Retry(first_seconds=0.02, longest_seconds=0.05, refused_tries=1000)
    async with ChatClient(config(endpoint.url("limited"), retry=retry)) as client:
        await asyncio.gather(*(client.complete(MESSAGES) for _ in range(80)))
    assert endpoint.answered == 80 < len(endpoint.requests)


@pytest.mark.parametrize("value", ["Fri, 31 Dec 9999 23:59:59 +99999999999999", "1.5", "soon"])
async def test_a_retry_after_that_is_no_time_is_none(endpoint: Endpoint, value: str) -> None:
    endpoint.fails_left, endpoint.retry_after = 1, value
    assert await ask(endpoint.url("flaky")) == "Hello."


async def test_pauses_grow_and_are_spread(endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    sleep: Callable[[float], Any] = asyncio.sleep
    own = asyncio.current_task()

    async def note(seconds: float) -> None:
        is_own = asyncio.current_task() is own  # the endpoint's server sleeps too
        if is_own:
            pauses.append(seconds)
        await sleep(0 if is_own else seconds)

    monkeypatch.setattr("webgym.llm.client.asyncio.sleep", note)
    retry = Retry(tries=5, first_seconds=1, longest_seconds=4)
    with pytest.raises(LLMUnreachable):
        await ask("http://127.0.0.1:1/v1", retry=retry)
    assert [low <= pause <= 2 * low for low, pause in zip((0.5, 1, 2, 2), pauses, strict=True)] == [True] * 4


async def test_nobody_listens() -> None:
    with pytest.raises(LLMUnreachable, match="is the endpoint running"):
        await ask("http://127.0.0.1:1/v1")


async def test_an_unknown_host() -> None:
    with pytest.raises(LLMUnreachable):
        await ask("http://nowhere.invalid/v1", connect_seconds=2)


async def test_silence(endpoint: Endpoint) -> None:
    # Long enough that a busy machine gets the request across.
    with pytest.raises(LLMTimeout, match="was silent for 1 s"):
        await ask(endpoint.url("silent"), read_seconds=1)
    with pytest.raises(LLMTimeout, match="no reply within 2 s"):
        await ask(endpoint.url("silent"), total_seconds=2)
    assert len(endpoint.requests) == 2


async def test_an_endless_body_ends_at_the_deadline(endpoint: Endpoint) -> None:
    with pytest.raises(LLMBadReply, match="was still sending after 1 s"):
        await ask(endpoint.url("trickle"), total_seconds=1)


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (b"", LLMUnreachable),
        (b"SSH-2.0-OpenSSH_9.2\r\n", LLMUnreachable),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 500\r\n\r\n{", LLMBadReply),
        (b"HTTP/1.1 200 OK\r\nContent-Encoding: gzip\r\nContent-Length: 4\r\n\r\nabcd", LLMBadReply),
    ],
)
async def test_what_is_hardly_http(answer: bytes, error: type[LLMError]) -> None:
    async with serve_raw(answer) as base_url:
        with pytest.raises(error) as caught:
            await ask(base_url)
    assert "\n" not in str(caught.value)


async def test_cancelling_frees_the_place_and_hangs_up(endpoint: Endpoint) -> None:
    async with ChatClient(config(endpoint.url("silent_once"), concurrency=1)) as client:
        asking = asyncio.create_task(client.complete(MESSAGES))
        await endpoint.asked.wait()
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        async with asyncio.timeout(100):
            await endpoint.hung_up.wait()
            assert (await client.complete(MESSAGES)).text == "Hello."


async def test_the_key_is_sent_and_never_told(endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_KEY", "sk-very-secret\n")
    with pytest.raises(LLMBadReply) as caught:
        await ask(endpoint.url("401"), api_key_env="MY_KEY")
    assert endpoint.headers[0]["authorization"] == "Bearer sk-very-secret"
    assert "secret" not in str(caught.value)
    settings = config(endpoint.url(), api_key_env="MY_KEY")
    async with ChatClient(settings, api_key=SecretStr("sk-other-secret")) as client:
        await client.complete(MESSAGES)
        assert "secret" not in f"{client.config!r} {client.__dict__!r} {settings.model_dump_json()}"
    assert endpoint.headers[1]["authorization"] == "Bearer sk-other-secret"


@pytest.mark.parametrize("behaviour", ["echo", "echo_page"])
async def test_a_key_that_the_endpoint_repeats_is_not_told(
    endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch, behaviour: str
) -> None:
    monkeypatch.setenv("WEBGYM_API_KEY", "sk-very-secret")
    with pytest.raises(LLMBadReply, match=r"\*\*\*") as caught:
        await ask(endpoint.url(behaviour))
    assert "secret" not in str(caught.value)
    monkeypatch.setenv("WEBGYM_API_KEY", "key")  # no secret
    with pytest.raises(LLMBadReply, match="key"):
        await ask(endpoint.url(behaviour))


def test_a_key_that_is_no_header(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WEBGYM_API_KEY", "sk-…")
    with pytest.raises(ConfigError, match="WEBGYM_API_KEY"):
        ChatClient(config("http://127.0.0.1:1/v1"))


async def test_a_client_must_be_opened() -> None:
    with pytest.raises(RuntimeError, match="async with"):
        await ChatClient(config("http://127.0.0.1:1/v1")).complete(MESSAGES)


@pytest.mark.parametrize(
    "changes",
    [
        {"base_url": "ftp://host/v1"},
        {"base_url": "host:8000/v1"},
        {"base_url": "http://user:pass@host/v1"},
        {"base_url": "http://host/v1?key=1"},
        {"base_url": "http://"},
        {"model": ""},
        {"concurrency": 0},
        {"unknown": 1},
        {"sampling": {"extra_body": {"messages": []}}},
        {"sampling": {"temperature": float("inf")}},
    ],
)
def test_settings_out_of_range(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        config(**({"base_url": "http://host/v1"} | changes))


def test_a_trailing_slash_does_no_harm() -> None:
    assert config("http://host:8000/v1/").base_url == "http://host:8000/v1"


@pytest.mark.parametrize(
    ("behaviour", "slow", "told"),
    [
        ("500", 99.0, "1 of 1 requests are sent again: .* answered 500"),
        ("flaky", 99.0, "1 of 1 requests are sent again: .* answered 429 Too Many Requests: slow down"),
        ("silent", 0.05, r"is silent for \d+ s"),
        ("trickle", 0.05, r"has sent \d+ bytes for \d+ s"),
    ],
)
async def test_who_waits_is_told_what_for(
    endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch, behaviour: str, slow: float, told: str
) -> None:
    monkeypatch.setattr("webgym.llm.client._SLOW_SECONDS", slow)
    endpoint.fails_left = 1
    patient = config(endpoint.url(behaviour), retry=Retry(first_seconds=5))
    async with ChatClient(patient) as client, asyncio.timeout(100):
        asking = asyncio.create_task(client.complete(MESSAGES))
        while not re.search(told, client.problem):
            await asyncio.sleep(0.01)
        asking.cancel()
        await asyncio.gather(asking, return_exceptions=True)
        assert client.problem == ""
