"""``webgym verify``: check that a run is complete and intact."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from webgym.cli._print import bars
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
    with bars() as advance:
        result = verify(run, set_aside=set_aside, progress=advance)
    folder = shlex.quote(str(run))
    if not result.is_whole:
        advice = "" if set_aside else f"; move damaged records away: webgym verify --set-aside {folder}"
        print(f"{result}{advice}")
        raise typer.Exit(1)
    print(result)
    if result.problems:
        print(f"resume with: webgym rollout --resume {folder}")
