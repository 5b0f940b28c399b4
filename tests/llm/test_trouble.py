"""Who waits for a job's requests is told what for, whichever part of the job has sent them."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

import pytest

from webgym.llm import ChatClient, ChatConfig
from webgym.llm.trouble import telling, watched

from .endpoint import Endpoint


class Troubled(ChatClient):
    """Says that something holds it up."""

    told = "the endpoint is busy"

    @property
    def trouble(self) -> str:
        return self.told


async def test_the_clients_of_a_job_are_watched_and_no_others(endpoint: Endpoint) -> None:
    config = ChatConfig(base_url=endpoint.url(), model="tiny")
    async with AsyncExitStack() as stack:
        other = await stack.enter_async_context(Troubled(config))
        other.told = "another job's"
        with watched() as trouble:
            assert trouble() == ""
            judge = Troubled(config)
            await asyncio.create_task(stack.enter_async_context(judge))
            await stack.enter_async_context(Troubled(config))
            await stack.enter_async_context(ChatClient(config))
            assert trouble() == "the endpoint is busy", "once, whoever waits"
            judge.told = "the judge is away"
            assert set(trouble().split("; ")) == {"the endpoint is busy", "the judge is away"}
        await stack.enter_async_context(Troubled(config))
        assert trouble().count("busy") == 1


async def test_trouble_is_told_as_it_begins_and_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.llm.trouble._LOOK_SECONDS", 0.001)
    monkeypatch.setattr("webgym.llm.trouble._REPEAT_SECONDS", 0.001)
    told = asyncio.Queue[str]()
    sayings = iter(["", "it hangs", "", "it hangs still"])
    async with asyncio.timeout(10), telling(lambda: next(sayings, ""), told.put_nowait):
        assert [await told.get(), await told.get()] == ["it hangs", "it hangs still"]
