from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from tests.llm.endpoint import Endpoint

from webgym.llm.adaptive import ConcurrencyLimiter
from webgym.llm.client import ChatClient
from webgym.llm.config import AdaptiveConcurrency, ChatConfig, Retry

MESSAGES = [{"role": "user", "content": "Hello?"}]
PATIENT = Retry(first_seconds=0.02, longest_seconds=0.05, refused_tries=1000)
AS_IT_IS = AdaptiveConcurrency(first=1000, shrink=1, slower=1e9)


def config(base_url: str, **changes: Any) -> ChatConfig:
    settings: dict[str, Any] = {"base_url": base_url, "model": "tiny", "retry": PATIENT}
    return ChatConfig(**(settings | changes))


async def ask_often(client: ChatClient, count: int) -> list[int]:
    """The limit after each reply."""
    limits: list[int] = []

    async def ask() -> None:
        await client.complete(MESSAGES)
        limits.append(client.concurrency_now)

    async with asyncio.TaskGroup() as group:
        for _ in range(count):
            group.create_task(ask())
    return limits


async def test_refusals_cut_the_limit_and_nobody_is_lost(endpoint: Endpoint) -> None:
    endpoint.allowed = 4
    async with ChatClient(config(endpoint.url("limited"), concurrency=32)) as client:
        limits = await ask_often(client, 80)
    assert endpoint.answered == 80
    assert min(limits) < AdaptiveConcurrency().first

    async with ChatClient(config(endpoint.url("limited"), concurrency=32, adapt=AS_IT_IS)) as client:
        limits = await ask_often(client, 80)
    assert endpoint.answered == 160
    assert set(limits) == {32}


async def test_retry_after_of_one_holds_all_back(endpoint: Endpoint) -> None:
    endpoint.fails_left, endpoint.retry_after = 1, "1"
    async with ChatClient(config(endpoint.url("flaky"), adapt=AdaptiveConcurrency(first=1))) as client:
        await ask_often(client, 5)
    first, *others = endpoint.times
    assert len(others) == 5
    assert min(others) - first >= 1


async def test_a_retry_after_beyond_all_patience_holds_nobody_back(endpoint: Endpoint) -> None:
    endpoint.fails_left, endpoint.retry_after = 1, "86400"
    async with ChatClient(config(endpoint.url("flaky"), total_seconds=5)) as client:
        with pytest.raises(Exception, match="slow down"):
            await client.complete(MESSAGES)
        async with asyncio.timeout(5):
            assert (await client.complete(MESSAGES)).text == "Hello."


async def test_a_spent_quota_is_not_waited_for(endpoint: Endpoint) -> None:
    async with ChatClient(config(endpoint.url("quota"))) as client:
        with pytest.raises(Exception, match="you exceeded your quota"):
            await client.complete(MESSAGES)
    assert len(endpoint.requests) == 1


# --- the gate alone -------------------------------------------------------------------------------------


async def test_what_was_sent_before_a_cut_does_not_cut_again() -> None:
    gate = ConcurrencyLimiter(100, AdaptiveConcurrency(first=100, shrink=0.5))
    before = [gate.turn() for _ in range(100)]
    turns = [await turn.__aenter__() for turn in before]
    for turn in turns:
        turn.refused()
    assert gate.limit == 50
    for context in before:
        await context.__aexit__(None, None, None)
    async with gate.turn() as turn:
        turn.refused()
    assert gate.limit == 25


async def refused_by_four(gate: ConcurrencyLimiter, count: int) -> tuple[list[int], int]:
    """The limits after each of so many answers of an endpoint that serves four at once and refuses others,
    and how often it refused. Its time is turns of the event loop, so that every run is the same.
    """
    limits: list[int] = []
    served = refused = 0

    async def pass_time(turns: int) -> None:
        for _ in range(turns):
            await asyncio.sleep(0)

    async def one() -> None:
        nonlocal served, refused
        again = False
        while True:
            async with gate.turn(again=again) as turn:
                if served < 4:
                    served += 1
                    await pass_time(100)
                    served -= 1
                    turn.answered(1.0)
                    limits.append(gate.limit)
                    return
                refused += 1
                await pass_time(2)
                turn.refused()
            again = True
            await pass_time(20)

    async with asyncio.TaskGroup() as group:
        for _ in range(count):
            group.create_task(one())
    return limits, refused


