"""Conformance checks for environments and for wrappers of them. They take seconds and need no browser."""

from __future__ import annotations

import asyncio
import gc
import hashlib
import inspect
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from io import BytesIO
from typing import Any, Final

from PIL import Image

from webgym.core.action import Action, Answer, BrowserAction, Scroll
from webgym.core.errors import BrowserCrashed, JudgeError
from webgym.core.observation import Observation, Probed
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Judgement, Verdict
from webgym.env.environment import Environment, OnFault
from webgym.judge.base import Pictures
from webgym.rollout.config import AttemptConfig
from webgym.run.config import PolicyChoice, RunConfig
from webgym.server.messages import SessionOptions, View

_SIZE: Final = (64, 48)
BUDGET: Final = 4
_RIGHT: Final = "right"
FAULTS: Final = ("browser", "judge", "no_reward", "blocked")
"""What can keep an episode from a reward."""


class StandInBrowsers:
    """Replaces browsers in checks: every observation has a different picture, and sessions share no state.

    Attributes:
        open_now: numbers of the sessions that are not closed.
        steps: observations of every session but the first, by the session's number.
    """

    def __init__(self) -> None:
        self.open_now: set[int] = set()
        self.steps: dict[int, int] = {}
        self.fails = False
        self.hangs = False
        self.entered = asyncio.Event()

    async def open(self, options: SessionOptions | None = None) -> _Session:
        """Open a new session."""
        del options
        session = _Session(self, len(self.steps))
        self.open_now.add(session.number)
        self.steps[session.number] = -1  # the start page
        return session


class _Session:
    def __init__(self, browsers: StandInBrowsers, number: int) -> None:
        self._browsers, self.number = browsers, number
        self.id = str(number)

    async def step(self, action: BrowserAction | None = None) -> View:
        browsers = self._browsers
        if action is not None and browsers.fails and isinstance(action, Scroll):
            raise BrowserCrashed("the browser of the check crashed")
        if browsers.hangs and isinstance(action, Scroll):
            browsers.entered.set()
            await asyncio.Event().wait()
        browsers.steps[self.number] += 1
        count = browsers.steps[self.number]
        buffer = BytesIO()
        Image.new("RGB", _SIZE, (count * 40 % 256, 0, 0)).save(buffer, "PNG")
        name = hashlib.sha256(buffer.getvalue()).hexdigest()
        seen = Observation(name, f"http://check.test/{count}", f"page {count}", _SIZE, status=200)
        return View(seen, buffer.getvalue())

    async def probe(self, url: str) -> Probed:
        del url
        return Probed(status=200)

    async def close(self) -> None:
        self._browsers.open_now.discard(self.number)


