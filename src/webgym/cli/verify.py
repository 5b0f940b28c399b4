"""``webgym verify``: check that a run is complete and intact."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, TextColumn

from webgym.core.text import plain
from webgym.store.files import SET_ASIDE
from webgym.store.verify import verify


def command(
    run: Annotated[Path, typer.Argument(help="A run folder.")],
    set_aside: Annotated[
        bool, typer.Option("--set-aside", help=f"Move damaged records to RUN/{SET_ASIDE}.")
    ] = False,
) -> None:
    """Read every record and every picture of a run, and compare them with their checksums.

    Damaged records are listed with file, line and reason. With --set-aside they are moved away, and webgym
    rollout --resume RUN repeats those attempts. Exits with 1 if damaged records are left in the run.
    """
    console = Console(stderr=True)
    columns = TextColumn("{task.completed} {task.description} verified")
    with Progress(columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bars = {kind: progress.add_task(kind, total=None) for kind in ("pictures", "trajectories")}
        result = verify(
            run, set_aside=set_aside, progress=lambda kind, done: progress.update(bars[kind], completed=done)
        )
    for problem in result.problems:
        typer.echo(plain(str(problem)))
    typer.echo(f"{result.trajectories} trajectories and {result.pictures} pictures are intact")
    if not result.problems:
        return
    folder = shlex.quote(str(run))
    if result.is_whole:
        typer.echo(f"resume with: webgym rollout --resume {folder}")
        return
    count = len(result.problems)
    advice = f"; move damaged records away: webgym verify --set-aside {folder}"
    typer.echo(f"{count} problem{'s' * (count != 1)}{'' if set_aside else advice}")
    raise typer.Exit(1)
