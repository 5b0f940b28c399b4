"""``webgym tasks check``, ``validate``, ``stats``, ``probe``: whether a set is in order; what it holds."""

from __future__ import annotations

import sys
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

import msgspec
import typer
from rich.console import Console

from webgym.cli import EXIT_FAILED, EXIT_USAGE, _options
from webgym.cli._checks import check_writable
from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._print import print_json, print_tables, say, say_some
from webgym.cli.tasks._files import print_set_aside, read_all, read_unique
from webgym.core.errors import TaskFileError, UsageError
from webgym.core.tables import Table, csv_text, put
from webgym.core.task import LEVELS
from webgym.run.config import RunConfig
from webgym.tasks.files import whole_file
from webgym.tasks.formats import read_tasks

if TYPE_CHECKING:
    from webgym.core.task import Level

PROBE = Options(
    RunConfig,
    {
        "--out": Option("health.file", help="File of what is found; it is continued if it exists."),
        "--sessions": "collector.sessions",
        "--server": "server.url",
    },
)
_LINE_SECONDS: Final = 10.0
"""How often a line says how far the probe is."""


def validate(
    files: list[Path] = typer.Argument(..., help="Task files of one set, training and test together."),
    unsplit: bool = typer.Option(
        False, "--unsplit", help="The tasks are not split yet: check the other rules only."
    ),
    lines: int = typer.Option(20, "--lines", min=0, help="Maximum number of violations to list per rule."),
    json: Path | None = typer.Option(None, "--json", help="Write the full report to this JSON file."),
) -> None:
    """Check that no training task is on a test website, among other rules, and list violations. Fails if any.

    Tasks without a split get it from the name of their file, train or test. Broken records are violations,
    too; tasks without a fact to judge are counted and not checked.
    """
    from webgym.taskset.validate import validate as run

    check_writable(json)
    records = read_all(files)
    report = run(records.tasks, split=not unsplit)
    broken = [str(record) for record in records.broken]
    if json is not None:
        aside = [str(record) for record in records.set_aside]
        document = {"report": report, "broken": broken, "set_aside": aside}
        with whole_file(json) as file:
            file.write(msgspec.json.format(msgspec.json.encode(document)))
    for line, listed in report.sections(broken):
        print(line)
        say_some(listed, lines, Console(), "      ")
    print_set_aside(records.set_aside)
    if broken:
        raise typer.Exit(EXIT_USAGE)
    if not report.ok:
        raise typer.Exit(EXIT_FAILED)


def check(file: Path = typer.Argument(..., help="Task file.")) -> None:
    """Count the tasks of a task file, and list its broken records. Fails if there are any."""
    from webgym.core.websites import site_or_text

    records = read_tasks(file)
    console = Console()
    counts = Counter((task.domain, task.subdomain, task.level) for task in records.tasks)
    rows = [
        (*names, *(str(counts[*names, level]) for level in LEVELS))
        for names in sorted({(task.domain, task.subdomain) for task in records.tasks})
    ]
    put(Table("", ("domain", "subdomain", *LEVELS), rows, names=2), console)
    websites = len({site_or_text(task.website) for task in records.tasks})
    console.print(f"{len(records.tasks)} tasks on {websites} websites, {len(records.broken)} broken records")
    print_set_aside(records.set_aside)
    for record in records.broken:
        say(record, console)
    if records.broken:
        raise typer.Exit(EXIT_USAGE)


Form: TypeAlias = Literal["terminal", "markdown", "csv", "json"]


def stats(
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    figures: Path | None = typer.Option(
        None, "--figures", help="Folder to write figures to, as PNG and SVG."
    ),
    run: list[Path] = typer.Option(
        [], "--run", help="Run folder: count the steps of its answered attempts. May be repeated."
    ),
    form: Form = typer.Option("terminal", "--form", help="Output format."),
) -> None:
    """Count a task set by source, difficulty, domain and website; draw its figures."""
    from webgym.taskset.statistics import describe

    counts = describe(read_unique(files), _lengths(run))
    if form == "json":
        print_json(counts)
    elif form == "csv":
        print(csv_text(counts.tables()), end="")
    else:
        print_tables(counts.tables(), Console(), as_markdown=form == "markdown")
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
    from webgym.store.runs import RunReader

    lengths: dict[Level, list[int]] = {level: [] for level in LEVELS}
    for path in runs:
        reader = RunReader(path)
        for entry in reader.attempts.values():
            is_answered = entry.outcome in (Outcome.SUCCESS, Outcome.FAILURE)
            if is_answered and (task := reader.tasks.get(entry.task_id)) is not None:
                lengths[task.level].append(len(reader.trajectory(entry.attempt_id).episode.steps))
    return lengths


@takes(settings=PROBE)
def probe(
    settings: Given,
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    rate: float = typer.Option(2.0, "--rate", min=0.001, help="Start pages to open per second, in all."),
    older_than: float | None = typer.Option(
        None,
        "--older-than",
        min=0,
        help="Ask again what was last asked so many hours ago.",
        show_default=False,
    ),
    robots: bool = typer.Option(
        False, "--robots", help="Open no start page that its robots.txt asks robots not to open."
    ),
    config: _options.Config = None,
    token_file: _options.TokenFile = None,
) -> None:
    """Open the start page of every website of a task set once, and count which still answer.

    At most one page of a website is open at a time. The same command continues a probe that was stopped or
    killed. Runs leave out what refuses or is dead if the file is their health.file.
    """
    from webgym.cli import _run
    from webgym.run.probe import probe as run

    chosen = _run.settings(config or (), settings)
    if chosen.health.file is None:
        raise UsageError("there is no file to write to", hint="give --out, such as --out sites.jsonl")
    tasks, console, last = read_unique(files), Console(stderr=True), 0.0

    def advance(done: int, total: int) -> None:
        nonlocal last
        if done == total or time.monotonic() - last > _LINE_SECONDS:
            last = time.monotonic()
            say(f"{done:,} of {total:,} hosts asked", console)

    found = _run.run(
        lambda: run(
            tasks,
            chosen,
            per_second=rate,
            older_than_hours=older_than,
            robots=robots,
            secrets=_run.secrets(token_file),
            tell=lambda line: say(line, console),
            advance=advance,
        ),
        kept=f"what was found is in {chosen.health.file}",
    )
    put(found, Console())
