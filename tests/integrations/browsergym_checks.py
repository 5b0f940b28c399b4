"""Checks of what has BrowserGym's browsers: all steps of all episodes are played in Playwright's thread."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import Any, TypeVar

import browsergym.core
import psutil
import pytest

from webgym import Action, Answer, Navigate, RunConfig, Scroll, Wait
from webgym.integrations.browsergym import BrowserGymEnv, NoReward
from webgym.testing import FAULTS, Adapted, Told, check_adapter

T = TypeVar("T")
BUDGET = 4
"""Of steps, or as many as the solution takes."""
APPLICABLE = set(FAULTS)


def browsers() -> list[int]:
    """Ids of the browsers' main processes that Playwright has started and that have not ended.

    Playwright itself learns of one that has ended only when its thread calls it.
    """
    found = []
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):  # of a zombie, too
            command = process.cmdline()
            if any(word.startswith("--remote-debugging-") for word in command):
                found.append(process.pid)
    return found


class Backend:
    """Browsers of BrowserGym, which it starts itself, and one of its tasks.

    Args:
        name: of the task.
        right: what solves it.
        steps: steps of every episode so far.
        options: of the environment.

    Attributes:
        case: what was prepared last.
    """

    def __init__(
        self, name: str, right: Sequence[Action], steps: Callable[[], list[int]], **options: Any
    ) -> None:
        self.given: dict[str, Any] = {"name": name, "config": RunConfig(), "options": options}
        self.case = ""
        self.steps = steps
        self._right = right

    def prepare(self, case: str) -> tuple[str, Sequence[Action | str]]:
        self.case = case
        actions: dict[str, Sequence[Action]] = {
            "wrong": [*[Scroll("down")] * (BUDGET - 1), Answer("no idea")],
            "spent": [Scroll("down")] * max(BUDGET, len(self._right)),
            "browser": [Navigate("chrome://crash"), *self._right],
            "cancelled": [Wait(1), *self._right],
        }
        return self.given["name"], actions.get(case, self._right)

    def open_browsers(self) -> int:
        return len(browsers())

    async def hangs(self) -> None:
        while not self.open_browsers():
            await asyncio.sleep(0.05)


class Adapter:
    """Opens a :class:`BrowserGymEnv` for each episode."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1)
        self._options: dict[str, Any] = {}

    @asynccontextmanager
    async def __call__(self, given: dict[str, Any]) -> AsyncIterator[Adapted]:
        self._options = given["options"]
        yield Adapted(self.play, self.begin)

    async def begin(self, name: str) -> Any:
        """The environment of an episode that has begun."""
        env = self._env(name)
        await asyncio.get_running_loop().run_in_executor(self._thread, env.reset)
        return env

    def _env(self, name: str) -> BrowserGymEnv:
        return BrowserGymEnv(name, pre_observation_delay=0.1, **self._options)

    def run(self, function: Callable[..., T], *given: Any) -> T:
        """Call a function in Playwright's thread."""
        return self._thread.submit(function, *given).result()

    async def play(self, name: str, actions: Sequence[Action | str]) -> Told:
        """An episode. If it is cancelled, the step in progress ends first."""

        def call(function: Callable[..., T], *given: Any) -> asyncio.Future[T]:
            return asyncio.get_running_loop().run_in_executor(self._thread, function, *given)

        told = Told()
        env = self._env(name)
        try:
            await call(env.reset)
            for action in actions:
                _, reward, terminated, truncated, _ = await call(env.step, action)
                (told.final if terminated or truncated else told.early).append(reward)
                if told.final:
                    break
        except NoReward:
            self.failed(told)
        finally:
            await call(self.close, env)
        return told

    def failed(self, told: Told) -> None:
        """The episode has no reward."""

    def close(self, env: BrowserGymEnv) -> None:
        """The episode is over."""
        env.close()


@contextmanager
def playwright_in(adapter: Adapter, patch: pytest.MonkeyPatch) -> Iterator[None]:
    """Use a Playwright of the adapter's thread."""
    patch.setattr(browsergym.core, "_PLAYWRIGHT", None)
    try:
        yield
    finally:
        if browsergym.core._PLAYWRIGHT is not None:
            adapter.run(browsergym.core._PLAYWRIGHT.stop)


def checked(adapter: Adapter, backend: Backend, **more: Any) -> list[str]:
    """What is found, in a thread of its own, as this one may have an event loop of Playwright's."""
    check = functools.partial(check_adapter, adapter, backend=backend, **more)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(lambda: asyncio.run(check())).result()