async def test_it_finds_out_what_an_endpoint_allows() -> None:
    limits, adapted = await refused_by_four(ConcurrencyLimiter(32, AdaptiveConcurrency()), 80)
    assert set(limits[40:]) <= {3, 4, 5}
    limits, refused = await refused_by_four(ConcurrencyLimiter(32, AS_IT_IS), 80)
    assert set(limits) == {32}
    assert 0 < adapted < refused / 2


async def played(gate: ConcurrencyLimiter, count: int, pace: Callable[[int], float]) -> list[int]:
    """The limits after each of so many answers, whose pace depends on how many are in flight."""
    limits: list[int] = []

    async def one() -> None:
        async with gate.turn() as turn:
            await asyncio.sleep(0)
            turn.answered(pace(gate.in_flight))
            limits.append(gate.limit)

    async with asyncio.TaskGroup() as group:
        for _ in range(count):
            group.create_task(one())
    return limits


async def test_it_grows_where_nothing_holds_it_back() -> None:
    gate = ConcurrencyLimiter(200, AdaptiveConcurrency(first=2))
    limits = await played(gate, 2000, lambda _: 1.0)
    assert limits[:3] == [3, 4, 5]
    assert max(limits) == 200


async def test_an_endpoint_that_only_queues_is_not_crowded() -> None:
    """One that does five at a time, and lets the others wait."""
    gate = ConcurrencyLimiter(1000, AdaptiveConcurrency(first=2, slower=3))
    limits = await played(gate, 20_000, lambda in_flight: max(1.0, in_flight / 5))
    assert max(limits[1000:]) <= 17
    assert min(limits[1000:]) >= 12


async def test_a_slower_endpoint_is_accepted_in_time() -> None:
    gate = ConcurrencyLimiter(50, AdaptiveConcurrency(first=50, slower=2))
    await played(gate, 500, lambda _: 1.0)
    lowest = min(await played(gate, 5000, lambda _: 5.0))
    assert lowest < 30
    await played(gate, 5000, lambda _: 5.0)
    assert gate.limit == 50


async def test_it_does_not_grow_unused() -> None:
    gate = ConcurrencyLimiter(100, AdaptiveConcurrency(first=4))
    for _ in range(50):
        async with gate.turn() as turn:
            turn.answered(1.0)
    assert gate.limit == 4


async def test_it_grows_by_one_a_round_after_a_cut() -> None:
    gate = ConcurrencyLimiter(100, AdaptiveConcurrency(first=10, shrink=0.8, round_replies=1))

    contexts = [gate.turn() for _ in range(10)]
    turns = [await context.__aenter__() for context in contexts]
    turns[0].refused()
    for context in contexts:
        await context.__aexit__(None, None, None)
    assert gate.limit == 8
    await played(gate, 8 + 9 + 10 + 30, lambda _: 1.0)
    assert 11 <= gate.limit <= 13


async def test_who_waits_and_leaves_takes_nobodys_place() -> None:
    gate = ConcurrencyLimiter(1, AdaptiveConcurrency())
    order: list[str] = []

    async def take(name: str, again: bool = False) -> None:
        async with gate.turn(again=again):
            order.append(name)
            await asyncio.sleep(0)

    async with asyncio.TaskGroup() as group, gate.turn():
        first = group.create_task(take("first"))
        group.create_task(take("second"))
        group.create_task(take("again", again=True))
        await asyncio.sleep(0)
        first.cancel()
        await asyncio.sleep(0)
        assert gate.in_flight == 1
    assert order == ["again", "second"]
    assert gate.in_flight == 0


async def test_who_leaves_while_being_let_in_passes_the_place_on() -> None:
    gate = ConcurrencyLimiter(1, AdaptiveConcurrency())

    async def take() -> None:
        async with gate.turn():
            pass

    context = gate.turn()
    await context.__aenter__()
    first, second = asyncio.create_task(take()), asyncio.create_task(take())
    await asyncio.sleep(0)
    await context.__aexit__(None, None, None)  # lets the first in, which has not run yet
    first.cancel()
    async with asyncio.timeout(5):
        await second
    assert gate.in_flight == 0
