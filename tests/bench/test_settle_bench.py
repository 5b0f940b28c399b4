"""``python -m benchmarks.settle`` in small: it runs, prints its table, and says what was not final."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from benchmarks.settle.__main__ import command
from benchmarks.settle.trials import Trial, misses, settle_tables, summarize
from tests.bench.conftest import Benchmark
from tests.documented import documented


def trial(way: str, seconds: float, ideal: float | None) -> Trial:
    return Trial("plain", "plain", way, 0, seconds, ideal is not None, ideal, "")


def test_a_row_says_how_often_how_late_and_by_how_much() -> None:
    trials = [trial("ours", 1.0, 0.5), trial("ours", 3.0, 2.0), trial("load", 0.1, None)]
    ours, load = summarize(trials)
    assert (ours.way, ours.trials, ours.final) == ("ours", 2, 1.0)
    assert ours.p50 == pytest.approx(2.0)
    assert ours.over_p50 == pytest.approx(0.75)
    assert (load.way, load.final) == ("load", 0.0)
    assert math.isnan(load.over_p50)
    assert misses(trials, "load") == ["plain"]
    assert [len(table.rows) for table in settle_tables(trials)] == [2, 1]


@pytest.mark.browser
def test_the_command_prints_a_table(benchmark: Benchmark, tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    pages = ("--page", "plain-click", "--page", "xhr-click")
    ways = ("--way", "ours", "--way", "load")
    code, output = benchmark(
        command,
        *documented("python -m benchmarks.settle"),
        *pages,
        *ways,
        "--rounds",
        1,
        "--slots",
        1,
        "--json",
        figures,
        "--markdown",
    )
    assert code == 0, output
    assert "| ours | 100.0% |" in output
    assert "not always final with load: xhr-click" in output
    assert len(json.loads(figures.read_text())["trials"]) == 4
