"""Conformance checks for adapters that present an episode in a framework's own way: what the framework is
told of it is compared with the promises of an environment. They need no browser."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from webgym.conformance import (
    BUDGET,
    FAULTS,
    STAND_IN_TASKS,
    StandInBrowsers,
    StandInJudge,
    stand_in_environment,
)
from webgym.core.action import Action, Answer, Scroll
from webgym.run_config import RunConfig
from webgym.tasks.formats import write_tasks


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

Adapt: TypeAlias = Callable[[dict[str, Any]], AbstractAsyncContextManager[Play]]
"""Opens an adapter on a pool of browsers, given the arguments of :class:`webgym.EnvironmentPool`."""

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


async def check_adapter(
    adapt: Adapt,
    *,
    rows: Rows | None = None,
    faults: Collection[str] = FAULTS,
    cancels: bool = True,
) -> list[str]:
    """Check an adapter for a trainer: an episode has one reward, at its end; a fault is never a reward;
    browsers are closed after an end, a failure and a cancelled episode; concurrent episodes share no state;
    the same seed gives the same tasks. Browsers and judge are stand-ins.

    Args:
        adapt: opens the adapter.
        rows: of its dataset, if it has one.
        faults: what can keep its episodes from a reward; by default everything.
        cancels: whether its framework can cancel an episode.

    Returns:
        A line for every violation; empty if there is none.
    """
    with tempfile.TemporaryDirectory(prefix="webgym-check-") as folder:
        return await _check(adapt, stand_in_pool(Path(folder), 16), rows, faults, cancels)


def _actions(*, answer: str, scrolls: int = 1) -> list[Action | str]:
    return [*[Scroll("down")] * scrolls, Answer(answer)]


async def _check(
    adapt: Adapt, given: dict[str, Any], rows: Rows | None, faults: Collection[str], cancels: bool
) -> list[str]:
    found: list[str] = []

    def expect(holds: bool, rule: str) -> None:
        if not holds:
            found.append(rule)

    browsers, judge = given["browsers"], given["judge"]
    async with adapt(given) as play:
        for actions, wanted in (
            (_actions(answer="right"), 1.0),
            (_actions(answer="wrong"), 0.0),
            ([Scroll("down")] * BUDGET, 0.0),
        ):
            told = await play("check-3", actions)
            expect(not any(told.early), f"a reward before the end: {told.early}")
            expect(set(told.final) == {wanted}, f"{actions[-1]} is told as {told.final}, not as {wanted}")
            expect(not browsers.open_now, "an episode that is over keeps its browser")
        for fault in faults:
            judge.fault, browsers.fails = fault, fault == "browser"
            replies = ["I would click there."] * BUDGET if fault == "unreadable" else _actions(answer="right")
            told = await play("check-3", replies)
            expect(not told.final and not any(told.early), f"a fault ({fault}) is told as {told}")
            expect(not browsers.open_now, f"an episode that failed ({fault}) keeps its browser")
        judge.fault, browsers.fails = "", False
        before = len(browsers.steps)
        both = await asyncio.gather(
            play("check-1", _actions(answer="right", scrolls=1)),
            play("check-2", _actions(answer="wrong", scrolls=3)),
        )
        expect([set(told.final) for told in both] == [{1.0}, {0.0}], f"two episodes are told as {both}")
        taken = sorted(steps for number, steps in browsers.steps.items() if number >= before)
        expect(taken == [1, 3], f"two episodes of one and three steps have taken {taken}")
        if cancels:
            browsers.hangs = True
            playing = asyncio.ensure_future(play("check-3", _actions(answer="right")))
            await browsers.entered.wait()
            playing.cancel()
            await asyncio.wait({playing})
            expect(playing.cancelled(), "an episode that is cancelled goes on")
            expect(not browsers.open_now, "an episode that is cancelled keeps its browser")
    expect(not browsers.open_now, "an adapter that is closed keeps its browsers")
    if rows is not None:
        drawn = [list(rows(given["name"], given["config"].model_copy(update={"seed": n}))) for n in (5, 5, 6)]
        expect(len(drawn[0]) > 1, "the dataset has no rows")
        expect(drawn[0] == drawn[1], "the same seed gives other tasks")
        expect(drawn[0] != drawn[2], "another seed gives the same tasks")
    return found
