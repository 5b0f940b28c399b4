"""``webgym view``: browse a run, even while it is being collected, or a task set."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from webgym.report.config import ViewConfig
from webgym.report.live import serve_view
from webgym.report.taskset import serve_tasks
from webgym.store.files import TRAJECTORIES
from webgym.tasks.formats import task_files


def command(
    what: Annotated[
        Path, typer.Argument(help="A run folder, a task file of any format, or a folder with task files.")
    ],
    port: Annotated[int, typer.Option(help="Port to listen on; 0 for a free one.", min=0, max=65535)] = 0,
    is_opened: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
    labels: Annotated[
        Path | None,
        typer.Option("--labels", help="File of labels, .csv or .json.", show_default="RUN/labels.csv"),
    ] = None,
    label_count: Annotated[
        int,
        typer.Option(
            "--label-count", help="Number of trajectories to label, balanced over difficulty.", min=1
        ),
    ] = 80,
    label_seed: Annotated[
        int, typer.Option("--label-seed", help="Seed of the choice of trajectories to label.")
    ] = 0,
) -> None:
    """Serve the pages of a run or of a task set on this machine only, and print the address.

    On the page /label of a run, people label trajectories for webgym judge agreement. Stops on Ctrl-C.
    """

    status = Console(stderr=True).status("reading")

    def ready(address: str) -> None:
        status.stop()
        typer.echo(address)
        if is_opened and _has_desktop():
            webbrowser.open(address)

    config = ViewConfig(port=port, labels=labels, label_count=label_count, label_seed=label_seed)
    with status, contextlib.suppress(KeyboardInterrupt):  # the normal way to stop it
        if _has_tasks(what):
            asyncio.run(serve_tasks(what, config, ready))
        else:
            message = "reading {:,} trajectories of a file for the index"
            asyncio.run(serve_view(what, config, ready, lambda count: status.update(message.format(count))))


def _has_tasks(path: Path) -> bool:
    """Whether a path is a task set: a file, or a folder of task files that is no run (which has one, too)."""
    if path.is_dir():
        return not (path / TRAJECTORIES).is_dir() and bool(task_files(path))
    return path.is_file() or bool(path.suffix)


def _has_desktop() -> bool:
    """Whether a browser would open a window; a text browser would take over the terminal."""
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
