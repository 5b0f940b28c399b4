"""``webgym tasks probe``: ask every website of a task set whether it answers."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

import typer
from rich.console import Console

from webgym.cli import _options
from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._print import say
from webgym.cli.tasks._files import read_unique
from webgym.core.errors import UsageError
from webgym.core.tables import put
from webgym.run.config import RunConfig

SETTINGS = Options(
    RunConfig,
    {
        "--out": Option("health.file", help="File of what is found; it is continued if it exists."),
        "--sessions": "collector.sessions",
        "--server": "server.url",
    },
)
_LINE_SECONDS: Final = 10.0
"""How often a line says how far the probe is."""


@takes(settings=SETTINGS)
def probe(
    settings: Given,
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    rate: float = typer.Option(2.0, "--rate", min=0.001, help="Start pages to open per second, in all."),
    older_than: float | None = typer.Option(
        None,
        "--older-than",
        min=0,
        help="Ask again what was last asked so many hours ago.",
        show_default=False,
    ),
    robots: bool = typer.Option(
        False, "--robots", help="Open no start page that its robots.txt asks robots not to open."
    ),
    config: _options.Config = None,
    token_file: _options.TokenFile = None,
) -> None:
    """Open the start page of every website of a task set once, and count which still answer.

    At most one page of a website is open at a time. The same command continues a probe that was stopped or
    killed. Runs leave out what refuses or is dead if the file is their health.file.
    """
    from webgym.cli import _run
    from webgym.run.probe import probe as run

    chosen = _run.settings(config or (), settings)
    if chosen.health.file is None:
        raise UsageError("there is no file to write to", hint="give --out, such as --out sites.jsonl")
    tasks, console, last = read_unique(files), Console(stderr=True), 0.0

    def advance(done: int, total: int) -> None:
        nonlocal last
        if done == total or time.monotonic() - last > _LINE_SECONDS:
            last = time.monotonic()
            say(f"{done:,} of {total:,} hosts asked", console)

    found = _run.run(
        lambda: run(
            tasks,
            chosen,
            per_second=rate,
            older_than_hours=older_than,
            robots=robots,
            secrets=_run.secrets(token_file),
            tell=lambda line: say(line, console),
            advance=advance,
        ),
        kept=f"what was found is in {chosen.health.file}",
    )
    put(found, Console())
