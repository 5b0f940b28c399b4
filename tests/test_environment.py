"""The environment that others step: what it promises, what it refuses, and a real browser under it."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import pytest

import webgym
from webgym import Environment, SyncEnvironment
from webgym.agent.config import AgentConfig
from webgym.agent.solver import Solver
from webgym.core.action import Answer, Hover, Scroll, Target
from webgym.core.errors import (
    ConfigError,
    EpisodeLost,
    NoCapacity,
    ServerError,
    ServerUnreachable,
    SiteRefused,
    UsageError,
    WebGymError,
)
from webgym.core.trajectory import Reply
from webgym.offline.config import SitesConfig
from webgym.rollout.config import CollectorConfig
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.run.config import RunConfig, TaskChoice
from webgym.server.messages import View
from webgym.testing import check_environment, stand_in_environment, stand_in_pool
from webgym.testing import environments as conformance

SMALL = RunConfig(tasks=TaskChoice(count=6), agent=AgentConfig(mode="marks"))


async def test_the_environment_keeps_its_promises() -> None:
    assert await check_environment() == []


class Wraps:
    """What an adapter does that is right; those below break one rule each."""

    def __init__(self, env: Environment) -> None:
        self.env = env

    async def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        return await self.env.reset(seed=seed, options=options)

    async def step(self, action: Any) -> Any:
        return await self.env.step(action)

    async def close(self) -> None:
        await self.env.close()


class FaultIsZero(Wraps):
    async def step(self, action: Any) -> Any:
        view, reward, terminated, truncated, info = await self.env.step(action)
        return view, 0.0 if math.isnan(reward) else reward, terminated, truncated, info


class FaultIsFailure(Wraps):
    async def step(self, action: Any) -> Any:
        view, reward, terminated, truncated, info = await self.env.step(action)
        return view, reward, terminated, truncated, info | {"outcome": "failure"}


class RewardsEveryStep(Wraps):
    async def step(self, action: Any) -> Any:
        view, reward, terminated, truncated, info = await self.env.step(action)
        return view, reward + 0.1, terminated, truncated, info


class GivesTheRewardTwice(Wraps):
    last: Any = None

    async def step(self, action: Any) -> Any:
        try:
            self.last = await self.env.step(action)
        except UsageError:
            return self.last
        return self.last


class IgnoresSeeds(Wraps):
    turn = 0

    async def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        IgnoresSeeds.turn += 1
        return await self.env.reset(seed=None if options else IgnoresSeeds.turn, options=options)


class CannotBeCancelled(Wraps):
    async def step(self, action: Any) -> Any:
        return await asyncio.shield(self.env.step(action))


class KeepsWhatIsForgotten(Wraps):
    kept: ClassVar[list[Any]] = []

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        self.kept.append(env)


class OneForAll(Wraps):
    first: Environment | None = None

    def __init__(self, env: Environment) -> None:
        if OneForAll.first is None or OneForAll.first._services is None:
            OneForAll.first = env
        super().__init__(OneForAll.first)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (FaultIsZero, "a fault (judge) is told as Told(final=[0.0]"),
        (FaultIsFailure, "has the outcome failure"),
        (RewardsEveryStep, "a reward before the end"),
        (GivesTheRewardTwice, "a step after the end raises no error"),
        (IgnoresSeeds, "the same seed gives other tasks"),
        (CannotBeCancelled, "an episode that is cancelled keeps its browser"),
        (KeepsWhatIsForgotten, "an episode that is forgotten keeps its browser"),
        (OneForAll, "a step in one environment reaches another"),
    ],
)
async def test_an_adapter_that_breaks_a_rule_is_found(
    wrong: type[Wraps], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conformance, "_COLLECTED_SECONDS", 0.5)
    KeepsWhatIsForgotten.kept.clear()
    faults = await check_environment(wrong)
    assert any(told in fault for fault in faults), faults


async def test_what_is_used_wrongly_is_told() -> None:
    env = stand_in_environment()
    with pytest.raises(UsageError, match="not open"):
        await env.reset()
    async with env:
        with pytest.raises(UsageError, match="call reset first"):
            await env.step(Scroll("down"))
        with pytest.raises(ConfigError, match="did you mean check-1"):
            await env.reset(options={"task_id": "chek-1"})
        with pytest.raises(ConfigError, match="unknown option 'task'"):
            await env.reset(options={"task": "check-1"})
        await env.reset()
        with pytest.raises(UsageError, match="int is not an action"):
            await env.step(3)  # type: ignore[arg-type]
        *_, info = await env.step(Scroll("down"))
        assert info["step"] == 1, "a wrong call costs no episode"
    with pytest.raises(ConfigError, match="no tasks named 'online-v1'"):
        webgym.make("online-v1")
    with pytest.raises(ConfigError, match="did you mean offline-small-v2"):
        webgym.make("offline-smal-v1")
    with pytest.raises(ConfigError, match="a seed is an integer, not inf"):
        webgym.make("offline-v2", seed=float("inf"))
    with pytest.raises(ConfigError, match="there is no task"):
        await Environment([]).__aenter__()
    with pytest.raises(ConfigError, match="split is one of train, test, all, unsplit, not 'tran'"):
        webgym.make(split="tran")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="on_fault is nan or raise, not 'no'"):
        webgym.make(on_fault="no")
    for size in (0, -1):
        with pytest.raises(ConfigError, match=f"{size} browsers play no episode"):
            webgym.EnvironmentPool(size=size)
        with pytest.raises(ConfigError, match=f"{size} browsers play no episode"):
            await webgym.make_many(size).__aenter__()
        with pytest.raises(ConfigError, match=f"count is at least 1, or 'all', not {size}"):
            webgym.task_rows(count=size)


async def test_a_reply_is_read_by_the_parser_of_runs_and_kept_as_it_was() -> None:
    async with stand_in_environment() as env:
        _, info = await env.reset(options={"task_id": "check-3"})
        assert [message.role for message in info["messages"]] == ["system", "user"]
        assert len(info["images"]) == 1
        *_, info = await env.step("I would rather not.")
        assert info["parse_error"].startswith("no_tool_call")
        assert "holds no tool_call tag" in str(info["messages"]), "the next request says so"
        *_, info = await env.step(Hover(Target(coordinate=(1, 1))))
        assert info["parse_error"], "hover is no action of the paper's space"
        call = '{"name": "computer_use", "arguments": {"action": "answer", "text": "right"}}'
        given = Reply(f"<tool_call>{call}</tool_call>", "mine/7", weight_version="7")
        view, reward, terminated, _, info = await env.step(given)
        assert (reward, terminated, info["outcome"]) == (1.0, True, "success")
        steps = info["trajectory"].episode.steps
        assert steps[-1].reply is given
        assert [step.changed for step in steps] == [True, True, None]
        assert {step.observation.screenshot for step in steps} <= info["pictures"].keys()
        assert info["pictures"][view.observation.screenshot] == view.image


async def test_a_server_that_is_away_is_waited_for_and_costs_no_task(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    given = stand_in_pool(tmp_path)
    browsers, config = given["browsers"], given["config"]
    opens = browsers.open
    down: Iterator[WebGymError] = iter(())

    async def open_(options: Any = None) -> Any:
        for error in down:
            raise error
        return await opens(options)

    browsers.open = open_
    drawn: dict[int, list[str]] = {}
    for patience in (60, 0):
        waits = CollectorConfig(server_patience_seconds=patience, server_retry_seconds=0.01)
        env = Environment(
            given["name"],
            browsers=browsers,
            judge=given["judge"],
            config=config.model_copy(update={"collector": waits}),
        )
        async with env:
            drawn[patience] = []
            for count in (0, 2, 0, 1):
                down = iter([ServerUnreachable("nothing answers"), NoCapacity("no slot")][:count])
                for _ in range(0 if patience else count):
                    with pytest.raises(ServerError):
                        await env.reset()
                _, info = await env.reset()
                drawn[patience].append(info["task_id"])
                assert info["step"] == 0
        assert "waits for a browser: nothing answers" in caplog.text
    async with Environment(given["name"], browsers=browsers, judge=given["judge"], config=config) as env:
        assert drawn[60] == drawn[0] == [(await env.reset())[1]["task_id"] for _ in range(4)]


async def test_what_episodes_find_at_their_websites_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.rollout.driver.INSIST_SECONDS", 0)
    given = stand_in_pool(tmp_path)
    opens, status = given["browsers"].open, [200]

    async def open_(options: Any = None) -> Any:
        session = await opens(options)
        steps = session.step

        async def step(action: Any = None) -> Any:
            view = await steps(action)
            return View(msgspec.structs.replace(view.observation, status=status[0]), view.image)

        session.step = step
        return session

    given["browsers"].open = open_
    health = HealthConfig(file=tmp_path / "sites.jsonl")
    config = given["config"].model_copy(update={"health": health})
    async with Environment(
        given["name"], browsers=given["browsers"], judge=given["judge"], config=config
    ) as env:
        await env.reset()
        assert (await env.step(Answer("right")))[1] == 1
        status[0] = 403
        with pytest.raises(SiteRefused, match="twice"):
            await env.reset()
    [row] = SiteHealth(health).rows().values()
    assert (row.host, row.opened, row.refused) == ("check.test", 1, 1)


async def test_an_episode_without_a_reward_may_be_an_error() -> None:
    async with stand_in_environment(on_fault="raise") as env:
        await env.reset()
        env._judge.fault = "judge"  # type: ignore[union-attr]
        with pytest.raises(EpisodeLost, match="judge_error: the judge of the check gives no verdict"):
            await env.step(Answer("right"))
        await env.reset()


async def test_replies_without_an_action_spend_the_budget() -> None:
    async with stand_in_environment(on_fault="raise") as env:
        await env.reset()
        results = [await env.step("no") for _ in range(4)]
        assert [each[1:4] for each in results] == [(0.0, False, False)] * 3 + [(0.0, False, True)]
        assert results[-1][4]["outcome"] == "truncated"


async def test_a_second_step_at_the_same_time_is_refused_and_the_episode_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    step = conformance._Session.step

    async def waits(*given: Any) -> Any:
        await asyncio.sleep(0)
        return await step(*given)

    monkeypatch.setattr(conformance._Session, "step", waits)
    async with stand_in_environment() as env:
        await env.reset()
        calls = (env.step(Scroll("down")), env.step(Scroll("up")), env.finish())
        first, *others = await asyncio.gather(*calls, return_exceptions=True)
        assert [type(each) for each in others] == [UsageError] * 2
        assert not isinstance(first, BaseException)
        assert (first[4]["step"], first[4]["is_over"]) == (1, False)
        *_, info = await env.step(Scroll("up"))
        assert info["step"] == 2


async def test_a_step_of_an_old_episode_does_not_end_the_next_one() -> None:
    async with stand_in_environment() as env:
        browsers: Any = env._opened.client
        browsers.hangs = True
        await env.reset()
        old = asyncio.create_task(env.step(Scroll("down")))
        await browsers.entered.wait()
        browsers.hangs = False
        await env.reset()
        old.cancel()
        await asyncio.wait({old})
        *_, info = await env.step(Scroll("down"))
        assert info["step"] == 1


async def test_an_episode_that_another_call_abandoned_does_not_go_on_as_the_next_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    step, entered, may_end = conformance._Session.step, asyncio.Event(), asyncio.Event()

    async def waits(*given: Any) -> Any:
        if not entered.is_set():
            entered.set()
            await may_end.wait()
        return await step(*given)

    async with stand_in_environment() as env:
        browsers: Any = env._opened.client
        for first in (env.reset, lambda: env.step(Scroll("down"))):
            entered.clear()
            may_end.clear()
            with monkeypatch.context() as patch:
                patch.setattr(conformance._Session, "step", waits)
                old = asyncio.create_task(first())
                await entered.wait()
                await env.reset()
                may_end.set()
                with pytest.raises(UsageError, match="another call abandoned the episode"):
                    await old
            assert len(browsers.open_now) == 1
            *_, info = await env.step(Scroll("down"))
            assert info["step"] == 1


async def test_an_opening_that_was_interrupted_closes_nothing_of_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Ctrl-C in a notebook's `reset`, and the cell once more: the first still ends what it had begun."""
    closed, judges, openings = list[int](), itertools.count(1), itertools.count(1)
    entered, may_end = asyncio.Event(), asyncio.Event()

    @contextlib.asynccontextmanager
    async def judging(*_: Any) -> AsyncIterator[int]:
        number = next(judges)
        try:
            yield number
        finally:
            closed.append(number)

    @contextlib.asynccontextmanager
    async def starting(*_: Any) -> AsyncIterator[tuple[None, Any]]:
        if next(openings) == 1:
            entered.set()
            try:
                await asyncio.sleep(9)
            finally:
                await may_end.wait()
        yield None, conformance.StandInBrowsers()

    monkeypatch.setattr(webgym.env.environment, "refuse_unjudgeable", lambda *_: None)
    monkeypatch.setattr(webgym.env.environment, "open_judge", judging)
    monkeypatch.setattr(webgym.env.environment, "open_services", starting)
    env = Environment(conformance.STAND_IN_TASKS, config=stand_in_environment().config)
    first = asyncio.create_task(env.__aenter__())
    await entered.wait()
    first.cancel()
    async with env:
        may_end.set()
        await asyncio.wait({first})
        judge: Any = env._opened.judge
        assert (closed, judge) == ([1], 2)
    assert closed == [1, 2]


