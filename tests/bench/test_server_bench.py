"""``webgym bench server`` in small: every part runs and prints its table."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SMALL = (
    "--sessions 2 --rounds 1 --seconds 0.5 --thinkers 2 --think 0.2 --thinking 1 "
    "--dense 2 --calls 2 --burst 2"
).split()


def bench(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "webgym", "bench", "server", *arguments],
        capture_output=True,
        text=True,
        timeout=100,
    )


@pytest.mark.browser
def test_every_part_runs(tmp_path: Path) -> None:
    done = bench(*SMALL, "--markdown", "--json", str(tmp_path / "figures.json"))
    assert done.returncode == 0, done.stderr
    for title in ("Against the ceiling", "CPU milliseconds per call", "of thinking", "burst", "Density"):
        assert title in done.stdout
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["density"]["steps"]["failures"] == 0
    assert all(run["latencies"] for page in figures["ceiling"] for run in page["server"])
    costs = {cost["operation"]: cost for cost in figures["costs"]}
    assert costs["navigate"]["cpu"]["renderer"] > 0


def test_a_part_that_is_not_there_is_named() -> None:
    done = bench("--only", "everything")
    assert done.returncode == 2
    assert "everything" in done.stderr
