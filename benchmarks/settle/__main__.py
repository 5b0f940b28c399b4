"""``python -m benchmarks.settle``: how often observations are final, and how late they are."""

from __future__ import annotations

import logging
from pathlib import Path

import typer
import uvloop
from benchmarks.command import check_writable
from benchmarks.command import run as run_command
from benchmarks.settle.trials import WAYS, SettleBench, as_json, chosen, misses, run, settle_tables
from rich.console import Console
from rich.progress import Progress

from webgym.core.errors import ConfigError
from webgym.core.tables import markdown, show


def command(
    rounds: int = typer.Option(3, "--rounds", min=1, help="Number of trials per page and way of waiting."),
    slots: int = typer.Option(4, "--slots", min=1, help="Number of parallel browsers."),
    seed: int = typer.Option(0, "--seed", help="Seed of the order and of the pace of each round."),
    page: list[str] = typer.Option(
        [], "--page", help="Page or group of pages. May be repeated.", show_default="all"
    ),
    way: list[str] = typer.Option([], "--way", help="Way of waiting. May be repeated.", show_default="all"),
    browser: Path | None = typer.Option(
        None, "--browser", help="Chromium executable.", show_default="search for one"
    ),
    json: Path | None = typer.Option(None, "--json", help="Write all trials to this JSON file."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print the tables as Markdown."),
) -> None:
    """Measure how often observations are final, and how late: ours, fixed pauses, load and network idle.

    Serves its own pages; needs nothing else. Takes about 25 minutes.
    """
    check_writable(json)
    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    unknown = [name for name in way if name not in WAYS]
    if unknown:
        raise ConfigError(f"unknown way of waiting {unknown[0]!r}", hint=f"choose one of {', '.join(WAYS)}")
    plan, pages, ways = SettleBench(rounds=rounds, seed=seed, slots=slots), chosen(page), way or list(WAYS)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("observations", total=rounds * len(pages) * len(ways))
        trials = uvloop.run(run(plan, pages, ways, browser, lambda _: progress.advance(bar)))
    if json is not None:
        json.write_bytes(as_json(plan, trials))
    tables = settle_tables(trials)
    if as_markdown:
        print(markdown(tables), end="")
    else:
        show(tables, Console())
    for one in ways:
        print(f"not always final with {one}: {', '.join(misses(trials, one)) or 'none'}")


if __name__ == "__main__":
    run_command(command)
