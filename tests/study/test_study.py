"""The study in miniature: rows are what they say, and the table says what the trainings came to."""

from __future__ import annotations

import asyncio
import json
import math
import random
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("torch")

from tests.conftest import Calls
from tests.documented import ROOT, documented
from tests.report.training import World, build_training, tasks
from tests.train.worlds import training_of

from webgym.core.errors import ConfigError, RunFolderError, UsageError
from webgym.offline.web import OfflineWeb
from webgym.store.runs import RunReader
from webgym.study import conditions as study
from webgym.study.conditions import Fit, Result, carry_out, read_results, read_study, result_of, table, write
from webgym.tasks.selection import select
from webgym.train.config import ObjectiveConfig
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig, Training
from webgym.train.objectives import Attempt, make_objective

STUDY = read_study([])


def test_a_row_differs_from_the_reference_in_what_it_is_named_for() -> None:
    rows = {name: STUDY.training(name, 1, Path("tiny")).model_dump(mode="json") for name in STUDY.rows}
    reference = rows["reference"]
    assert reference["sampler"]["ratio"] == {"easy": 2, "medium": 5, "hard": 3}
    budgets = [reference["rollout"]["attempt"][f"budget_{each}"] for each in ("easy", "medium", "hard")]
    assert budgets == [15, 30, 45]
    differing = {name: set(paths(row, reference)) for name, row in rows.items()}
    assert differing["without memory"] == {"rollout.agent.prompt_format"}
    assert differing["uniform sampling"] == {"sampler.ratio"}
    assert differing["fewer domains"] == {"sampler.without"}
    assert differing["frontier"] == {"sampler.ratio", "learn.frontier"}
    assert differing["shuffled rewards"] == differing["all attempts cloned"] == {"learn.objective.name"}
    sampling = {json.dumps(row["evaluation"]["sampling"]) for row in rows.values()}
    assert sampling == {'{"top_p": 0.99, "extra_body": {"top_k": 2}}'}, "the paper's, in every row"
    assert all(row["sampler"]["split"] == "train" for row in rows.values())
    groups, few = rows["groups"], rows["groups of 40 tasks"]
    assert paths(rows["rescued groups"], few) == ["learn.replay.rescue"]
    assert paths(rows["soft rewards"], groups) == ["learn.objective.options.soft"]
    assert set(paths(few, groups)) == {"sampler.shards"}
    assert set(paths(rows["warm start"], groups)) == {"loop.iterations", "loop.evaluate_every"}
    attempts = {name: row["loop"]["tasks"] * row["rollout"]["samples"] for name, row in rows.items()}
    assert set(attempts.values()) == {160}, "rows are compared at the same number of attempts"


def paths(row: object, other: object, at: str = "") -> list[str]:
    """Where two settings differ."""
    if isinstance(row, dict) and isinstance(other, dict) and at != "sampler.ratio":
        keys = row.keys() | other.keys()
        return [
            path
            for key in keys
            for path in paths(row.get(key), other.get(key), f"{at}.{key}" if at else str(key))
        ]
    return [] if row == other else [at]


def test_the_table_holds_means_and_spreads_and_the_papers_figures(tmp_path: Path) -> None:
    results = [
        Result("reference", 1, [0, 320, 640], [0.2, 0.5, 0.4], core_hours=0.1),
        Result("reference", 2, [0, 320, 640], [0.2, 0.4, 0.6], core_hours=0.3),
        Result("only easy", 1, [0, 320, 640], [0.2, 0.3, 0.3]),
    ]
    lines = list(table(STUDY, results))
    # One evaluation before training, which rows share, has no spread of its own.
    assert lines[2] == "| reference | 2 | 20.0 | 50.0 ± 14.1 | 40.0 ± 0.0 | 0.20 | 26.2, 34.5, +8.3 |"
    assert lines[3].startswith("| only easy | 1 | 20.0 | 30.0 | 27.5 |  | 26.2,")
    write(STUDY, results, tmp_path)
    assert (tmp_path / "study.md").read_text().splitlines()[: len(lines)] == lines
    assert read_results(tmp_path) == results
    assert (tmp_path / "study.png").stat().st_size > 1000


