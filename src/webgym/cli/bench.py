"""``webgym bench``: measure this machine. Every sub-verb is thin; the work is in ``webgym.bench``."""

from __future__ import annotations

import typer

app = typer.Typer(no_args_is_help=True, help="Measure this machine: figures of one run, as ratios.")


@app.callback()
def _bench() -> None:
    pass
