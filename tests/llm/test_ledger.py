from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from tests.llm.endpoint import Endpoint, config

from webgym.core.errors import BudgetSpent, ConfigError, LLMBadReply
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.config import Retry, Sampling
from webgym.llm.ledger import Budget, Ledger
from webgym.llm.prices import Price, Prices

TINY = Prices({"tiny": Price(prompt=1_000, completion=10_000)})  # 12 + 3 tokens: $0.012 + $0.030


def ask(number: int) -> list[dict[str, str]]:
    return [{"role": "user", "content": str(number)}]


async def test_calls_tokens_and_dollars_per_purpose_across_runs(endpoint: Endpoint, path: Path) -> None:
    for _ in range(2):
        async with ReplyCache(path) as cache:
            ledger = Ledger(cache, prices=TINY)
            async with ChatClient(config(endpoint.url()), cache=cache, ledger=ledger) as client:
                for number in range(3):
                    await client.labelled("rubrics").complete(ask(number))
                await client.complete(ask(3), purpose="websites")
            assert set(ledger.rows) == {("rubrics", "tiny"), ("websites", "tiny")}
            rubrics = ledger.rows["rubrics", "tiny"]
            assert (rubrics.calls, rubrics.prompt_tokens, rubrics.completion_tokens) == (3, 36, 9)
            assert rubrics.dollars == pytest.approx(3 * 0.042)
            assert ledger.totals.all.dollars == pytest.approx(4 * 0.042)
            assert rubrics.unpriced == 0
    async with ReplyCache(path) as cache:
        assert (cache.totals.all.calls, cache.totals.all.hits) == (4, 4)