async def test_a_twin_uses_what_its_first_opened_as_long_as_that_is_open() -> None:
    async with stand_in_environment() as env:
        twin = env.twin(1).twin(2)
        for _ in range(2):  # closed, and opened again
            async with twin:
                await twin.reset()
                assert (await twin.step(Answer("right")))[1] == 1.0
            with pytest.raises(UsageError, match="not open"):
                await twin.reset()
        other = env.twin(3)
    for _ in range(2):
        with pytest.raises(UsageError, match="not open"):
            await other.reset()
        with pytest.raises(UsageError, match="not open"):
            await twin.__aenter__()


@pytest.mark.browser
async def test_a_group_at_one_task_has_a_browser_each() -> None:
    config = RunConfig(
        tasks=TaskChoice(count=1),
        sites=SitesConfig(collection="small", per_family=1, latency=0),
        collector=CollectorConfig(sessions=2),
    )
    async with Environment(config=config) as first, first.twin(1) as second, asyncio.timeout(100):
        (_, one), (_, other) = await first.reset(), await second.reset()
        assert one["task_id"] == other["task_id"]


async def test_an_episode_that_its_policy_leaves_is_judged_as_a_spent_budget() -> None:
    async with stand_in_environment() as env:
        for fault, reward, outcome in (("", 0.0, "truncated"), ("blocked", math.nan, "blocked")):
            for steps in range(2):
                env._opened.judge.fault = fault  # type: ignore[attr-defined]
                await env.reset()
                for _ in range(steps):
                    await env.step(Scroll("down"))
                _, told, terminated, truncated, info = await env.finish()
                assert told == pytest.approx(reward, nan_ok=True)
                assert (info["outcome"], info["step"]) == (outcome, steps)
                assert (terminated, truncated, info["is_over"]) == (False, True, True)
        with pytest.raises(UsageError, match="call reset first"):
            await env.finish()


