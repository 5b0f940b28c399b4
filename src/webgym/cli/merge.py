"""``webgym merge``: merge the runs of collectors that shared one task list."""

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
        typer.Argument(
            help="The folder that was given to --share, or all run folders.", metavar="SHARED|RUN..."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the merged run to make.")],
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html.")] = True,
) -> None:
    """Merge the runs of collectors that shared one task list into one run.

    Attempts keep their records and pictures, and get new numbers. The given runs are not changed. Samples
    that no collector has finished can be attempted with webgym rollout --resume OUT.
    """
    folders = [run for path in runs for run in runs_in(path)]
    console = Console()
    columns = TextColumn("attempts"), BarColumn(), MofNCompleteColumn()
    progress_console = Console(stderr=True)
    with Progress(
        *columns, console=progress_console, transient=True, disable=not progress_console.is_terminal
    ) as bars:
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
        missing = f"{merged.missing:,} of {merged.samples:,} samples have no result"
        typer.echo(f"{missing}; attempt them: webgym rollout --resume {shlex.quote(str(out))} --retry-errors")
