"""Concurrent tasks: in a group, for a block, or until they end; whose cancellation it is; threads."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, TypeVar

T = TypeVar("T")


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


class BackgroundTasks(set[asyncio.Task[None]]):
    """Tasks that are in progress; the event loop itself may lose tasks that nothing else refers to."""

    def start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a task, which is kept until it ends."""
        task = asyncio.get_running_loop().create_task(work)
        self.add(task)
        task.add_done_callback(self.discard)
        return task


@asynccontextmanager
async def task_group() -> AsyncIterator[asyncio.TaskGroup]:
    """A task group that raises the first error of its tasks instead of an exception group."""
    try:
        async with asyncio.TaskGroup() as group:
            yield group
    except ExceptionGroup as errors:
        raise errors.exceptions[0] from errors


async def uninterrupted(work: Coroutine[Any, Any, T]) -> T:
    """The result of work that goes on though its caller is cancelled, who ends only when the work has ended.

    However often: a task is cancelled by its group and by whoever started it.

    Raises:
        asyncio.CancelledError: the caller was cancelled meanwhile.
    """
    task = asyncio.create_task(work)
    was_cancelled = False
    while not task.done():
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError:
            was_cancelled = True
    if was_cancelled:
        task.exception()  # nobody asks for it any more
        raise asyncio.CancelledError
    return task.result()


async def in_daemon_thread(work: Callable[[], T]) -> T:
    """Do blocking work in a daemon thread, which does not keep the process from ending.

    For what cannot be interrupted and may not return, such as a read from a process that hangs.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[T] = loop.create_future()

    def set_result(result: T | None, error: BaseException | None) -> None:
        if done.cancelled():
            return
        if error is None:
            done.set_result(result)  # type: ignore[arg-type]  # without an error there is a result
        else:
            done.set_exception(error)

    def run() -> None:
        result, error = None, None
        try:
            result = work()
        except BaseException as raised:
            error = raised
        with contextlib.suppress(RuntimeError):  # the event loop has ended
            loop.call_soon_threadsafe(set_result, result, error)

    threading.Thread(target=run, name="blocking-work", daemon=True).start()
    return await done
