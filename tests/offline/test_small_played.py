"""Small websites in real Chromium, at their own size: what is played without a browser is what happens."""

from __future__ import annotations

from pathlib import Path

import pytest

from webgym.core.action import Answer
from webgym.judge.offline import OfflineJudge
from webgym.offline.config import SitesConfig
from webgym.offline.small import FAMILIES
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import CollectorConfig
from webgym.run.collect import collect
from webgym.run.config import PolicyChoice, RunConfig, TaskChoice
from webgym.store.runs import RunReader
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw
from webgym.testing import play
from webgym.testing.solutions import unexpected, wrongly_accepted


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_a_sample_is_played_as_without_a_browser(tmp_path: Path) -> None:
    web = OfflineWeb(collection="small")
    tasks = []
    for family in FAMILIES:
        hosts = [host for host, spec in web.specs.items() if spec.family is family]
        for host in draw(hosts, 1, seed=3):
            tasks += draw([task for task in web.tasks_of(host) if task.difficulty <= 4], 1, seed=3)
    write_tasks(tmp_path / "tasks.jsonl", tasks)
    config = RunConfig(
        tasks=TaskChoice(file=tmp_path / "tasks.jsonl"),
        policy=PolicyChoice(name="scripted"),
        sites=SitesConfig(collection="small", latency=0),
        collector=CollectorConfig(sessions=2, straggler_share=1.0),
    )
    await collect(config, tmp_path / "run")
    reader = RunReader(tmp_path / "run")
    played = list(reader.trajectories())
    assert len(played) == len(tasks) == len(FAMILIES)
    assert list(unexpected(reader.tasks, played)) == []
    assert [line async for line in wrongly_accepted(reader.tasks, played, OfflineJudge())] == []
    for trajectory in played:
        task = reader.tasks[trajectory.episode.task_id]
        assert task.truth is not None
        site = web.website(task.truth.host)
        assert site is not None
        alike = play(site, task, web.collection.viewport)
        for seen, dry in zip(trajectory.episode.steps, alike.steps, strict=True):
            assert seen.observation.viewport == (192, 128)
            assert seen.observation.scroll[1] <= 128
            assert seen.observation.url == dry.observation.url
            assert sorted((seen.observation.text or "").split()) == sorted(
                (dry.observation.text or "").split()
            )
            names = [{each.name for each in step.observation.elements or ()} for step in (seen, dry)]
            assert names[0] == names[1] or not names[0]
            assert isinstance(seen.action, Answer) == isinstance(dry.action, Answer)
