"""The checks of adapters find one that breaks a promise."""

from __future__ import annotations

import asyncio
import functools
import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

import webgym
from webgym import Action, RunConfig
from webgym.testing import Adapted, Told, check_adapter
from webgym.testing import environments as adapter_conformance
from webgym.testing.environments import _StandIns


async def played(env: webgym.Environment, task_id: str, actions: Sequence[Action | str]) -> list[float]:
    await env.reset(options={"task_id": task_id})
    rewards = []
    for action in actions:
        _, reward, terminated, truncated, _ = await env.step(action)
        rewards.append(reward)
        if terminated or truncated:
            break
    return rewards


async def right(pool: webgym.EnvironmentPool, task_id: str, actions: Sequence[Action | str]) -> Told:
    async with pool.environment() as env:
        *early, last = await played(env, task_id, actions)
    return Told([] if math.isnan(last) else [last], early)


async def a_fault_is_0(pool: webgym.EnvironmentPool, *given: Any) -> Told:
    told = await right(pool, *given)
    return Told(told.final or [0.0], told.early)


async def rewards_every_step(pool: webgym.EnvironmentPool, *given: Any) -> Told:
    told = await right(pool, *given)
    return Told(told.final, [0.1] * len(told.early))


async def one_row_has_another(pool: webgym.EnvironmentPool, *given: Any) -> Told:
    told = await right(pool, *given)
    return Told([0.0, *told.final] if told.final else [], told.early)


async def keeps_its_browser(pool: webgym.EnvironmentPool, *given: Any) -> Told:
    context = pool.environment()
    env = await context.__aenter__()
    KEPT.append(context)
    *early, last = await played(env, *given)
    await env.reset()
    return Told([] if math.isnan(last) else [last], early)


async def cannot_be_cancelled(pool: webgym.EnvironmentPool, *given: Any) -> Told:
    return await asyncio.shield(asyncio.ensure_future(right(pool, *given)))


async def is_remembered(pool: webgym.EnvironmentPool, *given: Any) -> Told:
    KEPT.append(asyncio.current_task())
    return await right(pool, *given)


async def all_share_one(pool: webgym.EnvironmentPool, task_id: str, actions: Sequence[Action | str]) -> Told:
    return await right(pool, task_id, actions if task_id == "check-3" else [*actions[:1], actions[-1]])


KEPT: list[Any] = []


def adapter(play: Callable[..., Any]) -> Any:
    @asynccontextmanager
    async def adapt(given: dict[str, Any]) -> AsyncIterator[Adapted]:
        async with webgym.EnvironmentPool(**given) as pool:
            yield Adapted(functools.partial(play, pool))

    return adapt


@asynccontextmanager
async def holds_environments(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    async with webgym.EnvironmentPool(**given) as pool:

        async def begin(task_id: str) -> webgym.Environment:
            KEPT.append(pool.environment())
            env: webgym.Environment = await KEPT[-1].__aenter__()
            await env.reset(options={"task_id": task_id})
            return env

        yield Adapted(functools.partial(right, pool), begin)


@asynccontextmanager
async def begins_nothing(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    async with webgym.EnvironmentPool(**given) as pool:
        yield Adapted(functools.partial(right, pool), functools.partial(asyncio.sleep, 0))


def rows(name: str, config: RunConfig) -> list[str]:
    return [row["task_id"] for row in webgym.task_rows(name, split="all", count=6, config=config)]


async def test_a_right_one_passes() -> None:
    assert await check_adapter(adapter(right), rows=rows) == []


@pytest.fixture
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What stays is not waited for long. A right adapter has the usual time, also on a busy machine."""
    monkeypatch.setattr(adapter_conformance, "_COLLECTED_SECONDS", 0.5)
    KEPT.clear()


@pytest.mark.usefixtures("_soon")
@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (a_fault_is_0, "a fault (judge) is told as"),
        (rewards_every_step, "a reward before the end"),
        (one_row_has_another, "is told as [0.0, 1.0], not as 1.0"),
        (keeps_its_browser, "an episode that is over keeps its browser"),
        (cannot_be_cancelled, "an episode that is cancelled keeps its browser"),
        (is_remembered, "an episode that is forgotten keeps its browser"),
        (all_share_one, "two episodes of [1, 3] steps have taken [1, 1]"),
    ],
)
async def test_one_that_breaks_a_promise_is_found(wrong: Callable[..., Any], told: str) -> None:
    found = await check_adapter(adapter(wrong))
    assert any(told in line for line in found), found


@pytest.mark.usefixtures("_soon")
async def test_one_that_holds_what_its_framework_has_dropped_is_found() -> None:
    found = await check_adapter(holds_environments)
    assert "an episode that is forgotten keeps its browser" in found
    assert await check_adapter(begins_nothing) == ["an episode that has begun has no browser"]


class NeverClosed(_StandIns):
    """Counts browsers in its own way."""

    def open_browsers(self) -> int:
        return 1


@pytest.mark.usefixtures("_soon")
async def test_a_backend_of_ones_own_says_what_is_open(tmp_path: Path) -> None:
    found = await check_adapter(adapter(right), backend=NeverClosed(tmp_path))
    assert "an episode that is over keeps its browser" in found
    assert "an adapter that is closed keeps its browsers" in found


async def test_rows_that_know_no_seed_are_found() -> None:
    found = await check_adapter(adapter(right), rows=lambda name, config: ["a", "b"])
    assert found == ["another seed gives the same tasks"]
