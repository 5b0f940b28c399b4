"""Many model requests, a bounded number at a time; each gives a result or the reason why there is none."""

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
"""Statuses that every further request would get as well."""


class Done(msgspec.Struct, Generic[R], frozen=True):
    """A result."""

    value: R


class Failed(msgspec.Struct, frozen=True):
    """A failure.

    Attributes:
        reason: one line.
        replies: what the model said, if it said anything.
        may_pass: the endpoint did it, so that another run may do better.
    """

    reason: str
    replies: tuple[str, ...] = ()
    may_pass: bool = False


class Pending(msgspec.Struct, frozen=True):
    """No reply yet: it will come from a batch, or from a run without ``--dry-run``."""


async def ask_all(
    things: Sequence[T],
    ask: Callable[[T], Awaitable[R]],
    *,
    workers: int,
    failures_in_a_row: int,
    advance: Callable[[], None],
) -> list[Done[R] | Failed | Pending]:
    """Ask about each thing; results in the order of the things.

    Args:
        things: what to ask about.
        ask: asks about one.
        workers: how many are asked about at a time.
        failures_in_a_row: so many failures of the endpoint, with no reply between them, end it.
        advance: called after each.

    Raises:
        BudgetSpent: the budget is spent. Calls in flight are awaited first, so that their replies are kept.
        LLMError: the endpoint cannot be used at all, or has failed too often in a row.
        CacheError: replies cannot be kept.
    """
    results: list[Done[R] | Failed | Pending] = [Pending()] * len(things)
    work = iter(range(len(things)))
    stop = _Stop(failures_in_a_row)

    async def worker(indices: Iterator[int]) -> None:
        for index in indices:
            if stop.reason is not None:
                return
            try:
                results[index] = Done(await ask(things[index]))
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
        for _ in range(min(workers, len(things))):
            group.create_task(worker(work))
    if stop.reason is not None:
        raise stop.reason
    return results


class _Stop:
    """Whether to continue, by what went wrong so far."""

    def __init__(self, most_in_a_row: int) -> None:
        self.reason: LLMError | CacheError | None = None
        self._most = most_in_a_row
        self._in_a_row = 0

    def reply(self) -> None:
        self._in_a_row = 0

    def failure(self, error: LLMError | CacheError) -> None:
        self._in_a_row += 1
        is_permanent = isinstance(error, EndpointRefused) and error.status in _PERMANENT_FAILURES
        for_good = isinstance(error, BudgetSpent | CacheError | LLMUnreachable) or is_permanent
        if self.reason is None and (for_good or self._in_a_row >= self._most):
            self.reason = error
