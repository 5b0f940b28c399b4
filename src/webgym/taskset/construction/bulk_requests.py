"""Many model requests with bounded concurrency; each gives a result or the reason for its failure."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import Final, Generic, TypeVar

import msgspec

from webgym.core.errors import BudgetSpent, CacheError, LLMError, LLMUnreachable, LLMUnusable, NotCached
from webgym.llm.client import EndpointRefused

T = TypeVar("T")
R = TypeVar("R")

_PERMANENT_FAILURES: Final = frozenset({401, 402, 403, 404, 405})
"""HTTP statuses that every further request would get, too."""


class Done(msgspec.Struct, Generic[R], frozen=True):
    """The result of a request."""

    value: R


class Failed(msgspec.Struct, frozen=True):
    """A failed request.

    Attributes:
        reason: why, in one line.
        replies: the model's unusable replies, if any.
        may_pass: whether the endpoint failed rather than the model, so that another run may succeed.
    """

    reason: str
    replies: tuple[str, ...] = ()
    may_pass: bool = False


class Pending(msgspec.Struct, frozen=True):
    """A request without a reply yet: it will come from a batch, or from a run without ``--dry-run``."""


async def ask_all(
    items: Sequence[T],
    ask: Callable[[T], Awaitable[R]],
    *,
    workers: int,
    failures_in_a_row: int,
    advance: Callable[[], None],
) -> list[Done[R] | Failed | Pending]:
    """Send a request for each item.

    Args:
        items: what to ask about.
        ask: sends the request for one item and returns its result.
        workers: number of concurrent requests.
        failures_in_a_row: number of consecutive failures of the endpoint after which no more requests are
            sent.
        advance: called after each item.

    Returns:
        The results, in the order of the items.

    Raises:
        BudgetSpent: the budget is spent. Requests in flight are awaited first, so that their replies are
            kept.
        LLMError: the endpoint cannot be used at all, or failed too often in a row.
        CacheError: replies cannot be stored.
    """
    results: list[Done[R] | Failed | Pending] = [Pending()] * len(items)
    work = iter(range(len(items)))
    stop = _Stop(failures_in_a_row)

    async def worker(indices: Iterator[int]) -> None:
        for index in indices:
            if stop.reason is not None:
                return
            try:
                results[index] = Done(await ask(items[index]))
                stop.reply()
            except NotCached:
                results[index] = Pending()
            except LLMUnusable as error:
                results[index] = Failed(error.reason or error.message, error.replies)
                stop.reply()
            except (LLMError, CacheError) as error:
                stop.failure(error)
                results[index] = Failed(error.message, may_pass=True)
            advance()

    async with asyncio.TaskGroup() as group:
        for _ in range(min(workers, len(items))):
            group.create_task(worker(work))
    if stop.reason is not None:
        raise stop.reason
    return results


class _Stop:
    """Decides by the failures so far whether to stop; ``reason`` is then set."""

    def __init__(self, most_in_a_row: int) -> None:
        self.reason: LLMError | CacheError | None = None
        self._most = most_in_a_row
        self._in_a_row = 0

    def reply(self) -> None:
        self._in_a_row = 0

    def failure(self, error: LLMError | CacheError) -> None:
        self._in_a_row += 1
        is_permanent = isinstance(error, EndpointRefused) and error.status in _PERMANENT_FAILURES
        is_final = isinstance(error, BudgetSpent | CacheError | LLMUnreachable) or is_permanent
        if self.reason is None and (is_final or self._in_a_row >= self._most):
            self.reason = error