def test_the_tables_in_the_docs_are_those_of_their_results(tmp_path: Path) -> None:
    write(STUDY, read_results(figures := ROOT / "docs" / "figures"), tmp_path)
    assert (tmp_path / "study.md").read_text() == (figures / "study.md").read_text()


def test_the_area_under_the_curve_is_over_trajectories_and_may_be_of_some_kinds() -> None:
    kinds = {"News": [(1, 10), (3, 10), (5, 10)], "Shopping": [(1, 10), (1, 10), (3, 10)], "Other": []}
    result = Result("reference", 1, [0, 100, 400], [0.2, 0.4, 0.6], kinds=kinds)
    assert result.area() == pytest.approx((100 * 0.3 + 300 * 0.5) / 400)
    assert result.area(["News", "Shopping"]) == pytest.approx((100 * 0.15 + 300 * 0.3) / 400)
    assert result.area(["Sports"]) is None
    assert Result("reference", 1, [0, 0], [0.2, 0.4]).area() is None


def test_only_attempts_with_a_reward_are_trajectories_and_each_kind_is_counted(tmp_path: Path) -> None:
    folder = TrainingFolder(tmp_path / "training")
    build_training(folder.path, iterations=2, count=12)
    result, run = result_of(folder, "reference", 1), RunReader(folder.run(1))
    rewarded = [each for each in run.trajectories() if each.outcome.is_rewarded]
    assert result.trajectories[1] == len(rewarded) < len(run.attempts)
    for number, rate in enumerate(result.rates):
        counts = [kind[number] for kind in result.kinds.values()]
        assert sum(right for right, _ in counts) / sum(count for _, count in counts) == pytest.approx(rate)


def test_a_training_with_an_evaluation_that_was_not_judged_is_left_out(tmp_path: Path) -> None:
    unjudged = Result("reference", 1, [0, 640], [None, 0.3])
    write(STUDY, [unjudged], tmp_path)
    assert not (tmp_path / "study.png").exists()
    results = [unjudged, Result("reference", 2, [0, 640], [0.2, 0.3])]
    write(STUDY, results, tmp_path)
    assert read_results(tmp_path) == results
    (row,) = list(table(STUDY, results))[2:]
    assert row.startswith("| reference | 1 | 20.0 | 30.0 |")
    assert list(study.findings(STUDY, results))[2:] == []


def test_a_finding_repeats_where_the_difference_is_beyond_its_interval() -> None:
    after = {
        "reference": (0.40, 0.45, 0.50),
        "without memory": (0.30, 0.35, 0.41),
        "uniform sampling": (0.40, 0.46, 0.50),
        "shuffled rewards": (0.60, 0.65, 0.99),
    }
    results = [
        Result(row, seed, [0, 640], [0.0, 2 * last])
        for row, lasts in after.items()
        for seed, last in enumerate(lasts)
    ]
    # Seeds explain most of the spread, and all rows that learn share what is left of it. A control that
    # wanders makes differences to it uncertain, and no others.
    assert list(study.findings(STUDY, results))[2:] == [
        "| rewards teach (control) | -29.7 ± 41.3 | not seen, at most +11.6 |",
        "| memory helps | +9.7 ± 1.2 | yes |",
        "| uniform sampling beats biased | +0.3 ± 1.2 | not seen, at most +1.5 |",
    ]
    # The warm start's curve bends as the groups' does, and was looked at elsewhere.
    curves = {"groups": (320, [0.3, 0.48, 0.5]), "warm start": (160, [0.3, 0.4, 0.53])}
    bent = [Result(row, n, [0, at, 640], [*rates]) for row, (at, rates) in curves.items() for n in range(4)]
    assert list(study.findings(STUDY, bent))[2:] == ["| a warm start helps groups | +1.5 ± 0.0 | yes |"]
    named = {row for each in STUDY.findings.values() for row in (each.better, each.worse)}
    assert named <= set(STUDY.rows)


