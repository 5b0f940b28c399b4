"""What may still be spent. What was spent is counted where the replies are kept."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager

from pydantic import Field

from webgym.core.errors import BudgetSpent, ConfigError
from webgym.llm.cache import ReplyCache
from webgym.llm.prices import Prices
from webgym.llm.usage import Call, Totals, Usage
from webgym.settings import Settings


class Budget(Settings):
    """How much may be spent, all time: what a cache's file says was spent before counts.

    A call is made only if what was spent, the most that the calls in flight can cost and the most that it can
    cost itself fit into the budget together. While calls are in flight the others wait for what they leave.
    """

    dollars: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    """Dollars that may be spent, all runs together. Calls whose price was not known count as nothing."""

    tokens: int | None = Field(default=None, ge=0)
    """Of prompts and replies together."""

    longest_reply: int = Field(default=16_384, ge=1)
    """Tokens that a reply is taken to have at most where its sampling sets no ``max_tokens``."""


class Ledger:
    """What calls cost, per purpose and model, and whether the next may be made.

    Args:
        cache: its file keeps the account, across runs and processes. The clients that the ledger is given to
            must be given the same cache. Without one the account lasts as long as the ledger.
        prices: what tokens cost. Tokens of models that are not in it are counted, and called unpriced.
        budget: what may be spent; no limit if not given.

    Attributes:
        cache, prices, budget: as given.
    """

    def __init__(
        self, cache: ReplyCache | None = None, *, prices: Prices | None = None, budget: Budget | None = None
    ) -> None:
        self.cache = cache
        self.prices = prices or Prices()
        self.budget = budget or Budget()
        self._own = Totals()
        self._reserved = Usage()
        self._in_flight = 0
        self._freed = asyncio.Event()

    @property
    def totals(self) -> Totals:
        """Everything that was spent."""
        return self._own if self.cache is None else self.cache.totals

    @property
    def rows(self) -> Mapping[tuple[str, str], Usage]:
        """Sums by ``(purpose, model)``."""
        return self.totals.rows

    @property
    def has_budget(self) -> bool:
        """Whether there is any limit."""
        return self.budget.dollars is not None or self.budget.tokens is not None

    def cost(
        self,
        model: str,
        prompt_tokens: int,
        completion_tokens: int,
        *,
        cached: int = 0,
        in_batch: bool = False,
    ) -> float | None:
        """Dollars of a call; ``None`` if the model's price is not known."""
        price = self.prices.of(model)
        if price is None:
            return None
        return price.dollars(prompt_tokens, completion_tokens, cached_tokens=cached, in_batch=in_batch)

    def paid(self, call: Call) -> None:
        """Count a call in, if no cache does."""
        if self.cache is None:
            self._own.paid(call)

    def hit(self, purpose: str, model: str) -> None:
        """Count a call that cost nothing in, if no cache does."""
        if self.cache is None:
            self._own.hit(purpose, model)

    @asynccontextmanager
    async def reserved(self, model: str, prompt_tokens: int, completion_tokens: int) -> AsyncIterator[None]:
        """Set aside what a call can cost at most, until the ``async with`` block ends.

        Waits while calls in flight may leave enough.

        Raises:
            BudgetSpent: nothing is in flight, and what is left may not be enough.
            ConfigError: the budget is in dollars, and the model's price is not known.
        """
        dollars = self.cost(model, prompt_tokens, completion_tokens)
        if dollars is None and self.budget.dollars is not None:
            hint = "give its price (--price PROMPT,COMPLETION), or a budget in tokens"
            raise ConfigError(f"a budget in dollars needs the price of {model}", hint=hint)
        wanted = Usage(
            prompt_tokens=prompt_tokens, completion_tokens=completion_tokens, dollars=dollars or 0.0
        )
        while not self._fits(wanted):
            if not self._in_flight:
                raise BudgetSpent(self._told(wanted))
            await self._freed.wait()
        self._in_flight += 1
        self._add(wanted, 1)
        try:
            yield
        finally:
            self._in_flight -= 1
            self._add(wanted, -1)
            self._freed.set()
            self._freed = asyncio.Event()

    def _fits(self, wanted: Usage) -> bool:
        spent, budget = self.totals.all, self.budget
        if budget.tokens is not None and spent.tokens + self._reserved.tokens + wanted.tokens > budget.tokens:
            return False
        dollars = spent.dollars + self._reserved.dollars + wanted.dollars
        return budget.dollars is None or dollars <= budget.dollars

    def _told(self, wanted: Usage) -> str:
        spent, budget = self.totals.all, self.budget
        if budget.dollars is not None and spent.dollars + wanted.dollars > budget.dollars:
            return (
                f"${spent.dollars:.4f} of the budget of ${budget.dollars:.4f} is spent,"
                f" and the next call could cost ${wanted.dollars:.4f}"
            )
        return (
            f"{spent.tokens:,} of the budget of {budget.tokens:,} tokens are spent,"
            f" and the next call could use {wanted.tokens:,}"
        )

    def _add(self, usage: Usage, sign: int) -> None:
        self._reserved.prompt_tokens += sign * usage.prompt_tokens
        self._reserved.completion_tokens += sign * usage.completion_tokens
        # Sums of floats leave dust behind.
        self._reserved.dollars = max(0.0, self._reserved.dollars + sign * usage.dollars)
        if not self._in_flight:
            self._reserved.dollars = 0.0
