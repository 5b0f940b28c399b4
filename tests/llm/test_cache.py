from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import sqlite3
import sys
import textwrap
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.llm.endpoint import Endpoint, config

from webgym.core.errors import CacheError, LLMBadReply
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.config import Sampling
from webgym.llm.request import Request

MESSAGES = [{"role": "user", "content": "Hello?"}]


async def test_what_was_paid_for_is_not_asked_again(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
        first = await client.complete(MESSAGES)
        again = await client.complete(MESSAGES)
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
        later = await client.complete(MESSAGES)
        assert cache.totals.all.calls == 1
        assert cache.totals.all.hits == 2
    assert len(endpoint.requests) == 1
    assert (first.cached, again.cached, later.cached) == (False, True, True)
    assert (first.text, first.model, first.prompt_tokens) == (later.text, later.model, later.prompt_tokens)
    assert first.seconds == later.seconds


async def test_the_whole_request_is_the_key(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache:
        for settings in (
            config(endpoint.url()),
            config(endpoint.url("slow")),
            config(endpoint.url(), model="small"),
            config(endpoint.url(), sampling=Sampling(temperature=1)),
            config(endpoint.url(), sampling=Sampling(temperature=1, sample=1)),
            config(endpoint.url(), sampling=Sampling(temperature=1, extra_body={"seed": 1})),
        ):
            async with ChatClient(settings, cache=cache) as client:
                for message in (MESSAGES, [*MESSAGES, *MESSAGES]):
                    assert not (await client.complete(message)).cached
                    assert (await client.complete(message)).cached
    assert len(endpoint.requests) == 12
    assert all("sample" not in request for request in endpoint.requests)


def test_the_order_of_parameters_does_not_matter_and_that_of_a_schema_does() -> None:
    def key(**extra: Any) -> bytes:
        return Request("http://x/v1", "m", MESSAGES, Sampling(extra_body=extra)).key

    assert key(a=1, b=2) == key(b=2, a=1)
    assert key(a={"x": 1, "y": 2}) != key(a={"y": 2, "x": 1})


async def test_identical_requests_in_flight_are_asked_once(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url("slow")), cache=cache) as client:
        replies = await asyncio.gather(*(client.complete(MESSAGES) for _ in range(20)))
        assert len(endpoint.requests) == 1
        assert sum(not reply.cached for reply in replies) == 1
        assert (cache.totals.all.calls, cache.totals.all.hits) == (1, 19)


async def test_who_waits_for_one_that_fails_fails_too(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url("500")), cache=cache) as client:
        replies = await asyncio.gather(*(client.complete(MESSAGES) for _ in range(5)), return_exceptions=True)
        assert all(isinstance(reply, LLMBadReply) for reply in replies)
        assert len(endpoint.requests) == 1
        with pytest.raises(LLMBadReply):
            await client.complete(MESSAGES)
        assert len(endpoint.requests) == 2  # a failure is not kept


async def test_who_waits_for_one_that_is_cancelled_asks(endpoint: Endpoint, path: Path) -> None:
    settings = config(endpoint.url("silent_once"))
    async with ReplyCache(path) as cache, ChatClient(settings, cache=cache) as client:
        first = asyncio.create_task(client.complete(MESSAGES))
        await endpoint.asked.wait()
        second = asyncio.create_task(client.complete(MESSAGES))
        await asyncio.sleep(0)
        first.cancel()
        async with asyncio.timeout(100):
            assert (await second).text == "Hello."
        with pytest.raises(asyncio.CancelledError):
            await first


async def test_a_paid_reply_is_kept_though_its_caller_is_gone(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
        put = cache.put

        async def cancelled(*arguments: Any) -> Any:
            task = asyncio.ensure_future(put(*arguments))
            await asyncio.sleep(0)
            task.cancel()
            return await task

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(cache, "put", cancelled)
            with pytest.raises(asyncio.CancelledError):
                await client.complete(MESSAGES)
        assert (await client.complete(MESSAGES)).cached
    assert len(endpoint.requests) == 1


async def test_two_processes_go_on_with_the_same_reply(endpoint: Endpoint, path: Path) -> None:
    """Both were asked; the first that was stored is what both say, and both are accounted for."""
    async with ReplyCache(path) as one, ReplyCache(path) as two:
        endpoint.text = "One."
        async with ChatClient(config(endpoint.url("slow")), cache=one) as first:
            asking = asyncio.create_task(first.complete(MESSAGES))
            await endpoint.asked.wait()
            endpoint.asked.clear()
            async with ChatClient(config(endpoint.url("slow")), cache=two) as second:
                endpoint.text = "Two."
                other = asyncio.create_task(second.complete(MESSAGES))
                replies = {(await asking).text, (await other).text}
        assert len(endpoint.requests) == 2
        assert len(replies) == 1
    async with ReplyCache(path) as again:
        assert again.totals.all.calls == 2


# --- files --------------------------------------------------------------------------------------------


async def opened(path: Path) -> None:
    async with ReplyCache(path, busy_seconds=0.1):
        pass


def make_foreign(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("create table bookmarks (url text)")
    connection.close()


def make_newer(path: Path) -> None:
    asyncio.run(opened(path))
    connection = sqlite3.connect(path)
    connection.execute("pragma user_version = 99")
    connection.close()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path.write_text("MODEL: {prompt: 1}\n" * 100), "not a database"),
        (lambda path: path.write_bytes(b"SQLite format 3\0" + b"\xff" * 5000), "cannot be used"),
        (lambda path: path.mkdir(), "unable to open"),
        (make_foreign, "database of another program"),
        (make_newer, "version 99"),
    ],
)
def test_a_file_that_is_none_of_ours(path: Path, make: Any, words: str) -> None:
    make(path)
    before = path.read_bytes() if path.is_file() else b""
    with pytest.raises(CacheError, match=words) as caught:
        asyncio.run(opened(path))
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    assert before == (path.read_bytes() if path.is_file() else b"")


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(CacheError, match="unable to open"):
        asyncio.run(opened(tmp_path / "nowhere" / "replies"))