def test_the_spread_of_results_is_what_their_rows_and_seeds_do_not_explain() -> None:
    rng, rows, seeds = random.Random(5), [f"row {number}" for number in range(12)], range(40)
    results = {
        (row, seed): 0.1 * seed + 0.02 * (row == "row 3") + rng.gauss(0, 0.01)
        for row in rows
        for seed in seeds
    }
    fit = Fit(results)
    assert fit.freedom == 11 * 39
    assert fit.spread == pytest.approx(0.01, rel=0.1)
    found = fit.difference("row 3", "row 5")
    assert found is not None
    assert found.mean == pytest.approx(0.02, abs=0.005)
    # As for two means of 40 with a known spread.
    assert found.half_width == pytest.approx(1.966 * fit.spread * math.sqrt(2 / 40), rel=0.001)
    assert fit.difference("row 3", "row 99") is None
    # A training that is missing leaves the others what they are.
    del results["row 3", 0]
    assert Fit(results).freedom == 11 * 39 - 1


@pytest.mark.parametrize(("freedom", "quantile"), [(2, 4.303), (3, 3.182), (9, 2.262), (63, 1.998)])
def test_students_t(freedom: int, quantile: float) -> None:
    assert study.student(0.975, freedom) == pytest.approx(quantile, rel=0.01)


def test_the_plan_says_what_differences_will_show() -> None:
    rows = list(STUDY.rows)[:8]
    cost, shows = study.plan(STUDY, rows, 10, [])
    assert cost == "8 rows x 10 seeds: 80 trainings, about 9.6 core hours (0.12 each, expected)"
    assert "2.3 points" in shows
    assert "spread 1.8 points, expected" in shows
    # Found by chance alone in four of five made-up studies of that size.
    rng, found = random.Random(2), 0
    for _ in range(200):
        results = {
            (row, seed): rng.gauss(0.023 * (row == rows[0]), 0.018) for row in rows for seed in range(10)
        }
        difference = Fit(results).difference(rows[0], rows[1])
        assert difference is not None
        found += difference.mean > difference.half_width
    assert 140 < found < 180
    assert list(study.plan(STUDY, rows[:1], 10, []))[1].startswith("too few rows")
    measured = [
        Result(row, seed, [0, 640], [0.2, 0.4 + 0.01 * ((seed + place) % 3)], core_hours=0.5)
        for place, row in enumerate(rows)
        for seed in range(3)
    ]
    cost, shows = study.plan(STUDY, rows, 10, measured)
    assert "about 40.0 core hours (0.50 each, measured)" in cost
    assert "measured" in shows


def test_controls_imitate_regardless_of_the_reward() -> None:
    attempts = [Attempt(f"a{number}", "task", float(number < 5)) for number in range(20)]
    objectives = [
        make_objective(ObjectiveConfig.model_validate(STUDY.rows[row].settings["learn"]["objective"]))
        for row in ("shuffled rewards", "all attempts cloned")
    ]
    shuffled, cloned = (objective.advantages(attempts) for objective in objectives)
    assert cloned == {attempt.id: 1.0 for attempt in attempts}
    assert len(shuffled) == 5
    assert set(shuffled) != {f"a{number}" for number in range(5)}
    assert objectives[0].advantages(reversed(attempts)) == shuffled


def test_what_is_not_there_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown row 'x'"):
        STUDY.training("x", 1, tmp_path)
    (tmp_path / "own.yaml").write_text("rowz: {}\n")
    with pytest.raises(ConfigError, match="did you mean rows"):
        read_study([tmp_path / "own.yaml"])


def test_fewer_domains_are_fewer_tasks() -> None:
    tasks = list(OfflineWeb(per_family=5, collection="small").tasks())
    rows = (STUDY.training(row, 1, Path("weights")).sampler for row in ("reference", "fewer domains"))
    whole, part = (select(tasks, sampler).tasks for sampler in rows)
    assert 0.5 < len(part) / len(whole) < 0.7
    assert {task.source for task in part} == {"small"}


