"""``webgym simulate`` from settings to table, figure and JSON."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console
from tests.conftest import Calls
from tests.documented import documented
from typer.testing import CliRunner

from webgym.cli import build
from webgym.core.errors import ConfigError, UsageError
from webgym.core.tables import Table, show
from webgym.simulate import paper
from webgym.simulate.config import Costs, System, Workload
from webgym.simulate.paper import Point, reproduce
from webgym.simulate.sizing import read_questions, sizes_table

SMALL = """
workload: {mean_steps: 3.0, budgets: [3, 3, 3]}
prices: {cpu: 1.0, gpu: 0.0}
"""


def test_one_table_one_figure_and_the_figures_behind_them(tmp_path: Path) -> None:
    config, figures, drawn = tmp_path / "sim.yaml", tmp_path / "found.json", tmp_path / "sizes.svg"
    config.write_text(SMALL)
    options = ["--cpus", "4", "--cpus", "8", "--gpus", "2", "--environments", "16"]
    options += ["--config", str(config), "--json", str(figures), "--figure", str(drawn), "--markdown"]
    ran = CliRunner().invoke(build("simulate"), ["simulate", *options], catch_exceptions=False)
    assert ran.exit_code == 0
    small, large = json.loads(figures.read_text())
    assert (small["cpus"], large["cpus"]) == (4, 8)
    assert large["rates"]["async"] > small["rates"]["async"]
    assert "| 4 / 2 / 16 |" in ran.output
    assert drawn.read_bytes().startswith(b"<?xml")


def test_environments_for_which_there_is_no_memory_are_told(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "sim.yaml").write_text(SMALL)
    options = ("--cpus", 2, "--gpus", 1, "--config", tmp_path / "sim.yaml", "--markdown")
    code, out, err = calls.apart("simulate", *options, "--environments", 100_000_000)
    assert (code, "| 2 / 1 / 16 |" in out) == (0, True)
    assert "memory allows 8 environments per CPU (system.browsers_per_cpu)\n" in err
    assert "memory" not in calls.run("simulate", *options)[1]


@pytest.mark.parametrize("more", [("--gpus", "inf"), ("--config", "sim.yaml")])
def test_endless_numbers_are_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, calls: Calls, more: tuple[str, str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sim.yaml").write_text("system: {gpus: .inf}")
    assert calls.printed("simulate", *more, code=2).endswith("gpus: Input should be a finite number\n")


@pytest.mark.parametrize("size", [("--gpus", "1e300"), ("--cpus", 10**12)])
def test_a_size_that_no_machine_has_is_refused(calls: Calls, size: tuple[str, str]) -> None:
    assert "less than or equal to 1000000" in calls.printed("simulate", *size, code=2)


def test_no_word_of_its_table_is_cut_and_in_a_pipe_nothing_wraps() -> None:
    size = read_questions([]).answer(System(cpus=8, gpus=1, environments=32))
    tables = [
        sizes_table([size]),
        Table(
            "", ("purpose", "", "prompt tokens"), [("reference answers", " " * 20, "1234567")] * 2, names=2
        ),
    ]
    for columns in (80, 20):
        screen = Console(file=io.StringIO(), force_terminal=True, width=columns, color_system=None)
        show(tables, screen)
        shown = screen.file.getvalue()  # type: ignore[attr-defined]
        assert {"trajectories", "environments", "environment", "reference", "1,234,567"} <= {
            word.lower() for word in shown.split()
        }
        assert "…" not in shown
        if columns == 80:
            assert max(map(len, shown.splitlines())) <= columns
    piped = Console(file=io.StringIO())
    show(tables, piped)
    lines = piped.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(lines) == 3 + 1 + 3  # an empty line after a table with a title
    assert "CPUs / GPUs / environments  per hour  async over step / episode barrier" in lines[1]


def test_the_papers_measurements_in_small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(paper, "MANY", paper.MANY.model_copy(update={"environments": 16}))
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text("workload: {trajectories: 40, mean_steps: 1.5, budgets: [2, 2, 2]}\n")
    page = documented("webgym simulate --paper --figure paper.svg")
    ran = CliRunner().invoke(build("simulate"), [*page, "--config", "small.yaml"], catch_exceptions=False)
    assert ran.exit_code == 0
    assert "128 CPUs, step barrier" in ran.output
    assert Path("paper.svg").read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--json", "none/found.json"], "none/found.json cannot be written"),
        (["--figure", "none/drawn.svg"], "none/drawn.svg cannot be written"),
        (["--figure", "drawn.doc"], "drawn.doc has no suffix of a figure format"),
        (["--figure", "drawn.svg", "--compare", "none"], "no figure of a comparison"),
    ],
)
def test_what_cannot_be_written_is_refused_before_anything_is_computed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, options: list[str], reason: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=reason):
        CliRunner().invoke(
            build("simulate"), ["simulate", *options, "--config", "none"], catch_exceptions=False
        )


def test_a_setting_that_is_not_there_is_refused(tmp_path: Path) -> None:
    config = tmp_path / "sim.yaml"
    config.write_text("costs: {act_cpus: 1}")
    with pytest.raises(ConfigError, match="act_cpus"):
        read_questions([config])


def test_an_error_is_relative_to_the_nearer_end_of_a_range() -> None:
    assert Point("", "x", (4.0, 5.0), 4.5).error == 0
    assert Point("", "x", (4.0, 5.0), 6.0).error == pytest.approx(0.2)
    assert Point("", "x", (4.0, 5.0), 3.0).error == pytest.approx(-0.25)
    assert Point("", "x", None, 3.0).error is None


@pytest.mark.slow
def test_the_paper_is_reproduced_where_the_documentation_says_so() -> None:
    """The fitted figures within 5 %, linear growth with GPUs within 5 %; 128 CPUs in lock step is not."""
    points = list(reproduce(Costs(), Workload()).points)
    fitted = [point for point in points if point.is_fitted]
    assert len(fitted) == 4
    assert all(abs(point.error or 0) < 0.05 for point in fitted)
    assert all(abs(point.error or 0) < 0.05 for point in points if "GPUs" in point.what)
    lock_step = next(point for point in points if point.what.startswith("128 CPUs, step barrier"))
    assert lock_step.simulated > 7.2, "the bound that the module derives"
