"""``webgym report``: write the report of a run or of a training."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from webgym.report.config import ReportConfig
from webgym.report.training import write_training_report
from webgym.report.write import write_report
from webgym.store.files import is_training

_DEFAULTS = ReportConfig()


def command(
    run: Annotated[Path, typer.Argument(help="Folder of a run or of a training.")],
    embed: Annotated[
        bool,
        typer.Option(
            "--embed/--no-embed",
            help="Embed screenshots in the file; otherwise it links to those in the run folder.",
        ),
    ] = _DEFAULTS.embed,
    width: Annotated[
        int, typer.Option(help="Width of embedded screenshots in pixels.", min=64)
    ] = _DEFAULTS.image_width,
    megabytes: Annotated[
        int,
        typer.Option(
            help="Maximum size of all embedded screenshots in MiB; further ones are linked to.", min=0
        ),
    ] = _DEFAULTS.image_budget_bytes // 2**20,
) -> None:
    """Write RUN/report.html, which needs no network access, and print its path."""
    config = ReportConfig(embed=embed, image_width=width, image_budget_bytes=megabytes * 2**20)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        bar = bars.add_task("trajectories", total=None)

        def show(what: str, done: int, total: int) -> None:
            bars.update(bar, description=what, completed=done, total=total or None)

        write = write_training_report if is_training(run) else write_report
        path = write(run, config=config, progress=show)
    typer.echo(path)
