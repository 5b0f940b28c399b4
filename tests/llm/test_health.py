"""Who waits for a job's requests is told what for, whichever part of the job has sent them."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

import pytest

from webgym.llm.client import ChatClient
from webgym.llm.config import ChatConfig
from webgym.llm.health import report_problems, watch_clients

from .endpoint import Endpoint


class Troubled(ChatClient):
    """Says that something holds it up."""

    told = "the endpoint is busy"

    @property
    def problem(self) -> str:
        return self.told


async def test_the_clients_of_a_job_are_watched_and_no_others(endpoint: Endpoint) -> None:
    config = ChatConfig(base_url=endpoint.url(), model="tiny")
    async with AsyncExitStack() as stack:
        other = await stack.enter_async_context(Troubled(config))
        other.told = "another job's"
        with watch_clients() as problem:
            assert problem() == ""
            judge = Troubled(config)
            await asyncio.create_task(stack.enter_async_context(judge))
            await stack.enter_async_context(Troubled(config))
            await stack.enter_async_context(ChatClient(config))
            assert problem() == "the endpoint is busy", "once, whoever waits"
            judge.told = "the judge is away"
            assert set(problem().split("; ")) == {"the endpoint is busy", "the judge is away"}
        await stack.enter_async_context(Troubled(config))
        assert problem().count("busy") == 1


async def test_a_problem_is_reported_once_and_repeated_while_it_lasts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("webgym.llm.health._POLL_SECONDS", 0.001)
    monkeypatch.setattr("webgym.llm.health._REPEAT_SECONDS", 0.001)
    told = asyncio.Queue[str]()
    sayings = iter(["", "it hangs", "", "it hangs still"])
    async with asyncio.timeout(100), report_problems(lambda: next(sayings, ""), told.put_nowait):
        assert [await told.get(), await told.get()] == ["it hangs", "it hangs still"]
