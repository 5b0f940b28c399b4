"""The promises of :func:`webgym.testing.check_environment`, for adapters that are no such environment: what a
trainer is told of an episode is looked at, whatever it calls it."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from tests.integrations.engine import stand_in_pool

import webgym.testing
from webgym import Action, Answer, RunConfig, Scroll
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.run_config import TaskChoice

BUDGET: Final = 4
FAULTS: Final = ("browser", "judge", "no_reward", "blocked", "unreadable")


@dataclass
class Told:
    """What a framework was told of an episode.

    Attributes:
        final: its rewards, one for each row, or one; none if the framework has its word for *no reward*.
        early: numbers that were given as rewards before the end.
    """

    final: list[float] = field(default_factory=list)
    early: list[float] = field(default_factory=list)


Play = Callable[[str, Sequence[Action | str]], Awaitable[Told]]
"""Plays the task of an id, with these actions, or replies."""

Adapt = Callable[[dict[str, Any]], AbstractAsyncContextManager[Play]]
"""Opens an adapter on a pool, of these arguments of :class:`webgym.EnvironmentPool`."""

Rows = Callable[[str, RunConfig], Sequence[str]]
"""Task ids of the adapter's dataset, of tasks by this name, drawn with these settings."""


def _actions(*, answer: str, scrolls: int = 1) -> list[Action | str]:
    return [*[Scroll("down")] * scrolls, Answer(answer)]


async def check_adapter(
    adapt: Adapt,
    folder: Path,
    *,
    rows: Rows | None = None,
    faults: Collection[str] = FAULTS,
    cancels: bool = True,
) -> list[str]:
    """A line for every promise that an adapter breaks.

    Args:
        adapt: opens it.
        folder: an empty one.
        rows: of its dataset, where it has one.
        faults: what can keep its episodes from a reward.
        cancels: whether its framework can cancel an episode.
    """
    found: list[str] = []

    def expect(holds: bool, rule: str) -> None:
        if not holds:
            found.append(rule)

    given = stand_in_pool(folder, 16)
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


def in_browsers() -> tuple[dict[str, Any], list[tuple[str, Sequence[Action | str]]]]:
    """Arguments of a pool of two real browsers on the small websites; and two of their tasks, each with what
    solves it."""
    config = RunConfig(sites=SitesConfig(collection="small", per_family=1), tasks=TaskChoice(count="all"))
    web = OfflineWeb(config.sites.seed, per_family=1, collection="small")
    solved: list[tuple[str, Sequence[Action | str]]] = []
    easy = (task for task in web.tasks() if task.split == "train" and task.difficulty == 1)
    for task in itertools.islice(easy, 2):
        site = web.website(urlsplit(task.website).hostname or "")
        assert site is not None
        steps = webgym.testing.play(site, task, web.collection.viewport).steps
        solved.append((task.id, [step.action for step in steps if step.action is not None]))
    return {"name": "offline-small-v1", "size": 2, "split": "train", "config": config}, solved


async def check_in_browsers(adapt: Adapt) -> list[Told]:
    """Play two tasks in real browsers at the same time, one as it is solved, and one with a wrong answer.

    Args:
        adapt: opens the adapter.

    Returns:
        What was told of them: 1 and 0, if all is well.
    """
    given, [(first, right), (second, _)] = in_browsers()
    async with adapt(given) as play:
        both = play(first, right), play(second, [Scroll("down"), Answer("no idea")])
        return list(await asyncio.gather(*both))
