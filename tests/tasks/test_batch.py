from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest

from webgym.core.errors import CacheError, NotCached, UsageError
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.config import ChatConfig, Retry, Sampling
from webgym.llm.ledger import Ledger
from webgym.llm.prices import Prices
from webgym.taskset.batch import Collector, import_results, write_batches

NOWHERE = "http://127.0.0.1:1/v1"


def ask(number: int) -> list[dict[str, str]]:
    return [{"role": "user", "content": f"Question {number}?"}]


def config(**changes: Any) -> ChatConfig:
    settings: dict[str, Any] = {"base_url": NOWHERE, "model": "tiny", "retry": Retry(tries=1)}
    return ChatConfig(**(settings | changes))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "replies.sqlite"


async def note(cache: ReplyCache, numbers: range, **changes: Any) -> None:
    model = Collector(config(**changes), cache).labelled("rubrics")
    for number in numbers:
        with pytest.raises(NotCached):
            await model.complete(ask(number), Sampling(temperature=0))


def lines_of(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def answer(request: dict[str, Any], **usage: int) -> dict[str, Any]:
    """A line of a result file, as the endpoint writes it."""
    content = f"Reply to {request['body']['messages'][0]['content']}"
    body = {
        "id": "chatcmpl-1",
        "model": "tiny-2026",
        "choices": [{"index": 0, "message": {"role": "assistant", "content": content}}],
        "usage": usage or {"prompt_tokens": 10, "completion_tokens": 5},
    }
    response = {"status_code": 200, "request_id": "r", "body": body}
    return {
        "id": f"batch_req_{request['custom_id'][:12]}",
        "custom_id": request["custom_id"],
        "response": response,
        "error": None,
    }


def write_lines(path: Path, lines: list[Any]) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


async def test_noted_written_answered_imported_and_used(tmp_path: Path, path: Path) -> None:
    async with ReplyCache(path) as cache:
        await note(cache, range(20))
        await note(cache, range(10, 20))  # asked for again: noted once
        [file] = await write_batches(cache, tmp_path / "out")
        requests = lines_of(file.path)
        assert (file.model, file.requests, file.bytes) == ("tiny", 20, file.path.stat().st_size)
        assert 20 * 5 < file.prompt_tokens < 20 * 30
        first = requests[0]
        assert set(first) == {"custom_id", "method", "url", "body"}
        assert (first["method"], first["url"]) == ("POST", "/v1/chat/completions")
        assert first["body"] == {"model": "tiny", "messages": ask(0), "temperature": 0.0}
        assert await write_batches(cache, tmp_path / "out") == []
        assert len(await write_batches(cache, tmp_path / "out", again=True)) == 1
        assert [each.name for each in (tmp_path / "out").iterdir()] == [file.path.name]

        replies = [answer(request) for request in requests]
        random.Random(1).shuffle(replies)
        half = write_lines(tmp_path / "half.jsonl", replies[:10])
        rest = write_lines(tmp_path / "rest.jsonl", replies[5:])
        found = await import_results(cache, [half], Prices.parse("1,2"))
        assert (found.stored, found.known, found.unanswered) == (10, 0, [])
        found = await import_results(cache, [half, rest], Prices.parse("1,2"))
        assert (found.stored, found.known, found.unanswered) == (10, 15, [])

        usage = cache.totals.rows["rubrics", "tiny"]
        assert (usage.calls, usage.batched, usage.prompt_tokens, usage.completion_tokens) == (
            20,
            20,
            200,
            100,
        )
        assert usage.dollars == pytest.approx(20 * (10 * 1 + 5 * 2) / 1e6)
        collector = Collector(config(), cache)
        async with ChatClient(config(), cache=cache, ledger=Ledger(cache)) as client:
            for number in range(20):
                for model in (collector, client):
                    reply = await model.complete(ask(number), Sampling(temperature=0))
                    assert (reply.text, reply.cached) == (f"Reply to Question {number}?", True)
                    assert (reply.model, reply.seconds) == ("tiny-2026", 0)
        assert await write_batches(cache, tmp_path / "out", again=True) == []


async def test_files_keep_to_the_limits(tmp_path: Path, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with ReplyCache(path) as cache:
        await note(cache, range(10))
        await note(cache, range(5), model="other")
        monkeypatch.setattr("webgym.taskset.batch._REQUESTS", 4)
        files = await write_batches(cache, tmp_path / "few")
        assert [(file.model, file.requests) for file in files] == [
            ("other", 4),
            ("other", 1),
            ("tiny", 4),
            ("tiny", 4),
            ("tiny", 2),
        ]
        assert {line["body"]["model"] for line in lines_of(files[0].path)} == {"other"}
        monkeypatch.setattr("webgym.taskset.batch._FILE_BYTES", 600)
        files = await write_batches(cache, tmp_path / "small", again=True)
        assert len(files) > 5
        assert all(file.bytes <= 600 for file in files)
        assert sum(file.requests for file in files) == 15


async def test_what_was_not_answered_is_told_and_asked_for_again(tmp_path: Path, path: Path) -> None:
    async with ReplyCache(path) as cache:
        await note(cache, range(5))
        [file] = await write_batches(cache, tmp_path / "out")
        requests = lines_of(file.path)
        refused = answer(requests[1])
        refused["response"] = {"status_code": 400, "body": {"error": {"message": "too long"}}}
        expired = {
            "id": "batch_req_9",
            "custom_id": requests[2]["custom_id"],
            "response": None,
            "error": {"code": "batch_expired", "message": "not finished in time"},
        }
        empty = answer(requests[3])
        empty["response"]["body"]["choices"] = []
        foreign = answer({**requests[4], "custom_id": "request-17"})
        results = write_lines(
            tmp_path / "results.jsonl", [answer(requests[0]), refused, expired, empty, foreign]
        )
        data = results.read_bytes()
        results.write_bytes(b"\xef\xbb\xbf" + data + b'\r\n{"custom_id": \n[1]\n' + b"\xff\n" + data[:200])
        found = await import_results(cache, [results])
        assert found.stored == 1
        reasons = [str(line).removeprefix(f"{results}:") for line in found.unanswered]
        for number, words in enumerate(["too long", "not finished in time", "without choices", "request-17"]):
            assert reasons[number].startswith(f"{number + 2}: ")
            assert words in reasons[number]
        assert len(reasons) == 8
        assert all("not a result of a batch" in reason for reason in reasons[4:])
        [again] = await write_batches(cache, tmp_path / "out")
        assert [line["custom_id"] for line in lines_of(again.path)] == [
            requests[number]["custom_id"] for number in (1, 2, 3)
        ]


async def test_results_of_requests_that_this_file_never_noted_are_kept(tmp_path: Path, path: Path) -> None:
    async with ReplyCache(tmp_path / "other") as other:
        await note(other, range(1))
        [file] = await write_batches(other, tmp_path)
    results = write_lines(tmp_path / "results.jsonl", [answer(line) for line in lines_of(file.path)])
    async with ReplyCache(path) as cache:
        assert (await import_results(cache, [results])).stored == 1
        assert cache.totals.rows["batch", "tiny-2026"].unpriced == 1
        assert (await Collector(config(), cache).complete(ask(0), Sampling(temperature=0))).cached


async def test_tokens_that_were_not_counted_are_estimated(tmp_path: Path, path: Path) -> None:
    async with ReplyCache(path) as cache:
        await note(cache, range(1))
        [file] = await write_batches(cache, tmp_path)
        results = [answer(line, prompt_tokens=0) for line in lines_of(file.path)]
        await import_results(cache, [write_lines(tmp_path / "results.jsonl", results)])
        assert cache.totals.all.estimated == 1
        assert cache.totals.all.prompt_tokens > 5


async def test_files_that_cannot_be_used(tmp_path: Path, path: Path) -> None:
    async with ReplyCache(path) as cache:
        with pytest.raises(UsageError, match="cannot be read"):
            await import_results(cache, [tmp_path / "nothing"])
        await note(cache, range(1))
        (tmp_path / "file").write_text("")
        with pytest.raises(UsageError, match="cannot be written"):
            await write_batches(cache, tmp_path / "file" / "out")
        assert len(await write_batches(cache, tmp_path / "out")) == 1
    with pytest.raises(CacheError):
        async with ReplyCache(tmp_path):
            pass
