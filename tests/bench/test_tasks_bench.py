"""``python -m benchmarks.task_set`` in small: the set it makes, its tables, and its goals."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest
from benchmarks.task_set.__main__ import command
from benchmarks.task_set.stages import STAGES
from benchmarks.task_set.synthetic import Shape, make_tasks
from tests.bench.conftest import Benchmark
from tests.documented import documented

from webgym.core.websites import site_of
from webgym.tasks.sources import SOURCES
from webgym.taskset.statistics import describe

SMALL = Shape(tasks=6_000, websites=2_500)


def test_the_set_has_the_paper_s_shape() -> None:
    tasks = list(make_tasks(SMALL))
    assert len({task.id for task in tasks}) == 6_000
    assert len({site_of(task.website) for task in tasks}) == 2_500
    found = describe(tasks)
    assert 0.4 < found.top_share < 0.55
    shares = {level: count / 6_000 for level, count in found.levels("unsplit").items()}
    assert shares["easy"] == pytest.approx(0.80, abs=0.03)
    assert set(SOURCES) >= {task.source for task in tasks}
    sources = Counter(task.source for task in tasks)
    assert sources["insta-v3"] > sources["pae-webvoyager"] > sources["agentsynth-web"]
    assert len({task.instruction for task in tasks}) > 5_950
    assert tasks == list(make_tasks(SMALL))
    assert tasks[:5] != list(make_tasks(Shape(tasks=6_000, websites=2_500, seed=1)))[:5]


@pytest.mark.slow  # seven processes, one after the other
def test_every_stage_prints_its_table(benchmark: Benchmark, tmp_path: Path) -> None:
    held = tmp_path / "figures.json"
    size = ("--tasks", 1_500, "--websites", 600, "--rounds", 1)
    code, output = benchmark(command, *size, "--json", held, "--markdown")
    assert code == 0, output
    assert "**Parts of pipeline; most time:" in output
    found = json.loads(held.read_bytes())
    assert [(stage["name"], len(stage["runs"])) for stage in found["stages"]] == [
        (stage, 1) for stage in STAGES
    ]
    assert all(run["peak"] > 10_000_000 for stage in found["stages"] for run in stage["runs"])


def test_one_stage_alone(benchmark: Benchmark) -> None:
    size = ("--tasks", 400, "--websites", 150, "--rounds", 1)
    code, output = benchmark(command, *documented("python -m benchmarks.task_set"), *size, "--only", "sample")
    assert code == 0, output
    assert "400 tasks on 150 websites" in output
    assert "most time" not in output
    code, output = benchmark(command, "--only", "lunch")
    assert (code, "unknown stage 'lunch'" in output) == (2, True)
