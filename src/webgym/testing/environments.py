"""Conformance checks for environments and wrappers of them, and for adapters that present an episode in a
framework's own way: what that is told is compared with the promises of an environment.

They take seconds and need no browser, unless the browsers are the framework's.
"""

from __future__ import annotations

import asyncio
import gc
import hashlib
import inspect
import math
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias

import msgspec
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
from webgym.tasks.formats import write_tasks

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
    """The rules for environments, and a line for every violation."""

    def __init__(self, adapt: EnvironmentAdapter) -> None:
        self._adapt = adapt
        self.faults: list[str] = []

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[tuple[Any, StandInBrowsers]]:
        browsers = StandInBrowsers()
        async with _environment(browsers, StandInJudge()) as env:
            adapted = self._adapt(env)
            try:
                yield adapted, browsers
            finally:
                await _close(adapted)

    def expect(self, holds: bool, rule: str) -> None:
        if not holds:
            self.faults.append(rule)

    async def promises(self) -> None:
        """What every adapter promises (:func:`check_adapter`), and how an environment says it."""
        step = self._adapt(_environment(StandInBrowsers(), StandInJudge())).step
        self.faults += await check_adapter(self._adapted, cancels=inspect.iscoroutinefunction(step))

    @asynccontextmanager
    async def _adapted(self, given: dict[str, Any]) -> AsyncIterator[Adapted]:
        async def begin(task_id: str) -> Any:
            env = _environment(given["browsers"], given["judge"])
            await env.__aenter__()
            adapted = self._adapt(env)
            await _call(adapted.reset, options={"task_id": task_id})
            return adapted

        async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
            adapted, told = await begin(task_id), Told()
            try:
                await self._play(adapted, actions, told)
            except Exception as error:
                self.expect(False, f"an episode fails: {type(error).__name__}: {error}")
            await _close(adapted)
            return told

        yield Adapted(play, begin)

    async def _play(self, env: Any, actions: Sequence[Action | str], told: Told) -> None:
        for action in actions:
            _, reward, terminated, truncated, info = await _call(env.step, action)
            if not (terminated or truncated):
                told.early.append(reward)
                continue
            ended = (bool(terminated), bool(truncated))
            if math.isnan(reward):
                self.expect(ended == (False, True), "an episode without a reward is not truncated")
                is_named = str(info.get("outcome")) not in ("success", "failure", "truncated", "None")
                self.expect(is_named, f"an episode without a reward has the outcome {info.get('outcome')}")
            else:
                told.final.append(reward)
                self.expect(action is actions[-1], "an episode is over before its end")
                is_answered = isinstance(action, Answer)
                rule = "an answer terminates an episode" if is_answered else "a spent budget truncates one"
                self.expect(ended == (is_answered, not is_answered), rule)
            self.expect(await _raises(env.step, Scroll("down")), "a step after the end raises no error")
            return

    async def seeds(self) -> None:
        """The same seed gives the same tasks."""
        orders = []
        for seed in (5, 5, 6):
            async with self._opened() as (env, _):
                first = (await _call(env.reset, seed=seed))[1]["task_id"]
                orders.append([first, *[(await _call(env.reset))[1]["task_id"] for _ in range(4)]])
        self.expect(orders[0] == orders[1], "the same seed gives other tasks")
        self.expect(orders[0] != orders[2], "another seed gives the same tasks")
        async with self._opened() as (env, _):
            chosen = (await _call(env.reset, options={"task_id": "check-7"}))[1]["task_id"]
            self.expect(chosen == "check-7", "options={'task_id': …} is ignored")

    async def abandoned(self) -> None:
        """A browser session is closed when another episode begins, and with the environment."""
        async with self._opened() as (env, browsers):
            for _ in range(3):
                await _call(env.reset)
            self.expect(len(browsers.open_now) <= 1, "an episode that is abandoned keeps its browser")
        self.expect(not browsers.open_now, "an environment that is closed keeps its browser")

    async def isolation(self) -> None:
        """Two environments never see each other's state."""
        async with self._opened() as (first, browsers), self._opened() as (second, others):
            await _call(first.reset, seed=1)
            await _call(second.reset, seed=1)
            for _ in range(BUDGET - 1):
                info = (await _call(first.step, Scroll("down")))[4]
            steps = [max(each.steps.values(), default=-1) for each in (browsers, others)]
            self.expect(steps == [BUDGET - 1, 0], "a step in one environment reaches another")
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
    for rule in (check.promises, check.seeds, check.abandoned, check.isolation):
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


