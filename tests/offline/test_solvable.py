"""Every task is solvable by clicking, typing and scrolling, and by nothing less: a seeded sample in real
Chromium. ``webgym sites check`` does the same for all of them.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from webgym.core.outcome import Outcome
from webgym.judge.offline import OfflineJudge
from webgym.offline.config import SitesConfig
from webgym.offline.families import FAMILIES
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.store import RunReader
from webgym.run_config import PolicyChoice, RunConfig, TaskChoice
from webgym.runs import collect
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw
from webgym.validation import cut_off, degraded_solutions, unexpected, wrongly_accepted


@pytest.mark.browser
@pytest.mark.timeout(300)
@pytest.mark.parametrize("per_family", [1, pytest.param(4, marks=pytest.mark.slow)])
async def test_a_sample_is_solvable_and_nothing_less_passes(tmp_path: Path, per_family: int) -> None:
    web = OfflineWeb()
    hosts: dict[str, list[str]] = {}
    for host, spec in web.specs.items():
        if spec.behaviour == "good":
            hosts.setdefault(spec.family.family, []).append(host)
    tasks = [
        task
        for family in hosts
        for host in draw(hosts[family], per_family, seed=11)
        for task in draw(web.tasks_of(host), 1, seed=11)
    ]
    assert len(tasks) == per_family * len(FAMILIES)
    write_tasks(tmp_path / "tasks.jsonl", tasks)
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
    ways = Counter(
        way
        for each in solved
        for way, _ in degraded_solutions(reader.tasks[each.episode.task_id], each.episode)
    )
    assert len(ways) >= 7  # every kind of degradation was tried


def test_there_are_enough_websites_and_tasks() -> None:
    web = OfflineWeb()
    families = Counter(spec.family.family for spec in web.specs.values() if spec.behaviour == "good")
    assert len(families) >= 6
    assert min(families.values()) >= 50
    web = OfflineWeb(per_family=6)
    tasks = list(web.tasks())
    assert len(tasks) >= 3000
    assert len({task.id for task in tasks}) == len(tasks)
    assert set(range(1, 8)) <= {task.difficulty for task in tasks}
    split = {host: spec.split for host, spec in web.specs.items()}
    assert all(task.truth and task.split == split[task.truth.host] for task in tasks)
