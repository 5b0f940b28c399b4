"""``webgym tasks stats``: count a task set and draw its figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from webgym.core.task import Level

FORMS = ("terminal", "markdown", "csv", "json")


def stats(
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    figures: Path | None = typer.Option(
        None, "--figures", help="Folder to write figures to, as PNG and SVG."
    ),
    run: list[Path] = typer.Option(
        [], "--run", help="Run folder: count the steps of its answered attempts. May be repeated."
    ),
    form: str = typer.Option("terminal", "--form", help="Output format: terminal, markdown, csv or json."),
) -> None:
    """Count a task set by source, difficulty, domain and website; draw its figures."""
    import sys

    import msgspec
    from rich.console import Console

    from webgym.cli.tasks._files import read_unique
    from webgym.core.errors import ConfigError, TaskFileError
    from webgym.core.tables import csv_text, markdown, show
    from webgym.taskset.statistics import describe, tables

    if form not in FORMS:
        raise ConfigError(f"unknown form {form!r}", hint=f"choose one of {', '.join(FORMS)}")
    counts = describe(read_unique(files), _lengths(run))
    if form == "terminal":
        show(tables(counts), Console())
    elif form == "json":
        print(msgspec.json.format(msgspec.json.encode(counts)).decode())
    else:
        print(markdown(tables(counts)) if form == "markdown" else csv_text(tables(counts)), end="")
    if figures is not None:
        from webgym.taskset.figures import draw_figures

        try:
            drawn = draw_figures(counts, figures)
        except OSError as error:
            raise TaskFileError(f"cannot write to {figures}: {error.strerror or error}") from error
        print(f"{len(drawn)} files written to {figures}", file=sys.stderr)


def _lengths(runs: list[Path]) -> dict[Level, list[int]]:
    """Steps of answered attempts by level of the task; attempts that spent their budget do not count."""
    from webgym.core.outcome import Outcome
    from webgym.core.task import LEVELS
    from webgym.store.runs import RunReader

    lengths: dict[Level, list[int]] = {level: [] for level in LEVELS}
    for path in runs:
        reader = RunReader(path)
        for entry in reader.attempts.values():
            is_answered = entry.outcome in (Outcome.SUCCESS, Outcome.FAILURE)
            if is_answered and (task := reader.tasks.get(entry.task_id)) is not None:
                lengths[task.level].append(len(reader.trajectory(entry.attempt_id).episode.steps))
    return lengths
