"""``webgym tasks check``."""

from __future__ import annotations

from pathlib import Path

import typer


def check(file: Path = typer.Argument(..., help="Task file.")) -> None:
    """Say what a task file holds, and which of its records are broken. Fails if any is."""
    from collections import Counter

    from rich.console import Console

    from webgym.cli import EXIT_USAGE
    from webgym.cli.tasks._files import tell_set_aside
    from webgym.core.task import LEVELS
    from webgym.core.websites import site_or_text
    from webgym.tables import Table, grid
    from webgym.tasks.formats import read_tasks

    found = read_tasks(file)
    console = Console()
    counts = Counter((task.domain, task.subdomain, task.level) for task in found.tasks)
    rows = [
        (*names, *(str(counts[*names, level]) for level in LEVELS))
        for names in sorted({(task.domain, task.subdomain) for task in found.tasks})
    ]
    console.print(grid(Table("", ("domain", "subdomain", *LEVELS), rows, names=2)))
    websites = len({site_or_text(task.website) for task in found.tasks})
    console.print(f"{len(found.tasks)} tasks on {websites} websites, {len(found.broken)} broken records")
    tell_set_aside(found.set_aside)
    for record in found.broken:
        console.print(str(record), highlight=False, markup=False, soft_wrap=True)
    if found.broken:
        raise typer.Exit(EXIT_USAGE)