class Told(msgspec.Struct):
    """What a framework was told of an episode.

    Attributes:
        final: its rewards, one for each row, or a single one; empty if the framework was told that there is
            no reward, in whatever way it has for that.
        early: numbers that were given as rewards before the end.
    """

    final: list[float] = msgspec.field(default_factory=list)
    early: list[float] = msgspec.field(default_factory=list)


Play: TypeAlias = Callable[[str, Sequence[Action | str]], Awaitable[Told]]
"""Plays the task of an id with these actions, or model replies, and returns what the framework was told."""

Begin: TypeAlias = Callable[[str], Awaitable[object]]
"""Begins an episode of the task of an id, and returns all that the framework holds of it."""


class Adapted(msgspec.Struct):
    """An adapter that is open.

    Attributes:
        play: plays an episode.
        begin: begins an episode as the framework does, where it holds an object of each episode: the
            environment. ``None`` where an episode is a coroutine that the framework awaits.
    """

    play: Play
    begin: Begin | None = None


Adapt: TypeAlias = Callable[[dict[str, Any]], AbstractAsyncContextManager[Adapted]]
"""Opens an adapter on a pool of browsers, given the arguments of :class:`webgym.EnvironmentPool`, or what
another backend gives."""

_COLLECTED_SECONDS: Final = 10.0
"""Longest time from the last reference to an episode to its browser's end."""

Rows: TypeAlias = Callable[[str, RunConfig], Sequence[str]]
"""Ids of the tasks in the adapter's dataset, for a name of tasks and the settings they are drawn with."""


def stand_in_pool(folder: Path, size: int = 4, *, fails: bool = False, fault: str = "") -> dict[str, Any]:
    """Arguments of a :class:`webgym.EnvironmentPool` of stand-ins, as in
    :func:`~webgym.testing.stand_in_environment`.

    Args:
        folder: an empty folder for the task file.
        size: number of browsers.
        fails: whether browsers crash at the first scroll.
        fault: what keeps the judge from a reward: ``judge``, ``no_reward`` or ``blocked``; empty for nothing.
    """
    write_tasks(folder / "tasks.jsonl", STAND_IN_TASKS)
    browsers, judge = StandInBrowsers(), StandInJudge()
    browsers.fails, judge.fault = fails, fault
    return {
        "name": str(folder / "tasks.jsonl"),
        "size": size,
        "split": "all",
        "config": stand_in_environment().config,
        "browsers": browsers,
        "judge": judge,
    }


class CheckBackend(Protocol):
    """Browsers, tasks and judge of a check. Write one for an adapter whose browsers are its framework's.

    Attributes:
        given: what the adapter is opened with; its ``name`` and ``config`` are given to ``rows``, too.
    """

    given: dict[str, Any]

    def prepare(self, case: str) -> tuple[str, Sequence[Action | str]]:
        """Prepare an episode, and undo what an earlier one of a fault needed.

        Args:
            case: ``right``: the last action is an answer with the reward 1. ``wrong``: an answer with the
                reward 0. ``spent``: no answer, and the budget is spent, for the reward 0. ``cancelled``: it
                hangs in a step. Each of ``FAULTS``: it would be right, but meets that fault.
                ``right`` and ``wrong`` are also played concurrently, and one that is to be forgotten is begun
                as ``cancelled``, or as ``right`` where the adapter has a ``begin``.

        Returns:
            Id of its task, and the actions to play.
        """

    def open_browsers(self) -> int:
        """Number of browsers that are not closed."""

    def steps(self) -> list[int]:
        """For each episode so far, the number of actions, without the answer, that a browser carried out."""

    async def hangs(self) -> None:
        """Wait until a ``cancelled`` episode hangs; not called if there is none."""


class _StandIns:
    """Stand-ins for WebGym's browsers, on which everything can go wrong."""

    def __init__(self, folder: Path) -> None:
        self.given = stand_in_pool(folder, 16)
        self._browsers: StandInBrowsers = self.given["browsers"]
        self._judge: StandInJudge = self.given["judge"]

    def prepare(self, case: str) -> tuple[str, Sequence[Action | str]]:
        self._judge.fault = case if case in FAULTS else ""
        self._browsers.fails, self._browsers.hangs = case == "browser", case == "cancelled"
        self._browsers.entered.clear()
        if case == "wrong":
            return "check-2", [*[Scroll("down")] * 3, Answer("wrong")]
        if case == "spent":
            return "check-3", [Scroll("down")] * BUDGET
        return "check-1", [Scroll("down"), Answer("right")]

    def open_browsers(self) -> int:
        return len(self._browsers.open_now)

    def steps(self) -> list[int]:
        return list(self._browsers.steps.values())

    async def hangs(self) -> None:
        await self._browsers.entered.wait()


