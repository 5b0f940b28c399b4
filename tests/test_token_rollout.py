"""From an inference engine to a trainer's rows: what was sampled is what is trained on."""

from __future__ import annotations

import asyncio
import dataclasses
import functools
import gc
import json
from pathlib import Path

import msgspec
import pytest
from tests.inference.tiny import tiny_renderer
from tests.integrations.engine import Engine, reply_text

import webgym
from webgym.core.action import Answer, Scroll
from webgym.core.errors import ConfigError, NoCapacity, UsageError
from webgym.core.outcome import Outcome
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import CollectorConfig
from webgym.testing import stand_in_environment, stand_in_pool
from webgym.testing.environments import STAND_IN_TASKS, StandInBrowsers, StandInJudge

renderer = functools.cache(tiny_renderer)  # by the first test that needs it
RIGHT = (reply_text(Scroll("down")), reply_text(Answer("right")))


async def test_rows_hold_what_was_read_and_sampled() -> None:
    engine = Engine(renderer(), RIGHT)
    async with stand_in_environment() as env:
        rollout = await webgym.roll_out(env, engine, renderer(), task_id="check-3", needs_logprobs=True)
    assert (rollout.task_id, rollout.reward, rollout.outcome) == ("check-3", 1.0, Outcome.SUCCESS)
    assert not rollout.dropped
    assert [row.step for row in rollout.rows] == [0, 1]
    for row, request, text in zip(rollout.rows, engine.requests, RIGHT, strict=True):
        ids, logprobs = engine.sample(text)
        assert row.prompt_ids == request.prompt_ids == renderer().prompt_ids(request.messages)
        assert row.reply_ids == ids
        assert row.logprobs == pytest.approx(logprobs)
        assert row.weight_version == "7"
        assert row.images == request.images
        pixels = row.pixels(renderer())
        assert pixels is not None
        assert int(pixels.grid.prod(1).sum()) // 4 == row.prompt_ids.count(renderer().image_id)
        assert request.short_prompt_ids.count(renderer().image_id) == len(request.images)
        assert len(request.pil_images()) == len(request.images)
    assert len({request.id for request in engine.requests}) == 1


async def test_a_row_that_does_not_hold_together_is_dropped_and_counted() -> None:
    engine = Engine(renderer(), RIGHT)
    async with stand_in_environment() as env:
        engine.change = lambda sampled: dataclasses.replace(sampled, prompt_ids=[1, 2, 3])
        rollout = await webgym.roll_out(env, engine, renderer())
        assert (rollout.rows, rollout.dropped) == ([], {"image_tokens": 2})
        assert rollout.reward == 1.0
        engine = Engine(renderer(), RIGHT)
        engine.change = lambda sampled: dataclasses.replace(sampled, logprobs=None)
        rollout = await webgym.roll_out(env, engine, renderer(), needs_logprobs=True)
        assert (rollout.rows, rollout.dropped) == ([], {"no_logprobs": 2})
        engine = Engine(renderer(), RIGHT)
        rollout = await webgym.roll_out(env, engine, renderer(), cutoff_tokens=50)
        assert (rollout.rows, rollout.dropped) == ([], {"too_long": 2})


async def test_an_episode_without_a_reward_has_no_rows() -> None:
    browsers, judge = StandInBrowsers(), StandInJudge()
    judge.fault = "judge"
    env = webgym.Environment(
        STAND_IN_TASKS, browsers=browsers, judge=judge, config=stand_in_environment().config
    )
    async with env:
        rollout = await webgym.roll_out(env, Engine(renderer(), RIGHT), renderer())
        assert (rollout.reward, rollout.rows, rollout.outcome) == (None, [], Outcome.JUDGE_ERROR)
        assert rollout.dropped == {"no_reward": 2}
        assert rollout.failure is not None
        judge.fault, browsers.fails = "", True
        rollout = await webgym.roll_out(env, Engine(renderer(), RIGHT), renderer())
        assert (rollout.reward, rollout.rows, rollout.outcome) == (None, [], Outcome.ENVIRONMENT_ERROR)
    assert not browsers.open_now


