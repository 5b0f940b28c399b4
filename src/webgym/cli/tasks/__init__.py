"""``webgym tasks``: task sets as files. One module per sub-verb."""

from __future__ import annotations

import typer

from webgym.cli.tasks.build import build
from webgym.cli.tasks.check import check
from webgym.cli.tasks.convert import convert
from webgym.cli.tasks.offline import offline
from webgym.cli.tasks.sample import sample
from webgym.cli.tasks.show import show
from webgym.cli.tasks.sources import sources
from webgym.cli.tasks.split import split
from webgym.cli.tasks.stats import stats
from webgym.cli.tasks.validate import validate

app = typer.Typer(no_args_is_help=True, help="List, check and write task sets.")

for _command in (build, offline, check, show, convert, sources, split, validate, sample, stats):
    app.command()(_command)
