"""A real server and client of OpenEnv: pictures arrive as pictures, and a fault is no reward."""

from __future__ import annotations

import asyncio
import base64
import io
import warnings
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from tests.conftest import wait_until
from tests.integrations.engine import example, reply_text, texts_of
from tests.serving import serving_sockets

import webgym
from webgym import Action, Answer
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool

pytest.importorskip("openenv", reason="openenv is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    from webgym.integrations.openenv import WebGymAction, WebGymClient, WebGymEnvironment, create_app

pytestmark = pytest.mark.filterwarnings("ignore")  # its own

SCROLL = WebGymAction(action={"name": "scroll", "direction": "down"})


@asynccontextmanager
async def served(folder: Path, **more: Any) -> AsyncIterator[tuple[str, Any]]:
    given = stand_in_pool(folder, **more)
    async with webgym.EnvironmentPool(**given) as pool, serving_sockets(create_app(pool=pool, size=4)) as url:
        yield url, given["browsers"]


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    async with (
        webgym.EnvironmentPool(**given) as pool,
        serving_sockets(create_app(pool=pool, size=given["size"])) as url,
    ):

        async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
            told = Told()
            async with WebGymClient(base_url=url) as env:
                await env.reset(task_id=task_id)
                for text in texts_of(actions):
                    result = await env.step(WebGymAction(reply=text))
                    rewards = told.final if result.done else told.early
                    rewards.extend([] if result.reward is None else [result.reward])
                    if result.done:
                        break
            return told

        async def begin(task_id: str) -> WebGymEnvironment:  # what its server holds of a session
            env = WebGymEnvironment(pool)
            await env.reset_async(task_id=task_id)
            return env

        yield Adapted(play, begin)


async def test_it_keeps_the_environments_promises() -> None:
    assert await check_adapter(adapter, cancels=False) == []


async def test_an_episode_over_the_network(tmp_path: Path) -> None:
    async with served(tmp_path) as (url, browsers), WebGymClient(base_url=url) as env:
        first = await env.reset(task_id="check-3")
        seen = first.observation
        assert (seen.task_id, seen.instruction, first.done) == ("check-3", "Find number 3", False)
        second = await env.step(SCROLL)
        pictures = [
            Image.open(io.BytesIO(base64.b64decode(each.observation.image))) for each in (first, second)
        ]
        assert seen.mime_type == "image/png"
        assert [each.size for each in pictures] == [(64, 48)] * 2
        assert pictures[0].tobytes() != pictures[1].tobytes()
        assert (await env.state()).step_count == 1
        last = await env.step(WebGymAction(reply=reply_text(Answer("right"))))
        assert (last.done, last.reward, last.observation.outcome) == (True, 1.0, "success")
        assert not browsers.open_now


@pytest.mark.parametrize("fault", [{"fails": True}, {"fault": "judge"}, {"fault": "blocked"}])
async def test_a_fault_is_no_reward(tmp_path: Path, fault: dict[str, Any]) -> None:
    async with served(tmp_path, **fault) as (url, _), WebGymClient(base_url=url) as env:
        await env.reset(task_id="check-3")
        last = await env.step(SCROLL)
        if not last.done:
            last = await env.step(WebGymAction(reply=reply_text(Answer("right"))))
        assert (last.done, last.reward) == (True, None)
        assert last.observation.outcome not in ("success", "failure", "truncated", None)


async def test_a_client_that_leaves_gives_its_browser_back(tmp_path: Path) -> None:
    async with served(tmp_path) as (url, browsers):
        async with WebGymClient(base_url=url) as one, WebGymClient(base_url=url) as other:
            await one.reset(task_id="check-1")
            await other.reset(task_id="check-2")
            await one.step(SCROLL)
            assert len(browsers.open_now) == 2
            assert sorted(browsers.steps.values()) == [0, 1]
        await asyncio.to_thread(wait_until, lambda: not browsers.open_now)


@pytest.mark.browser
async def test_the_example(capsys: pytest.CaptureFixture[str]) -> None:
    served = example("openenv_server")
    async with serving_sockets(served.app) as url:
        assert await served.main(url) == 0.0
    assert "failure: reward 0.0" in capsys.readouterr().out
