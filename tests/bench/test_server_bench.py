"""``webgym bench server`` in small: every part runs and prints its table."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from tests.conftest import Calls, webgym
from tests.documented import documented

from webgym.bench.server import APART, SERVER, SHARED, Ceiling, ServerFigures
from webgym.bench.stepping import BenchPlan, StepTimes

SMALL = (
    "--sessions 1 --rounds 1 --seconds 0.2 --thinkers 2 --think 0.2 --thinking 0.5 "
    "--dense 2 --calls 2 --burst 2"
).split()


def figures_of(folder: Path, command: Sequence[str], *parts: str) -> tuple[str, dict[str, Any]]:
    """What a small run prints and writes; a process of its own, so that nothing else is measured."""
    file = folder / "figures.json"
    chosen = [word for part in parts for word in ("--only", part)]
    words = webgym(*command, *SMALL, *chosen, "--markdown", "--json", file)
    done = subprocess.run(words, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads(file.read_text())


@pytest.mark.browser
def test_the_server_beside_the_bare_loop_and_in_numbers(tmp_path: Path) -> None:
    command = documented("webgym bench server")
    command += documented("webgym bench server --only ceiling --sessions 8")[2:]
    said, figures = figures_of(tmp_path, command)
    assert "Against the ceiling" in said
    assert "thinking" not in figures
    rounds = [page["rounds"] for page in figures["ceiling"]]
    runs = [run for page in rounds for runs in page.values() for run in runs]
    assert all(run["steps"] and not run["failures"] for run in runs)
    assert {name for page in rounds for name in page} == {SHARED, APART, SERVER}


@pytest.mark.browser
def test_one_that_is_stopped_prints_and_holds_the_rounds_that_are_finished(tmp_path: Path) -> None:
    file, words = tmp_path / "figures.json", [*SMALL, "--only", "ceiling", "--rounds", "100000"]
    with subprocess.Popen(
        webgym("bench", "server", *words, "--json", file), stdout=subprocess.PIPE, text=True
    ) as process:
        while not file.exists() and process.poll() is None:
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Against the ceiling" in printed
    (page,) = json.loads(file.read_text())["ceiling"]
    assert len({len(runs) for runs in page["rounds"].values()}) == 1


@pytest.mark.browser
@pytest.mark.slow
def test_every_part_runs(tmp_path: Path) -> None:
    said, figures = figures_of(tmp_path, ("bench", "server"))
    for title in ("Against the ceiling", "CPU milliseconds per call", "of thinking", "burst", "Density"):
        assert title in said
    costs = {cost["operation"]: cost for cost in figures["costs"]}
    assert costs["navigate"]["cpu"]["renderer"] > 0
    assert figures["density"]["steps"]["failures"] == 0


def test_rounds_in_which_no_step_ends_have_no_times_and_no_ratio() -> None:
    none, some = StepTimes(0.1, [], 2), StepTimes(0.1, [0.05], 2)
    ceiling = Ceiling("static", {SHARED: [some], APART: [none], SERVER: [none]})
    table = next(ServerFigures(BenchPlan(), "1.0", 2, ceiling=[ceiling]).tables())
    assert [row[2:] for row in table.rows] == [("–", "50 / 50"), ("–", "– / –"), ("", "– / –")]


def test_a_part_that_is_not_there_is_named(calls: Calls) -> None:
    code, _, err = calls.apart("bench", "server", "--only", "everything")
    assert code == 2
    assert "everything" in err


def test_a_place_where_nothing_can_be_written_is_told_at_once(tmp_path: Path, calls: Calls) -> None:
    code, _, err = calls.apart("bench", "server", "--json", tmp_path / "none" / "figures.json")
    assert code == 2
    assert "cannot be written" in err
    assert "starting" not in err
