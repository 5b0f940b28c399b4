"""``webgym verify``: check that a run is complete and intact."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, TextColumn

from webgym.core.text import plain
from webgym.rollout.files import SET_ASIDE
from webgym.rollout.verify import verify


def command(
    run: Annotated[Path, typer.Argument(help="A run folder.")],
    set_aside: Annotated[
        bool, typer.Option("--set-aside", help=f"Move what cannot be trusted to RUN/{SET_ASIDE}.")
    ] = False,
) -> None:
    """Read every record and every picture of a run and compare them with their checksums.

    What does not fit is named: file, line, reason. With --set-aside it is moved away, and webgym rollout
    --resume RUN makes those attempts anew. The exit code is 0 if the run is whole, also after that, else 1.
    """
    console = Console(stderr=True)
    columns = TextColumn("{task.completed} {task.description} verified")
    with Progress(columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        bars = {what: shown.add_task(what, total=None) for what in ("pictures", "trajectories")}
        found = verify(
            run, set_aside=set_aside, progress=lambda what, done: shown.update(bars[what], completed=done)
        )
    for problem in found.problems:
        typer.echo(plain(str(problem)))
    typer.echo(f"{found.trajectories} trajectories and {found.pictures} pictures are whole")
    if not found.problems:
        return
    folder = shlex.quote(str(run))
    if found.is_whole:
        typer.echo(f"resume with: webgym rollout --resume {folder}")
        return
    typer.echo(f"{len(found.problems)} problems; webgym verify --set-aside {folder} moves away what can be")
    raise typer.Exit(1)