def test_without_await_and_within_a_running_loop() -> None:
    with SyncEnvironment(stand_in_environment()) as env:
        env.reset(seed=1)

        async def notebook() -> float:
            return env.step(Answer("right"))[1]

        assert asyncio.run(notebook()) == 1.0
        with pytest.raises(UsageError, match="call reset first"):
            env.step(Scroll("down"))
    env.close()
    with pytest.raises(UsageError, match="closed"):
        env.reset()


def test_what_is_left_open_is_closed_before_python_ends() -> None:
    script = (
        "import asyncio, webgym\n"
        "async def closing():\n    print(await asyncio.to_thread(str, 'closed'))\n"
        "kept = webgym.LoopThread(closing)\n"
    )
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (answer.stdout, answer.stderr) == ("closed\n", "")


def test_closing_ends_the_calls_of_other_threads() -> None:
    with SyncEnvironment(stand_in_environment()) as env:
        env.reset()
        browsers = env._env._opened.client
        browsers.hangs = True  # type: ignore[attr-defined]
        with ThreadPoolExecutor(1) as pool:
            step = pool.submit(env.step, Scroll("down"))
            env._loop.run(browsers.entered.wait())  # type: ignore[attr-defined]
            env.close()
            with pytest.raises(UsageError, match="closed during the call"):
                step.result(5)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_ends_and_is_told_to_make_its_own() -> None:
    with SyncEnvironment(stand_in_environment()) as env:
        env.reset()
        child = os.fork()
        if child == 0:  # pragma: no cover
            code = 1
            with contextlib.suppress(BaseException):
                env.close()
                try:
                    env.reset()
                except UsageError as error:
                    code = 0 if "make another in each process" in error.hint else 2
            os._exit(code)
        for _ in range(500):
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                break
            time.sleep(0.01)
        else:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            pytest.fail("the child hangs")
        assert os.waitstatus_to_exitcode(status) == 0
        env.reset()


