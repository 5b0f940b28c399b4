"""Every task is solvable by clicking, typing and scrolling, and by nothing less: a seeded sample in real
Chromium. ``webgym sites check`` does the same for all of them.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.truth import Fill, Home, See
from webgym.judge.offline import OfflineJudge
from webgym.offline.config import SitesConfig
from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.families import FAMILIES
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.run.collect import collect
from webgym.run.config import PolicyChoice, RunConfig, TaskChoice
from webgym.store.runs import RunReader
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw
from webgym.testing.solutions import (
    check_in_browsers,
    cut_off,
    degraded_solutions,
    unexpected,
    wrongly_accepted,
)


def sample(web: OfflineWeb, per_family: int, most_moves: int) -> list[Task]:
    """One task each of so many websites of every family."""
    hosts: dict[str, list[str]] = {}
    for host, spec in web.specs.items():
        if spec.behaviour == "good":
            hosts.setdefault(spec.family.family, []).append(host)
    assert len(hosts) == len(FAMILIES)
    return [
        task
        for family in hosts
        for host in draw(hosts[family], per_family, seed=11)
        for task in draw([task for task in web.tasks_of(host) if moves_of(task) <= most_moves], 1, seed=11)
    ]


def moves_of(task: Task) -> int:
    assert task.truth is not None
    return len(task.truth.moves)


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_a_sample_is_solvable_and_nothing_less_passes(tmp_path: Path) -> None:
    """As ``webgym sites check`` plays them all."""
    web = OfflineWeb()
    tasks = sample(web, 1, most_moves=8)
    assert await check_in_browsers(web, tasks, tmp_path / "run", sessions=2) == []
    reader = RunReader(tmp_path / "run")
    episodes = [trajectory.episode for trajectory in reader.trajectories()]
    tried = {kind for each in episodes for kind, _ in degraded_solutions(reader.tasks[each.task_id], each)}
    assert len(tried) >= 7  # every kind of degradation was tried


@pytest.mark.browser
async def test_a_sticky_header_and_words_of_a_table_do_not_keep_from_a_solution(tmp_path: Path) -> None:
    """Headers covered half of every card after a scroll, and "Processing time" was waited for."""
    web = OfflineWeb()
    known = {"summercrest-airways/extreme-1", "thistlemark-borough/save-0"}
    hosts = [f"{each.partition('/')[0]}.webgym.test" for each in known]
    tasks = [each for host in hosts for each in web.tasks_of(host) if each.id.partition("/")[2] in known]
    assert len(tasks) == len(known)
    assert await check_in_browsers(web, tasks, tmp_path / "run", sessions=2) == []


def read_in_the_list(site: SpecifiedWebsite, task: Task) -> Task:
    """The task with a solution that opens no item and puts nothing in order."""
    assert task.truth is not None
    texts = dict.fromkeys(text for fact in task.truth.facts for text in fact.evidence[1].texts)
    *moves, given = task.truth.moves
    is_search = any(isinstance(move, Fill) for move in moves)
    kept = [
        move
        for move in moves
        if isinstance(move, Home | Fill)
        or (not is_search and not isinstance(move, See) and getattr(move, "field", "") != site.says["sort"])
    ]
    moves = [*kept, See(tuple(texts)), given]
    return msgspec.structs.replace(task, truth=msgspec.structs.replace(task.truth, moves=tuple(moves)))


@pytest.mark.browser
@pytest.mark.timeout(180)
async def test_what_the_list_shows_needs_no_opened_item_and_no_order(tmp_path: Path) -> None:
    web, tasks = OfflineWeb(), dict[tuple[str, str], Task]()
    for host in list(web.specs)[::5]:
        if len(tasks) == 6:  # each kind of task on each kind of list
            break
        site = web.website(host)
        assert isinstance(site, SpecifiedWebsite)
        for task in web.tasks_of(host):
            kind, truth = task.id.split("/")[2].partition("-")[0], task.truth
            assert truth is not None
            if kind in ("facts", "extreme") and truth.expects == "success":
                views = [fact.evidence[1:] for fact in truth.facts]
                if all(views) and (kind == "facts" or [len(views), len(views[0][0].texts) < 5] == [1, True]):
                    tasks.setdefault((kind, site.look.listing), read_in_the_list(site, task))
    assert len(tasks) == 6
    assert await check_in_browsers(web, list(tasks.values()), tmp_path / "run", sessions=2) == []


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.timeout(900)
async def test_a_sample_is_solvable_for_an_agent(tmp_path: Path) -> None:
    """With all that an agent has: pictures, prompts, a server in between, the record of a run."""
    write_tasks(tmp_path / "tasks.jsonl", sample(OfflineWeb(), 4, most_moves=100))
    config = RunConfig(
        tasks=TaskChoice(file=tmp_path / "tasks.jsonl", split="all"),
        policy=PolicyChoice(name="scripted"),
        attempt=AttemptConfig(record_cuts=True),
        sites=SitesConfig(latency=0),
        collector=CollectorConfig(sessions=2, straggler_share=1.0),
    )
    await collect(config, tmp_path / "run")
    reader = RunReader(tmp_path / "run")
    solved = [each for each in reader.trajectories() if each.outcome is not Outcome.ENVIRONMENT_ERROR]
    assert list(unexpected(reader.tasks, solved)) == []
    assert list(cut_off(reader.tasks, solved)) == []
    assert [line async for line in wrongly_accepted(reader.tasks, solved, OfflineJudge())] == []
