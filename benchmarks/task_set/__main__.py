"""``python -m benchmarks.task_set``: time and memory of the work on a task set of the paper's size."""

from __future__ import annotations

from pathlib import Path

import msgspec
import typer
from benchmarks.command import check_writable
from benchmarks.command import run as run_command
from benchmarks.task_set.stages import STAGES, TasksBench, measure, missed, tasks_tables
from benchmarks.task_set.synthetic import Shape
from rich.console import Console

from webgym.core.errors import ConfigError
from webgym.core.tables import markdown, show


def command(
    only: list[str] = typer.Option(
        [],
        "--only",
        help="Stage: load, load-parquet, split, sample, decompose, duplicates or pipeline. May be repeated.",
        show_default="all",
    ),
    tasks: int = typer.Option(300_000, "--tasks", min=100, help="Number of tasks of the synthetic set."),
    websites: int = typer.Option(128_000, "--websites", min=50, help="Number of websites of the set."),
    rounds: int = typer.Option(3, "--rounds", min=1, help="Number of runs of each stage."),
    seed: int = typer.Option(0, "--seed", help="Seed of the set."),
    json: Path | None = typer.Option(None, "--json", help="Write all results to this JSON file."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print the tables as Markdown."),
) -> None:
    """Measure time and memory of loading, splitting, sampling and building a task set of the paper's size.

    Generates the set in a temporary folder; needs nothing else. Takes about four minutes. Exits with 1 if a
    goal is missed; the goals are for the default size on two cores.
    """
    check_writable(json)
    unknown = [stage for stage in only if stage not in STAGES]
    if unknown:
        raise ConfigError(f"unknown stage {unknown[0]!r}", hint=f"choose one of {', '.join(STAGES)}")
    if websites > tasks:
        raise ConfigError(f"{tasks:,} tasks cannot be on more websites", hint="give fewer --websites")
    progress = Console(stderr=True)
    bench = TasksBench(shape=Shape(tasks=tasks, websites=websites, seed=seed), rounds=rounds)
    results = measure(bench, only or STAGES, lambda line: progress.print(line, style="dim", highlight=False))
    if json is not None:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(results)))
    if as_markdown:
        print(markdown(tasks_tables(results)), end="")
    else:
        show(tasks_tables(results), Console())
    goals = missed(results)
    for goal in goals:
        print(f"goal missed: {goal}")
    if goals:
        raise typer.Exit(1)


if __name__ == "__main__":
    run_command(command)