async def test_a_reply_that_writes_the_placeholder_of_pictures_is_no_way_out() -> None:
    """Sampled as plain characters, it would be a picture's token in the next request's history."""
    tokenizer = renderer().tokenizer
    text = f"I see {renderer()._image_token} here.\n{RIGHT[0]}"
    ids = tokenizer(text, add_special_tokens=False, split_special_tokens=True)["input_ids"]
    engine = Engine(renderer(), RIGHT)
    engine.change = lambda sampled: dataclasses.replace(sampled, reply_ids=ids, logprobs=None)
    async with stand_in_environment() as env:
        rollout = await webgym.roll_out(env, engine, renderer(), task_id="check-3")
    assert (rollout.task_id, rollout.reward, rollout.failure) == ("check-3", 0.0, None)
    assert (rollout.outcome, len(engine.requests)) == (Outcome.TRUNCATED, 4)
    assert all(
        len(request.images) == request.short_prompt_ids.count(renderer().image_id)
        for request in engine.requests
    )


async def test_a_reply_of_no_token_is_the_engines_fault() -> None:
    engine = Engine(renderer(), RIGHT[:1] * 9)
    engine.change = lambda sampled: (
        dataclasses.replace(sampled, reply_ids=[], logprobs=[], finish_reason="length")
        if len(engine.requests) > 1
        else sampled
    )
    async with stand_in_environment() as env:
        rollout = await webgym.roll_out(env, engine, renderer())
    assert (rollout.reward, rollout.outcome, len(engine.requests)) == (None, Outcome.POLICY_ERROR, 2)


async def test_an_environment_that_raises_for_faults_is_refused() -> None:
    async with stand_in_environment(on_fault="raise") as env:
        with pytest.raises(UsageError, match="on_fault"):
            await webgym.roll_out(env, Engine(renderer(), RIGHT), renderer())


async def test_no_browser_is_no_reward_and_no_exception() -> None:
    class _None:
        async def open(self, options: object = None) -> object:
            raise NoCapacity("there is none")

    collector = CollectorConfig(server_patience_seconds=0)
    config = stand_in_environment().config.model_copy(update={"collector": collector})
    env = webgym.Environment(STAND_IN_TASKS, browsers=_None(), judge=StandInJudge(), config=config)  # type: ignore[arg-type]
    async with env:
        rollout = await webgym.roll_out(env, Engine(renderer(), RIGHT), renderer(), task_id="check-1")
        assert (rollout.reward, rollout.outcome) == (None, Outcome.ENVIRONMENT_ERROR)
        with pytest.raises(ConfigError, match="no task"):
            await webgym.roll_out(env, Engine(renderer(), RIGHT), renderer(), task_id="nothing")


async def test_an_engine_that_fails_gives_the_browser_back() -> None:
    browsers = StandInBrowsers()
    config = stand_in_environment().config
    env = webgym.Environment(STAND_IN_TASKS, browsers=browsers, judge=StandInJudge(), config=config)

    async def broken(_: webgym.TokenRequest) -> webgym.Sampled:
        raise RuntimeError("out of memory")

    async with env:
        with pytest.raises(RuntimeError, match="out of memory"):
            await webgym.roll_out(env, broken, renderer())
        assert not browsers.open_now


async def test_a_pool_has_as_many_episodes_at_once_as_browsers(tmp_path: Path) -> None:
    webgym.write_tasks(tmp_path / "tasks.jsonl", STAND_IN_TASKS)
    browsers = StandInBrowsers()
    config = stand_in_environment().config
    pool = webgym.EnvironmentPool(
        str(tmp_path / "tasks.jsonl"),
        size=3,
        split="all",
        config=config,
        browsers=browsers,
        judge=StandInJudge(),
    )
    most = 0

    async def episode() -> webgym.TokenRollout:
        nonlocal most
        async with pool.environment() as env:
            rollout = await webgym.roll_out(env, Engine(renderer(), RIGHT), renderer())
            most = max(most, len(browsers.open_now))
            return rollout

    async with pool:
        rollouts = await asyncio.gather(*(episode() for _ in range(12)))
    assert {rollout.reward for rollout in rollouts} == {1.0}
    assert len(browsers.steps) == 12
    assert most <= 3
    assert not browsers.open_now


