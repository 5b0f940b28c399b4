"""``webgym tasks sources``: list the benchmarks that tasks come from, and read their files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.text import Text

from webgym.cli import EXIT_USAGE
from webgym.cli._print import say, say_some
from webgym.core.errors import UsageError
from webgym.core.tables import Table, put

if TYPE_CHECKING:
    from webgym.tasks.sources import Read


def sources(
    read: list[str] = typer.Option(
        [],
        "--read",
        metavar="NAME=WHERE",
        help="Count the tasks of a file, a folder or hub:OWNER/NAME[@REVISION][:SPLIT] of a source. "
        "Repeatable.",
    ),
    lines: int = typer.Option(
        20,
        "--lines",
        min=0,
        help="Maximum number of skipped records and of files without tasks to list per source.",
    ),
) -> None:
    """List the benchmarks that tasks come from; with --read, count tasks in files. Fails if one has none."""
    console = Console()
    if not read:
        _list(console)
        return
    without_tasks = False
    for name, location in [_name_and_location(option) for option in read]:
        without_tasks |= not _print_source(console, name, location, lines)
    if without_tasks:
        raise typer.Exit(EXIT_USAGE)


def _name_and_location(option: str) -> tuple[str, str]:
    from webgym.tasks.hub import address_of

    name, separator, location = option.partition("=")
    if not (separator and name and location):
        raise UsageError(f"--read {option!r} is not NAME=WHERE", hint="such as --read deepshop=PATH")
    return name.strip(), location if address_of(location) else str(Path(location).expanduser())


def _list(console: Console) -> None:
    from webgym.tasks.sources import SOURCES

    rows = [
        (source.name, source.licence, str(source.paper_tasks), str(source.paper_websites))
        for source in SOURCES.values()
    ]
    put(Table("", ("source", "licence", "tasks (paper)", "websites (paper)"), rows, names=2), console)


def _print_source(console: Console, name: str, location: str, lines: int) -> bool:
    """Read a source and print its counts; whether it contains any task."""
    from webgym.tasks.sources import SOURCES, read_source

    records = read_source(name, location)
    source = SOURCES[name]
    console.print(Text.assemble((name, "bold"), f"  {location}"), soft_wrap=True)
    for label, value in _counts(records, source.paper_tasks, source.paper_websites):
        say(f"  {label:<10} {value}", console)
    say_some(records.skipped, lines, console)
    say_some(records.passed_over, lines, console)
    return bool(records.tasks)


def _counts(records: Read, paper_tasks: int, paper_websites: int) -> Iterable[tuple[str, str]]:
    yield "records", f"{records.records:,}"
    yield "tasks", f"{len(records.tasks):,} (the paper's {paper_tasks:,})"
    yield "skipped", f"{len(records.skipped):,}"
    yield "websites", f"{records.websites():,} by registrable domain (the paper's {paper_websites:,})"
    for label, counts in (("website", records.websites_from()), ("flags", records.flags())):
        yield label, ", ".join(f"{count:,} {value}" for value, count in sorted(counts.items())) or "none"
    if records.passed_over:
        yield "no tasks", f"in {len(records.passed_over):,} files"
