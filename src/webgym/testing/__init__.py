"""Checks for your own websites and environments.

:func:`check_family` follows the solutions of a website family's tasks and judges the results: the solution
must pass; a wrong answer, an answer without evidence, a premature answer and an empty trajectory must not.
Small websites are played without a browser, others in Chromium.
:func:`check_environment` plays a few episodes on stand-ins: faults must not become rewards, and every browser
must be closed. :func:`check_adapter` does the same for an adapter that is no environment.
"""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from rich.console import Console

from webgym.agent.solver import Solver
from webgym.core.action import Answer
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import StepBudget, Task
from webgym.core.trajectory import Episode, Reply, Step
from webgym.judge.base import no_picture
from webgym.judge.offline import OfflineJudge
from webgym.offline.small.site import SmallWebsite
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Website
from webgym.rollout.judging import judge_episode
from webgym.rollout.live import showing
from webgym.study.static_pages import StaticBrowser
from webgym.testing.environments import (
    FAULTS,
    Adapt,
    Adapted,
    Begin,
    CheckBackend,
    Play,
    Rows,
    Told,
    check_adapter,
    check_environment,
    stand_in_environment,
    stand_in_pool,
)
from webgym.testing.solutions import check_in_browsers, faults_of

__all__ = [
    "FAULTS",
    "Adapt",
    "Adapted",
    "Begin",
    "CheckBackend",
    "Play",
    "Rows",
    "Told",
    "check_adapter",
    "check_environment",
    "check_family",
    "check_tasks",
    "play",
    "stand_in_environment",
    "stand_in_pool",
]


_JUDGE_SECONDS: Final = 300.0


def play(site: Website, task: Task, viewport: tuple[int, int]) -> Episode:
    """Play a task's solution on a website without a browser.

    Returns:
        The episode as a collector would record it, except for messages, replies and times.
    """
    assert task.truth is not None
    browser, solver = StaticBrowser(site, viewport), Solver(task.website, task.truth.moves)
    steps: list[Step] = []
    answer = final = None
    for index in range(StepBudget().for_task(task)):
        observation = browser.observe()
        act = solver.next(observation, "coordinates")
        step = Step(index, observation, (), Reply(act.description, "scripted"), action=act.action)
        if isinstance(act.action, Answer):
            answer = act.action.text
        else:
            browser.act(act.action)
            final = browser.observe()
            step = step.followed_by(final)
        steps.append(step)
        if answer is not None:
            break
    return Episode(
        attempt_id=f"{task.id}#0.0",
        task_id=task.id,
        sample=0,
        retry=0,
        seed=0,
        policy="scripted",
        started_at=0.0,
        seconds=0.0,
        steps=tuple(steps),
        ending=Ending.BUDGET_SPENT if answer is None else Ending.ANSWERED,
        final=final if answer is None else None,
        answer=answer,
        final_state=site.report(browser.states[site.host]),
    )


async def check_tasks(site: Website, tasks: Iterable[Task], viewport: tuple[int, int]) -> list[str]:
    """A line for every task whose solution fails, or for which a degraded solution passes."""
    judge, faults = OfflineJudge(), list[str]()
    for task in tasks:
        episode = play(site, task, viewport)
        trajectory = (await judge_episode(judge, task, episode, no_picture, _JUDGE_SECONDS)).of(episode)
        found = await faults_of(task, trajectory, judge)
        if trajectory.outcome is Outcome.SUCCESS:
            found += [f"{task.id}: {line}" for line in _weaknesses(task, episode)]
        faults += found
    return faults


def _weaknesses(task: Task, episode: Episode) -> Iterator[str]:
    """A line for every weakness of a solution that passes."""
    dead = [step.index + 1 for step in episode.steps if step.changed is False]
    if dead:
        yield f"step {dead[0]} of the solution changes nothing"
    assert task.truth is not None
    for truth in task.truth.facts:
        if not (truth.evidence or truth.state):
            yield f"fact {truth.group}.{truth.index} cannot be confirmed"


async def check_family(
    family: type[Website], *, seed: int = 7, websites: int = 2, tasks_per_website: int | None = None
) -> list[str]:
    """Check some websites of a family: ids and instructions are unique, and every task is solvable only by
    its solution. In a terminal, the progress is shown meanwhile.

    Args:
        family: small websites (:class:`webgym.offline.small.site.SmallWebsite`) are played without a
            browser, all others in Chromium.
        seed: of the websites.
        websites: number of websites of each of the splits ``train`` and ``test``.
        tasks_per_website: about this many tasks of each website, evenly spread; by default all.

    Returns:
        A line for every fault; empty if there is none.

    Raises:
        ValueError: nothing would be checked.
    """
    if websites < 1 or (tasks_per_website is not None and tasks_per_website < 1):
        raise ValueError("at least one website and one task of each are to be checked")
    is_small = issubclass(family, SmallWebsite)
    web = OfflineWeb(seed, collection="small" if is_small else "large", families=(family,))
    faults: list[str] = []
    played: list[Task] = []
    for split in ("train", "test"):
        hosts = [
            host for host, spec in web.specs.items() if spec.split == split and spec.behaviour == "good"
        ][:websites]
        for host in hosts:
            site = web.website(host)
            assert site is not None
            tasks = list(web.tasks_of(host))
            if not is_small:
                faults += _repeated(host, tasks)
            step = max(1, len(tasks) // tasks_per_website) if tasks_per_website is not None else 1
            if is_small:
                faults += await check_tasks(site, tasks[::step], web.collection.viewport)
            played += tasks[::step]
    if is_small:
        return faults
    console = Console(stderr=True)
    with tempfile.TemporaryDirectory(prefix="webgym-check-") as scratch:
        return faults + await check_in_browsers(
            web,
            played,
            Path(scratch) / "run",
            sessions=os.cpu_count() or 2,
            show=partial(showing, console=console) if console.is_terminal else None,
        )


def _repeated(host: str, tasks: Sequence[Task]) -> Iterator[str]:
    for what, values in (
        ("id", [task.id for task in tasks]),
        ("instruction", [t.instruction for t in tasks]),
    ):
        for value, times in Counter(values).items():
            if times > 1:
                yield f"{host}: {times} tasks have the {what} {value!r}"