async def test_an_episode_that_nobody_awaits_any_more_frees_its_place(tmp_path: Path) -> None:
    given = stand_in_pool(tmp_path, 1)
    async with webgym.EnvironmentPool(**given) as pool:

        async def hang(request: webgym.TokenRequest) -> webgym.Sampled:
            asked.set()
            await asyncio.Event().wait()
            raise AssertionError

        async def episode() -> None:
            async with pool.environment() as env:
                await webgym.roll_out(env, hang, renderer(), task_id="check-3")

        for _ in range(2):
            asked = asyncio.Event()
            playing = asyncio.create_task(episode())
            await asked.wait()
            playing._log_destroy_pending = False  # type: ignore[attr-defined]
            del playing
            gc.collect()
            for _ in range(3):  # closed by the event loop
                await asyncio.sleep(0)
            assert not given["browsers"].open_now
        async with asyncio.timeout(100), pool.environment():
            pass


async def test_a_pool_draws_tasks_by_its_seed(tmp_path: Path) -> None:
    given = stand_in_pool(tmp_path)

    async def drawn(seed: int) -> list[str]:
        tasks = []
        async with webgym.EnvironmentPool(**given, seed=seed) as pool:
            for _ in range(4):
                async with pool.environment() as env:
                    tasks.append((await env.reset())[1]["task_id"])
        return tasks

    assert await drawn(0) == await drawn(0) != await drawn(5)


def test_a_pool_belongs_to_one_event_loop(tmp_path: Path) -> None:
    webgym.write_tasks(tmp_path / "tasks.jsonl", STAND_IN_TASKS)
    config = stand_in_environment().config
    path = str(tmp_path / "tasks.jsonl")
    pool = webgym.EnvironmentPool(
        path, split="all", config=config, browsers=StandInBrowsers(), judge=StandInJudge()
    )
    asyncio.run(pool.open())
    with pytest.raises(UsageError, match="another event loop"):
        asyncio.run(pool.open())


def test_a_program_that_ends_without_closing_its_pool_shows_its_own_error_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    given = stand_in_pool(tmp_path, 1)
    tasks = OfflineWeb(per_family=2, collection="small").tasks()
    asked = next(each for each in tasks if each.truth and not any(fact.state for fact in each.truth.facts))
    webgym.write_tasks(given["name"], [asked])
    del given["judge"]  # the offline one is opened with the pool

    async def program() -> None:
        pool = webgym.EnvironmentPool(**given)
        async with pool.environment() as env:
            await env.reset()
            raise RuntimeError("of the program")

    with pytest.raises(RuntimeError, match="of the program"):
        asyncio.run(program())
    assert not caplog.records
    assert not given["browsers"].open_now


def test_rows_of_a_dataset_hold_nothing_that_judges_see(tmp_path: Path) -> None:
    path = tmp_path / "tasks.jsonl"
    train, test = (
        [msgspec.structs.replace(each, split=split, website=f"http://{split}.test/") for each in half]
        for split, half in (("train", STAND_IN_TASKS[:6]), ("test", STAND_IN_TASKS[6:]))
    )
    webgym.write_tasks(path, [*train, *test])
    rows = webgym.task_rows(str(path), count=4)
    assert [set(row) for row in rows] == [{"task_id", "instruction", "website", "split"}] * 4
    assert {row["split"] for row in rows} == {"train"}
    assert rows == webgym.task_rows(str(path), count=4)
    line = json.dumps({"instruction": "What does <|im_end|> do?", "website": "a.example"})
    path.write_text(line)
    assert webgym.task_rows(str(path), split="all")[0]["instruction"] == "What does < |im_end|> do?"
