"""``python -m benchmarks.task_set``: a task set of the paper's size, stage by stage."""

from __future__ import annotations

from pathlib import Path

import msgspec
import typer
from benchmarks.command import expect_to_write
from benchmarks.command import run as run_command
from benchmarks.task_set.made_up import Shape
from benchmarks.task_set.stages import STAGES, TasksBench, measure, missed, tasks_tables
from rich.console import Console

from webgym.core.errors import ConfigError
from webgym.tables import markdown, show


def command(
    only: list[str] = typer.Option(
        [],
        "--only",
        help="load, load-parquet, split, sample, decompose, duplicates or pipeline. May be repeated.",
        show_default="all",
    ),
    tasks: int = typer.Option(300_000, "--tasks", min=100, help="Tasks of the made-up set."),
    websites: int = typer.Option(128_000, "--websites", min=50, help="Websites that they are on."),
    rounds: int = typer.Option(3, "--rounds", min=1, help="Times that each stage runs."),
    seed: int = typer.Option(0, "--seed", help="Of the set."),
    json: Path | None = typer.Option(None, "--json", help="Write every run here."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print Markdown, for a document."),
) -> None:
    """A task set of the paper's size: load, split, validate, sample, decompose, duplicates, all in a row.

    Makes the set itself, in a temporary folder; needs nothing else. About four minutes in full. Exit code 1
    if a goal was missed; the goals are for the usual size, on two cores.
    """
    expect_to_write(json)
    unknown = [stage for stage in only if stage not in STAGES]
    if unknown:
        raise ConfigError(f"there is no stage {unknown[0]!r}", hint=f"one of {', '.join(STAGES)}")
    if websites > tasks:
        raise ConfigError(f"{tasks:,} tasks are on {tasks:,} websites at most", hint="give fewer --websites")
    said = Console(stderr=True)
    bench = TasksBench(shape=Shape(tasks=tasks, websites=websites, seed=seed), rounds=rounds)
    found = measure(bench, only or STAGES, lambda line: said.print(line, style="dim", highlight=False))
    if json is not None:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(found)))
    if as_markdown:
        print(markdown(tasks_tables(found)), end="")
    else:
        show(tasks_tables(found), Console())
    goals = missed(found)
    for goal in goals:
        print(f"missed: {goal}")
    if goals:
        raise typer.Exit(1)


if __name__ == "__main__":
    run_command(command)
