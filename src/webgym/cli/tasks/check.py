"""``webgym tasks check``: count the tasks of a file and list its broken records."""

from __future__ import annotations

from pathlib import Path

import typer


def check(file: Path = typer.Argument(..., help="Task file.")) -> None:
    """Count the tasks of a task file, and list its broken records. Fails if there are any."""
    from collections import Counter

    from rich.console import Console

    from webgym.cli import EXIT_USAGE
    from webgym.cli.tasks._files import print_set_aside
    from webgym.core.tables import Table, put
    from webgym.core.task import LEVELS
    from webgym.core.websites import site_or_text
    from webgym.tasks.formats import read_tasks

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
        console.print(str(record), highlight=False, markup=False, soft_wrap=True)
    if records.broken:
        raise typer.Exit(EXIT_USAGE)
