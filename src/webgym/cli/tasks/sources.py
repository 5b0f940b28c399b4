"""``webgym tasks sources``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import Console

    from webgym.tasks.sources import Read


def sources(
    read: list[str] = typer.Option(
        [],
        "--read",
        metavar="NAME=WHERE",
        help="Say what a source holds: a file, a folder or hub:<datasets id>[:<split>]. Repeatable.",
    ),
    lines: int = typer.Option(
        20, "--lines", min=0, help="How many skipped records and passed-over files to name, per source."
    ),
) -> None:
    """List the benchmarks that tasks come from; with --read, what files hold. Fails if one holds none."""
    from rich.console import Console

    from webgym.cli import EXIT_USAGE

    console = Console()
    if not read:
        _list(console)
        return
    without_tasks = False
    for name, where in [_named(each) for each in read]:
        without_tasks |= not _report(console, name, where, lines)
    if without_tasks:
        raise typer.Exit(EXIT_USAGE)


def _named(given: str) -> tuple[str, str]:
    from webgym.core.errors import UsageError
    from webgym.tasks.sources import HUB

    name, separator, where = given.partition("=")
    if not (separator and name and where):
        raise UsageError(f"--read {given!r} is not NAME=PLACE", hint="give --read deepshop=PATH")
    return name.strip(), where if where.startswith(HUB) else str(Path(where).expanduser())


def _list(console: Console) -> None:
    from webgym.tables import Table, grid
    from webgym.tasks.sources import SOURCES

    rows = [
        (source.name, source.licence, str(source.paper_tasks), str(source.paper_websites))
        for source in SOURCES.values()
    ]
    console.print(grid(Table("", ("source", "licence", "tasks (paper)", "websites (paper)"), rows, names=2)))


def _report(console: Console, name: str, where: str, lines: int) -> bool:
    """Say what a source held; whether there was any task."""
    from rich.text import Text

    from webgym.tasks.sources import SOURCES, read_source

    held = read_source(name, where)
    source = SOURCES[name]
    console.print(Text.assemble((name, "bold"), f"  {where}"), soft_wrap=True)
    for label, value in _figures(held, source.paper_tasks, source.paper_websites):
        console.print(f"  {label:<10} {value}", highlight=False, markup=False, soft_wrap=True)
    _some(console, held.skipped, lines)
    _some(console, held.passed_over, lines)
    return bool(held.tasks)


def _figures(held: Read, paper_tasks: int, paper_websites: int) -> Iterable[tuple[str, str]]:
    yield "records", f"{held.records:,}"
    yield "tasks", f"{len(held.tasks):,} (the paper's {paper_tasks:,})"
    yield "skipped", f"{len(held.skipped):,}"
    yield "websites", f"{held.websites():,} by registrable domain (the paper's {paper_websites:,})"
    for label, counts in (("website", held.websites_from()), ("flags", held.flags())):
        yield label, ", ".join(f"{count:,} {what}" for what, count in sorted(counts.items())) or "none"
    if held.passed_over:
        yield "no tasks", f"in {len(held.passed_over):,} files"


def _some(console: Console, told: Iterable[object], lines: int) -> None:
    from webgym.core.text import plain

    every = list(told)
    for each in every[:lines]:
        console.print(f"    {plain(str(each))}", highlight=False, markup=False, soft_wrap=True)
    if lines and len(every) > lines:
        console.print(f"    and {len(every) - lines:,} more (--lines)", highlight=False)