async def check_adapter(
    adapt: Adapt,
    *,
    backend: CheckBackend | None = None,
    rows: Rows | None = None,
    faults: Collection[str] = FAULTS,
    cancels: bool = True,
    forgets: bool = True,
) -> list[str]:
    """Check an adapter for a trainer: an episode has one reward, at its end; a fault is never a reward;
    browsers are closed after an end, a failure and a cancelled episode, and when all that the framework
    holds of an episode is garbage-collected; concurrent episodes share no state; the same seed gives the same
    tasks.

    Args:
        adapt: opens the adapter.
        backend: what the episodes are played on; by default stand-ins for WebGym's browsers and judge.
        rows: of its dataset, if it has one.
        faults: what can keep its episodes from a reward; by default everything.
        cancels: whether its framework can cancel an episode.
        forgets: whether an episode that its framework has dropped can be garbage-collected.

    Returns:
        A line for every violation; empty if there is none.
    """
    if backend is not None:
        return await _check(adapt, backend, rows, faults, cancels, forgets)
    with tempfile.TemporaryDirectory(prefix="webgym-check-") as folder:
        return await _check(adapt, _StandIns(Path(folder)), rows, faults, cancels, forgets)


async def _check(
    adapt: Adapt,
    backend: CheckBackend,
    rows: Rows | None,
    faults: Collection[str],
    cancels: bool,
    forgets: bool,
) -> list[str]:
    found: list[str] = []

    def expect(holds: bool, rule: str) -> None:
        if not holds:
            found.append(rule)

    async with adapt(backend.given) as adapted:
        play = adapted.play
        for case, wanted in (("right", 1.0), ("wrong", 0.0), ("spent", 0.0)):
            task_id, actions = backend.prepare(case)
            told = await play(task_id, actions)
            expect(not any(told.early), f"a reward before the end: {told.early}")
            expect(set(told.final) == {wanted}, f"{actions[-1]} is told as {told.final}, not as {wanted}")
            expect(not backend.open_browsers(), "an episode that is over keeps its browser")
        for fault in faults:
            told = await play(*backend.prepare(fault))
            expect(not told.final and not any(told.early), f"a fault ({fault}) is told as {told}")
            expect(not backend.open_browsers(), f"an episode that failed ({fault}) keeps its browser")
        before = len(backend.steps())
        cases = [backend.prepare("right"), backend.prepare("wrong")]
        both = await asyncio.gather(*(play(*case) for case in cases))
        expect([set(told.final) for told in both] == [{1.0}, {0.0}], f"two episodes are told as {both}")
        played = sorted(len(actions) - 1 for _, actions in cases)
        steps = sorted(backend.steps()[before:])
        expect(steps == played, f"two episodes of {played} steps have taken {steps}")
        if cancels:
            playing = asyncio.ensure_future(play(*backend.prepare("cancelled")))
            await backend.hangs()
            playing.cancel()
            await asyncio.wait({playing})
            expect(playing.cancelled(), "an episode that is cancelled goes on")
            expect(not backend.open_browsers(), "an episode that is cancelled keeps its browser")
        if forgets:
            held = [await _begun(adapted, backend)]
            expect(backend.open_browsers() > 0, "an episode that has begun has no browser")
            await _forget(held, backend)
            expect(not backend.open_browsers(), "an episode that is forgotten keeps its browser")
    expect(not backend.open_browsers(), "an adapter that is closed keeps its browsers")
    if rows is not None:
        name, config = backend.given["name"], backend.given["config"]
        drawn = [list(rows(name, config.model_copy(update={"seed": seed}))) for seed in (5, 5, 6)]
        expect(len(drawn[0]) > 1, "the dataset has no rows")
        expect(drawn[0] == drawn[1], "the same seed gives other tasks")
        expect(drawn[0] != drawn[2], "another seed gives the same tasks")
    return found


async def _begun(adapted: Adapted, backend: CheckBackend) -> object:
    """What a framework holds of an episode that is not over."""
    if adapted.begin is not None:
        return await adapted.begin(backend.prepare("right")[0])
    playing = asyncio.ensure_future(adapted.play(*backend.prepare("cancelled")))
    await backend.hangs()
    return playing


async def _forget(held: list[object], backend: CheckBackend) -> None:
    """Drop it, and wait until its browser is closed, but not for ever."""
    loop = asyncio.get_running_loop()
    handler = loop.get_exception_handler()
    loop.set_exception_handler(lambda *_: None)  # asyncio's: a pending task was destroyed, as it should be
    try:
        held.clear()
        until = time.monotonic() + _COLLECTED_SECONDS
        while backend.open_browsers() and time.monotonic() < until:
            gc.collect()
            await asyncio.sleep(0.01)
    finally:
        loop.set_exception_handler(handler)
