"""``python -m benchmarks.settle``: how often is an observation final, and how late?"""

from __future__ import annotations

import logging
from pathlib import Path

import typer
import uvloop
from benchmarks.command import expect_to_write
from benchmarks.command import run as run_command
from benchmarks.settle.trials import WAYS, SettleBench, as_json, chosen, misses, run, settle_tables
from rich.console import Console
from rich.progress import Progress

from webgym.core.errors import ConfigError
from webgym.tables import markdown, show


def command(
    rounds: int = typer.Option(3, "--rounds", min=1, help="Times that each page meets each way of waiting."),
    slots: int = typer.Option(4, "--slots", min=1, help="Browsers at once."),
    seed: int = typer.Option(0, "--seed", help="Of the order and of each round's pace."),
    page: list[str] = typer.Option(
        [], "--page", help="A page or a group of pages. May be repeated.", show_default="all"
    ),
    way: list[str] = typer.Option([], "--way", help="A way of waiting. May be repeated.", show_default="all"),
    browser: Path | None = typer.Option(None, "--browser", help="Chromium to run.", show_default="found"),
    json: Path | None = typer.Option(None, "--json", help="Write every observation here."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print Markdown, for a document."),
) -> None:
    """How often is an observation final, and how late? Ours against fixed pauses, load and network idle.

    Starts its own pages; needs nothing else. About 25 minutes in full.
    """
    expect_to_write(json)
    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    unknown = [one for one in way if one not in WAYS]
    if unknown:
        raise ConfigError(f"there is no way of waiting {unknown[0]!r}", hint=f"one of {', '.join(WAYS)}")
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
