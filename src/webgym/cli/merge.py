"""``webgym merge``: the runs of collectors that shared one task list, as one run."""

from __future__ import annotations

import asyncio
import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from webgym.cli._summary import print_summary
from webgym.report.write import write_report
from webgym.rollout.merging import merge_runs, runs_in


def command(
    runs: Annotated[
        list[Path],
        typer.Argument(help="The folder of --share, or run folders one by one.", metavar="SHARED|RUN..."),
    ],
    out: Annotated[Path, typer.Option(help="The merged run's folder.")],
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html, too.")] = True,
) -> None:
    """Merge the runs of collectors that shared one task list into one run.

    Attempts keep their records and pictures, and are numbered anew. The runs stay as they are. What no
    collector has finished is attempted with webgym rollout --resume OUT.
    """
    folders = [run for given in runs for run in runs_in(given)]
    console = Console()
    columns = TextColumn("attempts"), BarColumn(), MofNCompleteColumn()
    shown = Console(stderr=True)
    with Progress(*columns, console=shown, transient=True, disable=not shown.is_terminal) as bars:
        bar = bars.add_task("", total=None)
        merged = asyncio.run(
            merge_runs(
                folders, out, progress=lambda done, total: bars.update(bar, completed=done, total=total)
            )
        )
    print_summary(merged.summary, console)
    if report:
        write_report(out)
    typer.echo(f"{merged.attempts:,} attempts of {len(folders)} runs: {out}")
    if merged.missing:
        left = f"{merged.missing:,} of {merged.samples:,} samples have no result"
        typer.echo(f"{left}; webgym rollout --resume {shlex.quote(str(out))} --retry-errors attempts them")