class StandInJudge:
    """Rewards the answer ``right`` with 1 and everything else with 0, unless ``fault`` is set."""

    name = "check/1"

    def __init__(self) -> None:
        self.fault = ""

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge by the answer alone; the first picture is read, too, as a real judge would."""
        del task
        await pictures(episode.observations[0].screenshot)
        if self.fault == "judge":
            raise JudgeError("the judge of the check gives no verdict")
        reward = None if self.fault in ("no_reward", "blocked") else int(episode.answer == _RIGHT)
        return Verdict(self.name, reward, (), Judgement(self.fault == "blocked", "as the check wants it"))


STAND_IN_TASKS: Final = tuple(
    Task(f"check-{number}", f"Find number {number}", "http://check.test/", "Check", "Check", _rubric, "check")
    for _rubric in [Rubric((FactGroup(1, "all", ("it is found",)),))]
    for number in range(12)
)


def _environment(browsers: StandInBrowsers, judge: StandInJudge, on_fault: OnFault = "nan") -> Environment:
    attempt = AttemptConfig(viewport=_SIZE, budget_easy=BUDGET)
    config = RunConfig(attempt=attempt, policy=PolicyChoice(check=False))
    return Environment(STAND_IN_TASKS, browsers=browsers, judge=judge, config=config, on_fault=on_fault)


def stand_in_environment(on_fault: OnFault = "nan") -> Environment:
    """An environment without browsers and websites, for tests of wrappers: twelve tasks of at most four
    steps, pages of a single colour, and a judge that gives 1 for the answer ``right``."""
    return _environment(StandInBrowsers(), StandInJudge(), on_fault)


EnvironmentAdapter = Callable[[Environment], Any]
"""Wraps an open environment in the object to check. That has ``reset(seed=…, options=…)``, ``step(action)``
and, if it owns resources, ``close()``; each may be a coroutine function."""


class _Check:
    """The rules, one method each, and a line for every violation."""

    def __init__(self, adapt: EnvironmentAdapter) -> None:
        self._adapt = adapt
        self.faults: list[str] = []

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[tuple[Any, StandInBrowsers, StandInJudge]]:
        browsers, judge = StandInBrowsers(), StandInJudge()
        async with _environment(browsers, judge) as env:
            adapted = self._adapt(env)
            try:
                yield adapted, browsers, judge
            finally:
                await _close(adapted)

    def expect(self, holds: bool, rule: str) -> None:
        if not holds:
            self.faults.append(rule)

    async def rewards(self) -> None:
        """The reward comes once, at the end."""
        for answer, wanted in ((_RIGHT, 1.0), ("wrong", 0.0), (None, 0.0)):
            async with self._opened() as (env, _, _):
                await _call(env.reset, seed=1)
                last: Action | str = "I would click there." if answer is None else Answer(answer)
                actions: list[Action | str] = [*[Scroll("down")] * (BUDGET - 1), last]
                results = [await _call(env.step, action) for action in actions]
                rewards = [each[1] for each in results]
                self.expect(rewards[:-1] == [0.0] * (BUDGET - 1), f"a reward before the end: {rewards}")
                self.expect(rewards[-1] == wanted, f"the reward for the answer {answer!r} is {rewards[-1]}")
                ends = [(bool(each[2]), bool(each[3])) for each in results]
                self.expect(not any(map(any, ends[:-1])), "an episode is over before its end")
                rule = "an answer terminates an episode" if answer else "a budget that is spent truncates one"
                self.expect(ends[-1] == ((True, False) if answer else (False, True)), rule)
                self.expect(await _raises(env.step, Scroll("down")), "a step after the end raises no error")

    async def faults_are_no_rewards(self) -> None:
        """A fault never gives the reward 0."""
        for fault in FAULTS:
            async with self._opened() as (env, browsers, judge):
                await _call(env.reset, seed=1)
                judge.fault, browsers.fails = fault, fault == "browser"
                actions: list[Action] = [Scroll("down"), Answer(_RIGHT)]
                if fault in ("judge", "no_reward", "blocked"):
                    actions = [Answer(_RIGHT)]
                reward, terminated, truncated, info = 0.0, False, False, {}
                for action in actions:
                    _, reward, terminated, truncated, info = await _call(env.step, action)
                    if terminated or truncated:
                        break
                prefix = f"an episode without a reward ({fault})"
                self.expect(math.isnan(reward), f"{prefix} has the reward {reward}, not NaN")
                self.expect(not terminated and bool(truncated), f"{prefix} is not truncated")
                self.expect(
                    str(info.get("outcome")) not in ("success", "failure", "truncated", "None"),
                    f"{prefix} has the outcome {info.get('outcome')}",
                )

    async def seeds(self) -> None:
        """The same seed gives the same tasks."""
        orders = []
        for seed in (5, 5, 6):
            async with self._opened() as (env, _, _):
                first = (await _call(env.reset, seed=seed))[1]["task_id"]
                orders.append([first, *[(await _call(env.reset))[1]["task_id"] for _ in range(4)]])
        self.expect(orders[0] == orders[1], "the same seed gives other tasks")
        self.expect(orders[0] != orders[2], "another seed gives the same tasks")
        async with self._opened() as (env, _, _):
            chosen = (await _call(env.reset, options={"task_id": "check-7"}))[1]["task_id"]
            self.expect(chosen == "check-7", "options={'task_id': …} is ignored")

    async def sessions_are_given_back(self) -> None:
        """A browser session is closed however an episode ends."""
        async with self._opened() as (env, browsers, _):
            for _ in range(3):
                await _call(env.reset)
            self.expect(len(browsers.open_now) <= 1, "an episode that is abandoned keeps its browser")
            await _call(env.step, Answer(_RIGHT))
            self.expect(not browsers.open_now, "an episode that is over keeps its browser")
            await _call(env.reset)
            browsers.fails = True
            await _call(env.step, Scroll("down"))
            self.expect(not browsers.open_now, "an episode that failed keeps its browser")
            browsers.fails = False
            await _call(env.reset)
        self.expect(not browsers.open_now, "an environment that is closed keeps its browser")
        async with self._opened() as (env, browsers, _):
            if inspect.iscoroutinefunction(env.step):
                await _call(env.reset)
                browsers.hangs = True
                step = asyncio.create_task(env.step(Scroll("down")))
                await browsers.entered.wait()
                step.cancel()
                await asyncio.wait({step})
                self.expect(step.cancelled(), "a step that is cancelled goes on")
                self.expect(not browsers.open_now, "a step that is cancelled keeps its browser")
        await self._forgotten()

    async def _forgotten(self) -> None:
        browsers = StandInBrowsers()
        env = _environment(browsers, StandInJudge())
        await env.__aenter__()
        adapted = self._adapt(env)
        await _call(adapted.reset)
        del env, adapted
        for _ in range(3):
            gc.collect()
            await asyncio.sleep(0)
        self.expect(not browsers.open_now, "an environment that is forgotten keeps its browser")

    async def isolation(self) -> None:
        """Two environments never see each other's state."""
        async with (
            self._opened() as (first, first_browsers, _),
            self._opened() as (second, second_browsers, _),
        ):
            await _call(first.reset, seed=1)
            await _call(second.reset, seed=1)
            for _ in range(BUDGET - 1):
                info = (await _call(first.step, Scroll("down")))[4]
            second_steps = max(second_browsers.steps.values(), default=-1)
            first_steps = max(first_browsers.steps.values(), default=-1)
            steps = (first_steps, second_steps)
            self.expect(steps == (BUDGET - 1, 0), "a step in one environment reaches another")
            self.expect(info["step"] == BUDGET - 1, "an environment does not count its own steps")


