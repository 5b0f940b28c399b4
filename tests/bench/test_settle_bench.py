"""``python -m benchmarks.settle`` in small: it runs, prints its table, and says what was not final."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from benchmarks.settle.__main__ import command
from tests.bench.conftest import Benchmark
from tests.documented import documented


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
