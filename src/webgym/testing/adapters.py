"""Conformance checks for adapters that present an episode in a framework's own way: what the framework is
told of it is compared with the promises of an environment. They need no browser, unless the browsers are the
framework's."""

from __future__ import annotations

import asyncio
import gc
import tempfile
import time
from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias

import msgspec

from webgym.core.action import Action, Answer, Scroll
from webgym.run.config import RunConfig
from webgym.tasks.formats import write_tasks
from webgym.testing.environments import (
    BUDGET,
    FAULTS,
    STAND_IN_TASKS,
    StandInBrowsers,
    StandInJudge,
    stand_in_environment,
)


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
