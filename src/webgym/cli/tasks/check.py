"""``webgym tasks check``."""

from __future__ import annotations

from pathlib import Path

import typer


def check(file: Path = typer.Argument(..., help="Task file.")) -> None:
    """Say what a task file holds, and which of its records are broken. Fails if any is."""
    from collections import Counter

    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from webgym.cli import EXIT_USAGE
    from webgym.cli.tasks._files import tell_set_aside
    from webgym.core.task import LEVELS
    from webgym.core.text import plain
    from webgym.core.websites import site_or_text
    from webgym.tasks import read_tasks

    found = read_tasks(file)
    console = Console()
    table = Table(box=None, header_style="dim")
    table.add_column("domain")
    table.add_column("subdomain")
    for level in LEVELS:
        table.add_column(level, justify="right")
    counts = Counter((task.domain, task.subdomain, task.level) for task in found.tasks)
    for domain, subdomain in sorted({key[:2] for key in counts}):
        names = (Text(plain(name)) for name in (domain, subdomain))
        table.add_row(*names, *(str(counts[domain, subdomain, level]) for level in LEVELS))
    console.print(table)
    websites = len({site_or_text(task.website) for task in found.tasks})
    console.print(f"{len(found.tasks)} tasks on {websites} websites, {len(found.broken)} broken records")
    tell_set_aside(found.set_aside)
    for record in found.broken:
        console.print(str(record), highlight=False, markup=False, soft_wrap=True)
    if found.broken:
        raise typer.Exit(EXIT_USAGE)
