"""``webgym view``: browse a run, also while it goes on."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from webgym.report.config import ViewConfig
from webgym.report.live import serve_view


def command(
    run: Annotated[Path, typer.Argument(help="The run folder.")],
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes a free one.", min=0, max=65535)] = 0,
    is_opened: Annotated[bool, typer.Option("--open/--no-open", help="Open it in a browser.")] = True,
) -> None:
    """Serve the pages of RUN on this machine alone, and print the address. Ctrl-C ends it."""

    def ready(address: str) -> None:
        typer.echo(address)
        if is_opened and _has_desktop():
            webbrowser.open(address)

    with contextlib.suppress(KeyboardInterrupt):  # the way to end it
        asyncio.run(serve_view(run, ViewConfig(port=port), ready))


def _has_desktop() -> bool:
    """Whether a browser would open in a window; one for terminals would take ours over."""
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