async def check_environment(adapt: EnvironmentAdapter = lambda env: env) -> list[str]:
    """Check an environment or a wrapper of one: the reward comes once, at the end; faults never become
    rewards; seeds reproduce; browsers are closed after an end, a failure, a cancelled step, and when the
    environment is garbage-collected; two environments share no state. Browsers and judge are stand-ins.

    Args:
        adapt: wraps an :class:`~webgym.env.environment.Environment`; by default that itself is checked.

    Returns:
        A line for every violation; empty if there is none.
    """
    check = _Check(adapt)
    rules = (
        check.rewards,
        check.faults_are_no_rewards,
        check.seeds,
        check.sessions_are_given_back,
        check.isolation,
    )
    for rule in rules:
        try:
            await rule()
        except Exception as error:
            check.faults.append(f"{rule.__name__}: {type(error).__name__}: {error}")
    return list(dict.fromkeys(check.faults))


async def _call(function: Callable[..., Any], *given: Any, **named: Any) -> Any:
    if inspect.iscoroutinefunction(function):
        return await function(*given, **named)
    return await asyncio.to_thread(function, *given, **named)


async def _close(adapted: Any) -> None:
    if (close := getattr(adapted, "close", None)) is not None:
        await _call(close)


async def _raises(function: Callable[..., Any], *given: Any) -> bool:
    try:
        await _call(function, *given)
    except Exception:
        return True
    return False
