"""What trainers of any kind share: browsers for many episodes at once, and tasks as rows of a dataset.

Needs no torch: whoever evaluates or serves episodes has none.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any, Literal, Self

from webgym.core.errors import ConfigError, UsageError
from webgym.core.text import visible
from webgym.env.environment import Environment, config_of, with_browsers
from webgym.run.choice import choose_tasks
from webgym.run.config import RunConfig
from webgym.tasks.selection import SplitName


class EnvironmentPool:
    """Environments for a trainer that plays many episodes concurrently, on a shared set of browsers.

    They are opened for the first episode, on the calling event loop, and stay open until :meth:`close`::

        pool = webgym.EnvironmentPool("offline-v2", size=32)

        async def episode(task_id):
            async with pool.environment() as env:
                return await webgym.roll_out(env, generate, renderer, task_id=task_id)

    Args:
        name: of the tasks, as for :func:`webgym.make`.
        size: number of browsers, and so of concurrent episodes; further episodes wait.
        split: of the tasks, as for :func:`webgym.make`.
        config: other settings of the environments.
        seed: of the order of tasks: that of each environment has a seed of its own, from this one on.
        given: further arguments of :class:`~webgym.Environment`.

    Raises:
        ConfigError: ``size`` is less than 1, there are no tasks of this name, or there is no such split.
    """

    def __init__(
        self,
        name: str = "offline-v2",
        *,
        size: int = 8,
        split: SplitName = "train",
        config: RunConfig | None = None,
        seed: int = 0,
        **given: Any,
    ) -> None:
        self._first = Environment(config=with_browsers(config_of(name, split, config), size), **given)
        self._free_browsers = asyncio.Semaphore(size)
        self._opening = asyncio.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closing = asyncio.Event()
        self._keeper: asyncio.Task[None] | None = None
        self._seeds = itertools.count(seed)

    @asynccontextmanager
    async def environment(self) -> AsyncIterator[Environment]:
        """An environment for one or more episodes; waits while all browsers are in use.

        Raises:
            UsageError: the pool was opened on another event loop.
        """
        await self.open()
        async with self._free_browsers, self._first.twin(next(self._seeds)) as env:
            yield env

    async def open(self) -> None:
        """Start the browsers and services now, instead of with the first episode.

        Raises:
            UsageError: the pool was opened on another event loop.
        """
        loop = asyncio.get_running_loop()
        if self._loop not in (None, loop):
            raise UsageError("the pool was opened on another event loop", hint="make a pool for each loop")
        self._loop = loop
        async with self._opening:
            if self._keeper is None:
                opened, self._closing = loop.create_future(), asyncio.Event()
                self._keeper = asyncio.create_task(self._keep_open(opened, self._closing))
                try:
                    await asyncio.wait({self._keeper, opened}, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    if not opened.done():
                        self._keeper.cancel()
                        await self.close()

    async def _keep_open(self, opened: asyncio.Future[None], closing: asyncio.Event) -> None:
        """Hold the browsers in a task, so that a program which ends without closing the pool stops them in
        order: asyncio cancels its tasks first, and then closes all generators at once."""
        async with self._first:
            opened.set_result(None)
            await closing.wait()

    async def close(self) -> None:
        """Stop the browsers. Safe to call twice."""
        keeper, self._keeper = self._keeper, None
        if keeper is not None:
            self._closing.set()
            await asyncio.wait({keeper})
            if not keeper.cancelled():
                keeper.result()

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self.close()


@asynccontextmanager
async def make_many(count: int, name: str = "offline-v2", **given: Any) -> AsyncIterator[list[Environment]]:
    """Several environments on the same browsers, websites and judge, each with its own order of tasks::

        async with webgym.make_many(8, "offline-v2") as envs:
            views = await asyncio.gather(*(env.reset() for env in envs))

    Args:
        count: number of environments, and so of browsers.
        name: see :func:`webgym.make`.
        given: further arguments of :class:`EnvironmentPool`.

    Raises:
        ConfigError: ``count`` is less than 1, there are no tasks of this name, or there is no such split.
    """
    async with EnvironmentPool(name, size=count, **given) as pool, AsyncExitStack() as stack:
        yield [await stack.enter_async_context(pool.environment()) for _ in range(count)]


def task_rows(
    name: str = "offline-v2",
    *,
    split: SplitName = "train",
    count: int | Literal["all"] = 20,
    config: RunConfig | None = None,
) -> list[dict[str, str]]:
    """Tasks as rows of a dataset: ``task_id``, ``instruction``, ``website``, ``split``; no rubric, no answer.
    The instruction has no control token of a chat template (:func:`webgym.core.text.visible`).

    Args:
        name: as for :func:`webgym.make`.
        split: of the tasks, as for :func:`webgym.make`.
        count: number of tasks, drawn as for a run.
        config: settings of the draw: ``tasks``, ``seed``.

    Raises:
        ConfigError: there are no such tasks, or ``count`` is less than 1.
        TaskFileError: the task file cannot be read or holds no task.
    """
    if count != "all" and count < 1:
        raise ConfigError(f"count is at least 1, or 'all', not {count}")
    config = config_of(name, split, config)
    config = config.model_copy(update={"tasks": config.tasks.model_copy(update={"count": count})})
    return [
        {
            "task_id": task.id,
            "instruction": visible(task.instruction),
            "website": task.website,
            "split": task.split or split,
        }
        for task in choose_tasks(config).tasks
    ]
