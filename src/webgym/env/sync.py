"""An environment for scripts and notebooks: the same calls, without ``await``."""

from __future__ import annotations

import asyncio
import concurrent.futures
import os
import threading
import weakref
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, Self, TypeVar

from webgym.core.action import Action
from webgym.core.errors import UsageError
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.env.environment import Environment, Info
from webgym.server.messages import View

T = TypeVar("T")


class LoopThread:
    """An event loop in its own thread. It also runs between calls, so that browser leases are renewed.

    Args:
        closing: run at the end: when this is closed or garbage-collected, or Python exits.
    """

    def __init__(self, closing: Callable[[], Coroutine[Any, Any, object]]) -> None:
        self._process = os.getpid()
        self._submitting = threading.RLock()
        self._loop = asyncio.new_event_loop()
        thread = threading.Thread(target=self._loop.run_forever, name="webgym", daemon=True)
        thread.start()
        self._ending = weakref.finalize(
            self, _end, self._process, self._submitting, self._loop, thread, closing
        )
        # Browsers end with the help of threads, and executors refuse work before `atexit` runs: this runs
        # before theirs, if they are imported before.
        register = getattr(threading, "_register_atexit", lambda _: None)
        register(self._ending)

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Wait for a coroutine's result, or raise what it raises.

        Args:
            work: the coroutine; call this from another thread than the loop's.

        Raises:
            UsageError: it is closed, at the latest during the call; or the call is made in a process that
                was forked from this object's.
        """
        if os.getpid() != self._process:
            work.close()
            raise UsageError("this belongs to the process that made it", hint="make another in each process")
        with self._submitting:
            if not self._ending.alive:
                work.close()
                raise UsageError("this is closed", hint="make another")
            future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except concurrent.futures.CancelledError:
            raise UsageError("this was closed during the call", hint="make another") from None
        except BaseException:  # such as Ctrl-C: do not leave the coroutine running
            future.cancel()
            raise

    def close(self) -> None:
        """Run ``closing``, cancel what still runs, and stop the loop. Safe to call twice."""
        self._ending()


def _end(
    process: int,
    submitting: threading.RLock,
    loop: asyncio.AbstractEventLoop,
    thread: threading.Thread,
    closing: Callable[[], Coroutine[Any, Any, object]],
) -> None:
    if os.getpid() != process:
        return  # forked: the loop's thread exists only in the other process
    with submitting:  # what other threads submitted comes before the end, and nothing after it
        pass
    closed = asyncio.run_coroutine_threadsafe(_close(closing), loop)
    closed.add_done_callback(lambda _: loop.call_soon_threadsafe(loop.stop))
    if threading.current_thread() is not thread:  # garbage may be collected on the loop's thread, too
        thread.join()
        loop.close()
        closed.result()


async def _close(closing: Callable[[], Coroutine[Any, Any, object]]) -> None:
    try:
        await closing()
    finally:
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)


class SyncEnvironment:
    """A blocking :class:`~webgym.env.environment.Environment`, on an event loop in its own thread::

        with webgym.SyncEnvironment(webgym.make("offline-v2")) as env:
            view, info = env.reset(seed=7)
            view, reward, terminated, truncated, info = env.step(Scroll("down"))

    Works where an event loop is already running, as in a notebook. Not thread-safe.

    Args:
        env: not open yet; the first :meth:`reset`, or entering this object, opens it.
    """

    def __init__(self, env: Environment) -> None:
        self._env = env
        self._loop = LoopThread(env.close)
        self._is_open = False

    def __enter__(self) -> Self:
        if not self._is_open:
            self._loop.run(self._env.__aenter__())
            self._is_open = True
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    @property
    def tasks(self) -> Mapping[str, Task]:
        """See :attr:`webgym.Environment.tasks`."""
        return self.__enter__()._env.tasks

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[View, Info]:
        """See :meth:`webgym.Environment.reset`."""
        self.__enter__()
        return self._loop.run(self._env.reset(seed=seed, options=options))

    def step(self, action: Action | str | Reply) -> tuple[View, float, bool, bool, Info]:
        """See :meth:`webgym.Environment.step`."""
        return self._loop.run(self._env.step(action))

    def close(self) -> None:
        """Close the environment and stop the thread. Safe to call twice."""
        self._loop.close()