def test_a_name_replaces_the_task_file_of_a_config() -> None:
    config = RunConfig(tasks=TaskChoice(file=Path("tasks.jsonl")))
    assert webgym.make("offline-small-v2", config=config).config.tasks.file is None


def test_one_environment_starts_one_browser_unless_more_are_asked_for() -> None:
    assert webgym.make("offline-small-v2").config.collector.sessions == 1
    three = RunConfig(collector=CollectorConfig(sessions=3))
    assert webgym.make("offline-small-v2", config=three).config.collector.sessions == 3


@pytest.fixture(scope="module")
def real() -> Iterator[SyncEnvironment]:
    with SyncEnvironment(webgym.make("offline-small-v2", config=SMALL)) as env:
        yield env


@pytest.mark.browser
def test_solutions_are_rewarded_and_nothing_else_is(real: SyncEnvironment) -> None:
    for task_id, task in list(real.tasks.items())[:2]:
        assert task.truth is not None
        assert task.split == "train"
        for is_right in (True, False):
            view, info = real.reset(options={"task_id": task_id})
            assert "truth" not in str(info["messages"])
            solver, is_over, reward = Solver(task.website, task.truth.moves), False, math.nan
            while not is_over:
                action = solver.next(view.observation, "marks").action
                if isinstance(action, Answer) and not is_right:
                    action = Answer("something else")
                view, reward, terminated, truncated, info = real.step(action)
                is_over = terminated or truncated
            assert (reward, info["outcome"]) == ((1.0, "success") if is_right else (0.0, "failure"))