async def test_a_training_that_was_killed_after_its_last_evaluation_is_brought_to_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = STUDY.model_copy(update={"base": STUDY.base | {"loop": {**STUDY.base["loop"], "iterations": 2}}})
    path, first = tmp_path / "trainings/reference/seed-1", tmp_path / "weights"
    first.mkdir()
    await asyncio.to_thread(build_training, path, iterations=2, count=6)
    (path / "iterations/0002/metrics.json").unlink()  # what an iteration writes last

    @asynccontextmanager
    async def opened(held: TrainConfig, out: Path, *, resume: bool, **_: Any) -> AsyncIterator[Training]:
        assert resume
        yield training_of(out, World(3), held, tasks(6))

    monkeypatch.setattr(study, "open_training", opened)
    (result,) = await carry_out(short, first, ["reference"], 1, tmp_path, print)
    assert result.trajectories == [0, 5, 10], "one of six has no reward"

    # What is in study.json is not made again: on another machine that file is enough.
    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("a training was begun")

    monkeypatch.setattr(study, "open_training", never)
    (elsewhere := tmp_path / "elsewhere").mkdir()
    shutil.copy(tmp_path / "study.json", elsewhere)
    assert await carry_out(short, first, ["reference"], 1, elsewhere, print) == [result]

    # Unless it was made otherwise: with other settings, or other first weights.
    with pytest.raises(RunFolderError, match="reference, seed 1 was made with other settings"):
        await carry_out(STUDY, first, ["reference"], 1, elsewhere, print)
    (first / "config.json").write_text("{}")
    with pytest.raises(RunFolderError, match="other settings or first weights"):
        await carry_out(short, first, ["reference"], 1, elsewhere, print)
    (elsewhere / "study.json").write_text("[{")
    with pytest.raises(RunFolderError, match="holds no results"):
        await carry_out(short, first, ["reference"], 1, elsewhere, print)


async def test_a_warm_start_is_of_anothers_successes_which_count_as_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[Path, list[Path]]] = []

    def warmed(config: TrainConfig, runs: list[Path], _: object, started: Path, __: object) -> TrainConfig:
        calls.append((started, runs))
        return config.model_copy(update={"learn": config.learn.model_copy(update={"model": str(started)})})

    @asynccontextmanager
    async def opened(held: TrainConfig, path: Path, **_: Any) -> AsyncIterator[SimpleNamespace]:
        assert held.learn.model == str(path.with_name("seed-1-start"))
        yield SimpleNamespace(run=lambda: asyncio.to_thread(build_training, path, iterations=1, count=6))

    copied: list[object] = []
    monkeypatch.setattr(study, "_copy_evaluation", lambda *folders: copied.append(folders))
    monkeypatch.setattr(study, "open_training", opened)
    monkeypatch.setattr(study, "warm_start", warmed)
    monkeypatch.setattr(study, "all_tasks", lambda _: tasks(6))
    loop = {**STUDY.base["loop"], "iterations": 1, "tasks": 2}
    rows = STUDY.rows | {"warm start": STUDY.rows["warm start"].model_copy(update={"settings": {}})}
    short = STUDY.model_copy(update={"base": STUDY.base | {"loop": loop}, "rows": rows})
    (first := tmp_path / "weights").mkdir()
    source = TrainingFolder(tmp_path / "trainings/reference/seed-1")
    for iterations in (0, 1):  # one that was never begun, and one that is not in study.json
        await asyncio.to_thread(build_training, source.path, iterations=1, count=6) if iterations else None
        with pytest.raises(UsageError, match=r"warm-start/seed-1 starts from attempts in .*reference"):
            await carry_out(short, first, ["warm start"], 1, tmp_path, print)
    begun = result_of(source, "reference", 1)
    write(short, [begun], tmp_path)
    _, result = await carry_out(short, first, ["reference", "warm start"], 1, tmp_path, print)
    assert calls == [(tmp_path / "trainings/warm-start/seed-1-start", [source.run(1)])]
    assert not copied, "the evaluation of the initial weights is not of those it starts with"
    own = result_of(TrainingFolder(tmp_path / "trainings/warm-start/seed-1"), "warm start", 1)
    before = begun.trajectories[1]
    assert result.trajectories == [0, before, before + own.trajectories[1]]
    assert result.success == [begun.success[0], *own.success]
    assert all(len(counts) == 3 for counts in result.kinds.values())
    assert result.kinds.keys() == own.kinds.keys()


