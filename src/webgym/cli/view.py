"""``webgym view``: browse a run, even while it is being collected, or a task set."""

from __future__ import annotations

import asyncio
import contextlib
import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._options import has_desktop
from webgym.cli.tasks._files import has_tasks
from webgym.core.settings import validated
from webgym.report.config import ViewConfig
from webgym.report.live import serve_view
from webgym.report.taskset import serve_tasks

VIEW = Options(
    ViewConfig,
    {
        "--port": "port",
        "--labels": Option("labels", default="RUN/labels.csv"),
        "--label-count": "label_count",
        "--label-seed": "label_seed",
    },
)


@takes(settings=VIEW)
def command(
    what: Annotated[
        Path, typer.Argument(help="A run folder, a task file of any format, or a folder with task files.")
    ],
    settings: Given,
    is_opened: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
) -> None:
    """Serve the pages of a run or of a task set on this machine only, and print the address.

    On the page /label of a run, people label trajectories for webgym judge agreement. Stops on Ctrl-C.
    """
    status = Console(stderr=True).status("reading")

    def ready(address: str) -> None:
        status.stop()
        print(address, flush=True)
        if is_opened and has_desktop():
            webbrowser.open(address)

    config = validated(ViewConfig, settings)
    with status, contextlib.suppress(KeyboardInterrupt):  # the normal way to stop it
        if has_tasks(what):
            asyncio.run(serve_tasks(what, config, ready))
        else:
            message = "reading {:,} trajectories of a file for the index"
            asyncio.run(serve_view(what, config, ready, lambda count: status.update(message.format(count))))
