"""``webgym tasks``: task sets as files. One module per sub-verb."""

from __future__ import annotations

import typer

from webgym.cli.tasks.check import check
from webgym.cli.tasks.offline import offline
from webgym.cli.tasks.show import show
from webgym.cli.tasks.sources import sources

app = typer.Typer(no_args_is_help=True, help="List, check and write task sets.")

for _command in (offline, check, show, sources):
    app.command()(_command)