def test_the_pages_commands_train_the_rows_that_are_asked_for(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    @asynccontextmanager
    async def opened(held: TrainConfig, out: Path, **_: Any) -> AsyncIterator[Training]:
        yield training_of(out, World(1), held, tasks(6))

    monkeypatch.setattr(study, "open_training", opened)
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text("base: {loop: {iterations: 1, tasks: 2}, evaluation: {count: 2}}\n")
    page = documented("webgym study --out study --row only easy --seeds 5")
    code, said = calls.run(*page, "small.yaml", "--seeds", 1)
    assert code == 0, said
    assert "training 1 of 1: only easy, seed 1" in said
    small = ("small.yaml", "--seeds", 1, "--row", "reference")
    code, said = calls.run(*documented("webgym study --out study"), *small)
    assert code == 0, said
    assert "1 rows x 1 seeds: 1 trainings" in said
    code, said = calls.run(*documented("webgym study --plan --seeds 10"))
    assert code == 0, said
    assert said.splitlines()[0] == "reference"
    assert "points between two rows" in said
    assert len(json.loads(Path("study/study.json").read_text())) == 2


async def test_a_training_that_was_begun_with_other_settings_is_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: Any, **__: Any) -> None:
        raise MemoryError

    monkeypatch.setattr(study, "open_training", killed)
    with pytest.raises(MemoryError):
        await carry_out(STUDY, tmp_path / "weights", ["reference"], 1, tmp_path, print)
    other = STUDY.model_copy(update={"base": STUDY.base | {"evaluation": {"count": 7}}})
    with pytest.raises(RunFolderError, match="was made with other settings"):
        await carry_out(other, tmp_path / "weights", ["reference"], 1, tmp_path, print)
    assert "| reference |" not in (tmp_path / "study.md").read_text(), "no figures yet"


async def test_the_first_weights_are_evaluated_once_for_all_rows_with_the_same_agent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluated: list[str] = []

    class Evaluating:
        def __init__(self, folder: TrainingFolder) -> None:
            self.folder = folder

        async def run(self) -> None:
            if not self.folder.is_evaluated(0):
                evaluated.append(self.folder.path.parent.name)
                self.folder.evaluation(0).mkdir(parents=True)
                (self.folder.evaluation(0) / "summary.json").write_text("{}")
                self.folder.write_evaluation(0, {"success_rate": {"overall": 0.25}})

    @asynccontextmanager
    async def opened(held: TrainConfig, out: Path, **_: Any) -> AsyncIterator[Evaluating]:
        out.mkdir(parents=True, exist_ok=True)
        with TrainingFolder(out).locked():
            yield Evaluating(TrainingFolder(out))

    copied = shutil.copytree

    def killed(source: Path, target: Path, **_: Any) -> None:
        copied(source, target, dirs_exist_ok=True)
        raise MemoryError

    monkeypatch.setattr(study, "open_training", opened)
    monkeypatch.setattr(study, "result_of", lambda _, row, seed: Result(row, seed, [0, 640], [0.25, 0.5]))
    (first := tmp_path / "weights").mkdir()
    rows = ["reference", "without memory", "uniform sampling", "groups"]
    with monkeypatch.context() as killing:
        killing.setattr(shutil, "copytree", killed)
        with pytest.raises(MemoryError):
            await carry_out(STUDY, first, rows, 2, tmp_path, print)
    part = tmp_path / "trainings/uniform-sampling/seed-1/evaluations/0000"
    assert not part.exists(), "it would be continued as a run"
    await carry_out(STUDY, first, rows, 2, tmp_path, print)
    assert not list(part.parent.glob(".*"))
    assert evaluated == ["reference", "without-memory"]  # which has a prompt of its own
    assert (tmp_path / "trainings/reference/seed-2/evaluations/0000/summary.json").is_file()
