"""A background task for the duration of a block; whose cancellation it is."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any


@asynccontextmanager
async def running_in_background(work: Coroutine[Any, Any, object]) -> AsyncIterator[None]:
    """Run ``work`` as a task during the block; it is cancelled when the block ends.

    Raises:
        Exception: the exception that ended ``work``, raised when the block ends.
    """
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait({task})
        if not task.cancelled():
            task.result()


def is_cancelled(error: BaseException) -> bool:
    """Whether this is the cancellation of the running task, and not one that leaked out of code that it
    called: a task that ends with that counts as cancelled, and its group does not learn of the failure."""
    if not isinstance(error, asyncio.CancelledError):
        return False
    task = asyncio.current_task()
    return task is None or task.cancelling() > 0
