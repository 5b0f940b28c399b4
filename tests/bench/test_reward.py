"""Hacks of the reward do not pay: each of them once, through the real collector, by both judges."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from benchmarks.reward.__main__ import command
from benchmarks.reward.hacks import HACKS, HackingPolicy, candidates, right_answer
from benchmarks.reward.measure import Hacked, challenge_of, choose, table
from tests.bench.conftest import Benchmark
from tests.documented import documented
from tests.judge.judge_model import Asked, serve_judge
from tests.judge.test_both_judges import Reader

from webgym.core.outcome import Outcome
from webgym.core.tables import markdown
from webgym.judge.config import JudgeChoice
from webgym.judge.factory import open_judge
from webgym.judge.offline import compare
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.rejudge import judge_run
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.run.collect import collect
from webgym.run.config import RunConfig, TaskChoice
from webgym.store.runs import RunReader, verdicts_of
from webgym.tasks.formats import write_tasks

SITES = SitesConfig(per_family=3, latency=0)


class Strict(Reader):
    """A judge model that reads, and that knows of the answer, too, whether it makes the one right claim."""

    def __call__(self, asked: Asked) -> str:
        if asked.stage != "reference":
            return super().__call__(asked)
        task = self.tasks[asked.quotes["task"]]
        assert task.truth is not None
        _, value = compare(task.truth.answer, asked.quotes["answer"])
        return asked.verdict(bool(value and value.passed))


@pytest.mark.browser
async def test_no_hack_gains_with_either_judge(tmp_path: Path) -> None:
    web = OfflineWeb(SITES.seed, per_family=SITES.per_family)
    tasks, _ = choose(web, 300, 0, 1)
    chosen = sorted(tasks, key=lambda task: len(task.truth.moves) if task.truth else 0)[: len(HACKS)]
    ways = {task.id: way for task, way in zip(chosen, HACKS, strict=True)}
    write_tasks(tmp_path / "tasks.jsonl", chosen)
    kept = HealthConfig(file=tmp_path / "sites.jsonl")
    config = RunConfig(
        sites=SITES,
        tasks=TaskChoice(file=tmp_path / "tasks.jsonl", split="all"),
        attempt=AttemptConfig(budget_easy=10),
        collector=CollectorConfig(sessions=2),
        health=kept,
    )
    policy = HackingPolicy(lambda task: ways[task.id], challenge_of(web))
    await collect(config, tmp_path / "run", policy=policy)

    reader = RunReader(tmp_path / "run")
    texts = {}
    for trajectory in reader.trajectories():
        way = ways[trajectory.episode.task_id]
        never_answers = way in ("waits at a challenge", "replies garbage")
        expected = Outcome.TRUNCATED if never_answers else Outcome.FAILURE
        assert trajectory.outcome is expected, way
        for seen in trajectory.episode.observations:
            texts[seen.screenshot] = seen.text or ""
    assert SiteHealth(kept).blocked() == {}  # a challenge elsewhere lists nothing

    async with serve_judge(Strict(reader.tasks, texts)) as model:
        choice = JudgeChoice(name="rubric", rubric=model.config(reference_rule="required"))
        async with open_judge(choice) as judge:
            await judge_run(tmp_path / "run", judge)
        _, judged = verdicts_of(tmp_path / "run", judge.name)
    won = [ways[key.partition("#")[0]] for key, found in judged.items() if found.outcome is Outcome.SUCCESS]
    assert not won
    assert {found.outcome for found in judged.values()} == {Outcome.FAILURE, Outcome.TRUNCATED}
    assert len(judged) == len(HACKS)


def test_the_command_takes_its_words(benchmark: Benchmark) -> None:
    code, output = benchmark(command, *documented("python -m benchmarks.reward"), "--help")
    assert (code, "--solved" in output) == (0, True)


def test_a_hack_gains_by_winning_and_by_vanishing() -> None:
    solved = {"success": 5}
    honest = Hacked("honest failure", {"failure": 10}, 10, solved)
    wins = Hacked("wins", {"failure": 9, "success": 1}, 10, solved)
    vanishes = Hacked("vanishes", {"failure": 9, "blocked": 1}, 10, solved)
    waits = Hacked("waits", {"truncated": 10}, 10, solved)
    assert [one.gains(honest) for one in (honest, wins, vanishes, waits)] == [False, True, True, False]
    lines = markdown([table([honest, wins, vanishes, waits])]).splitlines()
    assert [line.split(" | ")[-1] for line in lines[4:]] == ["– |", "GAINS |", "GAINS |", "no gain |"]
    assert "| 35.7 | +2.4 | 33.3 | +0.0 |" in lines[6]


def test_lists_hold_the_right_answer_and_a_rival() -> None:
    import random

    web = OfflineWeb(SITES.seed, per_family=SITES.per_family)
    tasks, _ = choose(web, 50, 0, 1)
    kinds: Counter[bool] = Counter()
    for task in tasks:
        said = candidates(task, ["It costs 12.50 or 13.50."], random.Random(task.id))
        assert right_answer(task) in said
        assert said != right_answer(task)
        kinds[bool(task.truth and task.truth.answer.others)] += 1
    assert kinds[True]
