"""Budgets of dollars and tokens. Spending is recorded in the cache of replies."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager

from pydantic import Field

from webgym.core.errors import BudgetSpent, ConfigError
from webgym.core.settings import Settings
from webgym.core.tables import Table
from webgym.llm.cache import ReplyCache
from webgym.llm.prices import Call, Prices, Totals, Usage


class Budget(Settings):
    """How much may be spent in total, including earlier spending recorded in the cache.

    A call is made only if past spending, the highest cost of the calls in flight and its own highest cost fit
    into the budget together. Otherwise it waits while calls are in flight, which may cost less.
    """

    dollars: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    """Most dollars to spend, all runs together. Calls without a known price count as 0."""

    tokens: int | None = Field(default=None, ge=0)
    """Most tokens, of prompts and replies together."""

    longest_reply: int = Field(default=16_384, ge=1)
    """Assumed longest reply, in tokens, if its sampling sets no ``max_tokens``."""


class Ledger:
    """Records the cost of calls per purpose and model, and enforces a budget.

    Args:
        cache: stores the records, across runs and processes. Clients with this ledger must have the same
            cache. Without one the records are kept in memory.
        prices: prices of tokens. Calls of models without a price are counted as unpriced.
        budget: limit of spending; by default none.

    Attributes:
        cache, prices, budget: as given.
    """

    def __init__(
        self, cache: ReplyCache | None = None, *, prices: Prices | None = None, budget: Budget | None = None
    ) -> None:
        self.cache = cache
        self.prices = prices or Prices()
        self.budget = budget or Budget()
        self._in_memory = Totals()
        self._reserved = Usage()
        self._in_flight = 0
        self._freed = asyncio.Event()

    @property
    def totals(self) -> Totals:
        """All spending."""
        return self._in_memory if self.cache is None else self.cache.totals

    @property
    def rows(self) -> Mapping[tuple[str, str], Usage]:
        """Sums by ``(purpose, model)``."""
        return self.totals.rows

    def table(self) -> Table:
        """The cost by stage and model, a row each."""
        rows = [
            (
                purpose,
                model,
                *map(str, (usage.calls, usage.hits, usage.prompt_tokens, usage.completion_tokens)),
                "unknown" if usage.unpriced else f"{usage.dollars:.4f}",
            )
            for (purpose, model), usage in sorted(self.rows.items())
        ]
        columns = ("stage", "model", "paid", "cached", "prompt tokens", "reply tokens", "dollars")
        return Table("", columns, rows, names=2)

    @property
    def has_budget(self) -> bool:
        """Whether there is any limit."""
        return self.budget.dollars is not None or self.budget.tokens is not None

    def paid(self, call: Call) -> None:
        """Count a paid call, if the cache does not."""
        if self.cache is None:
            self._in_memory.paid(call)

    def hit(self, purpose: str, model: str) -> None:
        """Count a call that was answered from a cache, if the cache does not."""
        if self.cache is None:
            self._in_memory.hit(purpose, model)

    @asynccontextmanager
    async def reserved(self, model: str, prompt_tokens: int, completion_tokens: int) -> AsyncIterator[None]:
        """Reserve the highest cost of a call, until the ``async with`` block ends.

        Waits while calls are in flight, if the rest of the budget may not be enough.

        Raises:
            BudgetSpent: nothing is in flight, and the rest of the budget may not be enough.
            ConfigError: the budget is in dollars, and the model's price is not known.
        """
        price = self.prices.of(model)
        dollars = None if price is None else price.dollars(prompt_tokens, completion_tokens)
        if dollars is None and self.budget.dollars is not None:
            hint = "give its price (--price PROMPT,COMPLETION), or a budget in tokens"
            raise ConfigError(f"a budget in dollars needs the price of {model}", hint=hint)
        requested = Usage(
            prompt_tokens=prompt_tokens, completion_tokens=completion_tokens, dollars=dollars or 0.0
        )
        while not self._fits(requested):
            if not self._in_flight:
                raise BudgetSpent(self._spent_message(requested))
            await self._freed.wait()
        self._in_flight += 1
        self._add(requested, 1)
        try:
            yield
        finally:
            self._in_flight -= 1
            self._add(requested, -1)
            self._freed.set()
            self._freed = asyncio.Event()

    def _fits(self, requested: Usage) -> bool:
        spent, budget = self.totals.all, self.budget
        if (
            budget.tokens is not None
            and spent.tokens + self._reserved.tokens + requested.tokens > budget.tokens
        ):
            return False
        dollars = spent.dollars + self._reserved.dollars + requested.dollars
        return budget.dollars is None or dollars <= budget.dollars

    def _spent_message(self, requested: Usage) -> str:
        spent, budget = self.totals.all, self.budget
        if budget.dollars is not None and spent.dollars + requested.dollars > budget.dollars:
            return (
                f"${spent.dollars:.4f} of the budget of ${budget.dollars:.4f} is spent,"
                f" and the next call could cost ${requested.dollars:.4f}"
            )
        return (
            f"{spent.tokens:,} of the budget of {budget.tokens:,} tokens are spent,"
            f" and the next call could use {requested.tokens:,}"
        )

    def _add(self, usage: Usage, sign: int) -> None:
        self._reserved.prompt_tokens += sign * usage.prompt_tokens
        self._reserved.completion_tokens += sign * usage.completion_tokens
        # Corrects rounding errors of floating-point sums.
        self._reserved.dollars = max(0.0, self._reserved.dollars + sign * usage.dollars)
        if not self._in_flight:
            self._reserved.dollars = 0.0
