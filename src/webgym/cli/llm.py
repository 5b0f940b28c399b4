"""``webgym llm``: the cost of model calls, and results of batches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from webgym.cli._options import Price, PriceFile, prices_of
from webgym.cli._print import say
from webgym.core.errors import UsageError
from webgym.core.tables import show
from webgym.core.text import plain

if TYPE_CHECKING:
    from webgym.llm.prices import Totals

app = typer.Typer(no_args_is_help=True, help="Report the cost of model calls, and import batch results.")


@app.command()
def usage(cache: Path = typer.Argument(..., help="Database of cached replies.")) -> None:
    """Print calls, tokens and cost of all runs that used a cache, by purpose and model."""
    from webgym.cli._run import run
    from webgym.llm.cache import ReplyCache

    async def totals() -> Totals:
        async with ReplyCache(_existing(cache)) as opened:
            return opened.totals

    show(run(totals).parts(), Console())


@app.command("import")
def import_(
    cache: Path = typer.Argument(..., help="Database of cached replies."),
    files: list[Path] = typer.Argument(
        ..., help="Result files of batches: replies and errors, in any order."
    ),
    price: Price = None,
    prices: PriceFile = None,
) -> None:
    """Store the results of batches in a cache. Fails if a request has no reply."""
    from webgym.cli._run import run
    from webgym.llm.cache import ReplyCache
    from webgym.taskset.batch import Imported, import_results

    table = prices_of(price, prices)

    async def read() -> Imported:
        async with ReplyCache(_existing(cache)) as opened:
            return await import_results(opened, files, table)

    result = run(read)
    console = Console(stderr=True)
    for line in result.unanswered:
        say(plain(str(line)), console)
    print(result)
    if result.unanswered:
        raise typer.Exit(1)


def _existing(cache: Path) -> Path:
    if not cache.is_file():
        raise UsageError(f"there is no file {cache}", hint="give the path of an existing cache")
    return cache