async def test_another_process_is_seen(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as one, ReplyCache(path) as two:
        for number, cache in enumerate((one, two)):
            async with ChatClient(config(endpoint.url()), cache=cache) as client:
                await client.complete(ask(number))
        assert two.totals.all.calls == 2


@pytest.mark.parametrize("behaviour", ["broken_off", "number"])
async def test_replies_that_cannot_be_used_are_paid_for(
    endpoint: Endpoint, path: Path, behaviour: str
) -> None:
    settings = config(endpoint.url(behaviour), retry=Retry(tries=2, first_seconds=0.01))
    async with ReplyCache(path) as cache:
        ledger = Ledger(cache, prices=TINY)
        async with ChatClient(settings, cache=cache, ledger=ledger) as client:
            with pytest.raises(LLMBadReply):
                await client.complete(ask(0), purpose="websites")
        spent = ledger.rows["websites", "tiny"]
        assert spent.calls == len(endpoint.requests)
        assert spent.tokens == 15 * spent.calls
        assert spent.dollars == pytest.approx(0.042 * spent.calls)
        async with ChatClient(config(endpoint.url("fine")), cache=cache, ledger=ledger) as client:
            assert not (await client.complete(ask(0))).cached


async def test_without_a_price_there_are_only_tokens(endpoint: Endpoint) -> None:
    ledger = Ledger()
    async with ChatClient(config(endpoint.url()), ledger=ledger) as client:
        await client.complete(ask(0))
    assert (ledger.totals.all.tokens, ledger.totals.all.dollars, ledger.totals.all.unpriced) == (15, 0, 1)


async def test_an_endpoint_that_does_not_count_is_counted_for(endpoint: Endpoint) -> None:
    ledger = Ledger()
    async with ChatClient(config(endpoint.url("bare")), ledger=ledger) as client:
        await client.complete([{"role": "user", "content": "word " * 1000}])
    assert ledger.totals.all.estimated == 1
    assert 700 < ledger.totals.all.prompt_tokens < 1500


async def test_what_the_endpoint_had_read_before_is_cheaper(endpoint: Endpoint) -> None:
    endpoint.usage["prompt_tokens_details"] = {"cached_tokens": 10}
    ledger = Ledger(prices=Prices.parse("1000,100,10000"))
    async with ChatClient(config(endpoint.url()), ledger=ledger) as client:
        reply = await client.complete(ask(0))
    assert reply.prompt_tokens_cached == ledger.totals.all.prompt_tokens_cached == 10
    assert ledger.totals.all.dollars == pytest.approx(2 * 1e-3 + 10 * 1e-4 + 3 * 1e-2)


@pytest.mark.parametrize("concurrency", [1, 16])
async def test_a_budget_is_used_and_never_exceeded(endpoint: Endpoint, path: Path, concurrency: int) -> None:
    budget = Budget(tokens=1500)
    sampling = Sampling(max_tokens=3)
    settings = config(endpoint.url("numbered"), concurrency=concurrency, sampling=sampling)
    for _ in range(2):  # it is spent once, not once per run
        async with ReplyCache(path) as cache:
            ledger = Ledger(cache, budget=budget)
            async with ChatClient(settings, cache=cache, ledger=ledger) as client:
                found = await asyncio.gather(
                    *(client.complete(ask(number)) for number in range(120)), return_exceptions=True
                )
            spent = [each for each in found if isinstance(each, BaseException)]
            assert spent
            assert all(isinstance(each, BudgetSpent) for each in spent)
            assert ledger.totals.all.calls == len(endpoint.requests) == 120 - len(spent)
            assert 1200 < ledger.totals.all.tokens <= 1500
    assert "1,500" in str(spent[0])
    assert "raise the budget" in str(spent[0])


async def test_a_budget_in_dollars(endpoint: Endpoint) -> None:
    ledger = Ledger(prices=TINY, budget=Budget(dollars=1.0, longest_reply=3))
    async with ChatClient(config(endpoint.url("slow")), ledger=ledger) as client:
        found = await asyncio.gather(*(client.complete(ask(n)) for n in range(100)), return_exceptions=True)
    assert "of the budget of $1.0000 is spent" in str(found[-1])
    assert 0.7 < ledger.totals.all.dollars <= 1.0


async def test_failures_give_back_what_was_set_aside(endpoint: Endpoint) -> None:
    ledger = Ledger(budget=Budget(tokens=2000, longest_reply=1000))
    async with ChatClient(config(endpoint.url("500")), ledger=ledger) as client:
        found = await asyncio.gather(*(client.complete(ask(n)) for n in range(10)), return_exceptions=True)
    assert not any(isinstance(each, BudgetSpent) for each in found)
    async with ChatClient(config(endpoint.url("silent")), ledger=ledger) as client:
        asking = asyncio.create_task(client.complete(ask(0)))
        await endpoint.asked.wait()
        asking.cancel()
        await asyncio.wait([asking])
    async with ChatClient(config(endpoint.url()), ledger=ledger) as client:
        assert (await client.complete(ask(0))).text == "Hello."


async def test_a_budget_in_dollars_needs_prices(endpoint: Endpoint) -> None:
    ledger = Ledger(budget=Budget(dollars=1.0))
    async with ChatClient(config(endpoint.url()), ledger=ledger) as client:
        with pytest.raises(ConfigError, match="price of tiny"):
            await client.complete(ask(0))
    assert endpoint.requests == []


async def test_what_is_cached_needs_no_budget(endpoint: Endpoint, path: Path) -> None:
    async with ReplyCache(path) as cache:
        async with ChatClient(config(endpoint.url()), cache=cache) as client:
            await client.complete(ask(0))
        ledger = Ledger(cache, budget=Budget(tokens=0))
        async with ChatClient(config(endpoint.url()), cache=cache, ledger=ledger) as client:
            assert (await client.complete(ask(0))).cached
            with pytest.raises(BudgetSpent):
                await client.complete(ask(1))


async def test_a_ledger_of_another_cache_is_a_mistake(endpoint: Endpoint, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="another cache"):
        ChatClient(config(endpoint.url()), ledger=Ledger(ReplyCache(tmp_path / "a")))


# --- prices -------------------------------------------------------------------------------------------


def test_prices_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "prices.yaml"
    path.write_text(
        "big: {prompt: 2, cached: 1, completion: 8, batch: 0.5}\n'*': {prompt: 1, completion: 1}\n"
    )
    prices = Prices.read(path)
    big = prices.of("big")
    assert big is not None
    assert big.dollars(1_000_000, 500_000) == 6
    assert big.dollars(1_000_000, 0, cached_tokens=600_000) == pytest.approx(1.4)
    assert big.dollars(1_000_000, 500_000, in_batch=True) == 3
    assert "whatever" in prices
    assert "whatever" not in Prices()


@pytest.mark.parametrize(
    "text",
    ["", "5", "a: 1", "a: {prompt: 1}", "a: {prompt: -1, completion: 2}", "[1]", "a: [", "1: {}", "\x00"],
)
def test_what_is_no_table_of_prices(tmp_path: Path, text: str) -> None:
    path = tmp_path / "prices.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        Prices.read(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "1", "a,b", "1,2,3,4", "-1,2", "nan,1", "inf,1"])
def test_what_is_no_price(text: str) -> None:
    with pytest.raises(ConfigError, match="is not a price"):
        Prices.parse(text)
