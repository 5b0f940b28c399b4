"""``webgym merge``: merge the runs of collectors that shared one task list."""

from __future__ import annotations

import asyncio
import shlex
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from webgym.cli._checks import check_folder
from webgym.cli._options import WriteReport
from webgym.cli._print import bars
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
    report: WriteReport = True,
) -> None:
    """Merge the runs of collectors that shared one task list into one run.

    Attempts keep their records and pictures, and get new numbers. The given runs are not changed. Samples
    that no collector has finished can be attempted with webgym rollout --resume OUT.
    """
    check_folder(out)
    folders = [run for path in runs for run in runs_in(path)]
    with bars() as advance:
        merged = asyncio.run(merge_runs(folders, out, progress=partial(advance, "attempts")))
    print_summary(merged.summary, Console())
    if report:
        write_report(out)
    resume_it = f"webgym rollout --resume {shlex.quote(str(out))} --retry-errors"
    print(f"{merged}; attempt them: {resume_it}" if merged.missing else merged)