async def test_a_damaged_reply_is_never_given_out(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
        await client.complete(MESSAGES)
    with sqlite3.connect(path) as connection:
        connection.execute("update replies set body = ?", [json.dumps(endpoint.completion()).encode()])
    connection.close()
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
        with pytest.raises(CacheError, match="checksum"):
            await client.complete(MESSAGES)
        other = [{"role": "user", "content": "Bye."}]
        assert (await client.complete(other)).text == "Hello."


async def test_a_file_that_is_damaged_later(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
        await asyncio.gather(*(client.complete([{"role": "user", "content": str(n)}]) for n in range(200)))
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xa5" * (len(data) - 4096)
    path.write_bytes(data)
    with pytest.raises(CacheError, match="cannot be used"):
        async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
            await client.complete(MESSAGES)


async def test_a_full_disk(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache, ChatClient(config(endpoint.url()), cache=cache) as client:
        await client.complete(MESSAGES)
        endpoint.text = "long " * 20_000
        await cache.write(lambda connection: connection.execute("pragma max_page_count = 1").fetchone())
        with pytest.raises(CacheError, match="disk is full"):
            await client.complete([{"role": "user", "content": "Tell me all."}])
        assert (await client.complete(MESSAGES)).cached


async def test_an_unopened_cache_says_so(path: Path) -> None:
    with pytest.raises(RuntimeError, match="async with"):
        await ReplyCache(path).get(b"")


async def test_a_writer_that_waits_too_long_is_told(endpoint: Endpoint, path: Path) -> None:
    settings = config(endpoint.url())
    async with ReplyCache(path, busy_seconds=0.1) as cache, ChatClient(settings, cache=cache) as client:
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("begin immediate")
        with pytest.raises(CacheError, match="another process"):
            await client.complete(MESSAGES)
        other.execute("rollback")
        other.close()
        assert (await client.complete(MESSAGES)).text == "Hello."


# --- kill -9 ------------------------------------------------------------------------------------------

ASKER = textwrap.dedent(
    """
    import asyncio, os, sys
    from webgym.llm.client import ChatClient
    from webgym.llm.config import ChatConfig, Sampling
    from webgym.llm.cache import ReplyCache

    async def main(base_url, path, unique):
        config = ChatConfig(base_url=base_url, model="tiny", concurrency=8)
        async with ReplyCache(path) as cache, ChatClient(config, cache=cache) as client:
            async def ask(number):
                message = {"role": "user", "content": str(number)}
                await client.complete([message], Sampling(temperature=1))
                os.write(1, f"{number}\\n".encode())  # the caller has the reply
            async with asyncio.TaskGroup() as group:
                for number in range(unique):
                    group.create_task(ask(number))

    asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
    """
)


@asynccontextmanager
async def asker(endpoint: Endpoint, path: Path, unique: int) -> Any:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", ASKER, endpoint.url("numbered"), str(path), str(unique)),
        stdout=asyncio.subprocess.PIPE,
        env=environment,
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


async def test_kill_9_loses_no_reply_that_was_returned(endpoint: Endpoint, path: Path) -> None:
    unique, kills, concurrency = 200, 3, 8
    chance = random.Random(4)
    returned: set[str] = set()
    for turn in range(kills + 1):
        asked_before = len(endpoint.requests)
        async with asker(endpoint, path, unique) as process:
            assert process.stdout is not None
            if turn < kills:
                # A moment while replies come in: after some requests, and a little later.
                target = asked_before + chance.randrange(10, 40)
                while len(endpoint.requests) < target:
                    await asyncio.sleep(0.002)
                await asyncio.sleep(chance.random() * 0.01)
                os.kill(process.pid, signal.SIGKILL)
            said = (await process.stdout.read()).decode()
            code = await process.wait()
        assert code == (-signal.SIGKILL if turn < kills else 0)
        asked = [request["messages"][0]["content"] for request in endpoint.requests[asked_before:]]
        assert not returned & set(asked), "a reply that was returned was paid for again"
        assert len(asked) == len(set(asked))
        returned |= set(said.split())
    assert returned == {str(number) for number in range(unique)}
    assert len(endpoint.requests) <= unique + kills * concurrency
    async with ReplyCache(path) as cache:
        assert unique <= cache.totals.all.calls <= len(endpoint.requests)
    connection = sqlite3.connect(path)
    assert connection.execute("pragma integrity_check").fetchone() == ("ok",)
    assert connection.execute("select count(*) from replies").fetchone() == (unique,)
    connection.close()
