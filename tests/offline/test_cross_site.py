"""Tasks on two websites: both are of one split, and nothing less than both solves them."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

import msgspec
import pytest

from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.judge.base import no_picture
from webgym.judge.offline import OfflineJudge
from webgym.offline.web import OfflineWeb
from webgym.store.runs import RunReader
from webgym.testing.solutions import check_in_browsers, typed

KINDS = {"compare", "difference", "carry"}


@pytest.fixture(scope="module")
def web() -> OfflineWeb:
    return OfflineWeb(collection="cross", per_family=3)


@pytest.fixture(scope="module")
def tasks(web: OfflineWeb) -> list[Task]:
    return list(web.tasks())


def kind_of(task: Task) -> str:
    return task.id.rpartition("/")[2].partition("-")[0]


def moves_of(task: Task) -> int:
    assert task.truth is not None
    return len(task.truth.moves)


def test_both_websites_are_of_the_task_s_split(web: OfflineWeb, tasks: list[Task]) -> None:
    assert {kind_of(task) for task in tasks} == KINDS
    assert {task.split for task in tasks} == {"train", "test"}
    for task in tasks:
        assert task.truth is not None
        assert len(task.truth.hosts) == 2
        assert {web.specs[host].split for host in task.truth.hosts} == {task.split}
        first = urlsplit(task.website).hostname
        assert first in task.truth.hosts
        (second,) = task.truth.hosts - {first}
        assert f"(http://{second}/)" in task.instruction  # nothing else leads there


def test_tasks_differ_and_reveal_nothing(web: OfflineWeb, tasks: list[Task]) -> None:
    assert len({task.id for task in tasks}) == len({task.instruction for task in tasks}) == len(tasks)
    assert list(typed(web, tasks)) == []
    for task in tasks:
        if kind_of(task) == "carry":  # what is to be found out stands in no instruction and in no fact
            assert task.truth is not None
            carried = task.truth.facts[0].evidence[0].texts[-1]
            said = [task.instruction, *(text for _, _, text in task.rubric.facts())]
            assert not any(carried in each for each in said)


def test_a_website_without_partners_has_no_such_tasks() -> None:
    alone = OfflineWeb(collection="cross", per_family=1)
    assert {kind_of(task) for task in alone.tasks()} <= {"carry"}


def without(host: str, episode: Episode) -> Episode:
    steps = tuple(step for step in episode.steps if urlsplit(step.observation.url).hostname != host)
    return msgspec.structs.replace(episode, steps=steps)


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_one_of_each_kind_is_solvable_and_nothing_less_passes(
    web: OfflineWeb, tasks: list[Task], tmp_path: Path
) -> None:
    by_kind = {kind: [task for task in tasks if kind_of(task) == kind] for kind in sorted(KINDS)}
    played = [min(of_kind, key=moves_of) for of_kind in by_kind.values()]
    assert await check_in_browsers(web, played, tmp_path / "run", sessions=2) == []
    recorded = RunReader(tmp_path / "run").trajectories()
    episodes = {trajectory.episode.task_id: trajectory.episode for trajectory in recorded}
    assert len(episodes) == len(played)
    for task in played:
        assert task.truth is not None
        for host in task.truth.hosts:
            verdict = await OfflineJudge().judge(task, without(host, episodes[task.id]), no_picture)
            assert verdict.reward == 0, host
