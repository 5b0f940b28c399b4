"""``webgym tasks build``: build a split task set from the files of sources, in stages that can be resumed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from webgym.cli._fields import Given, Options, takes
from webgym.cli._options import Price
from webgym.cli._print import say
from webgym.core.errors import ConfigError, UsageError
from webgym.core.tables import show
from webgym.taskset.construction.config import BuildConfig

if TYPE_CHECKING:
    from webgym.taskset.construction.progress import StageProgress
    from webgym.taskset.construction.run import BuildPaths, FinishedBuild, PendingBatches


BUILD = Options(
    BuildConfig,
    {
        "--base-url": "model.base_url",
        "--model": "model.model",
        "--concurrency": "model.concurrency",
        "--test-size": "split.test_tasks",
        "--plaintext": "plaintext",
        "--critic": "writing.critic",
        "--budget": "budget.dollars",
        "--seed": "seed",
    },
)


@takes(settings=BUILD)
def build(
    *,
    out: Path = typer.Option(
        ..., "--out", help="Folder of the build. An unfinished build in it is continued."
    ),
    config: Path | None = typer.Option(
        None, "--config", help="YAML file of settings; the options below override it.", show_default=False
    ),
    source: list[str] = typer.Option(
        [], "--source", help="A source and its files: NAME=PATH. May be repeated.", show_default=False
    ),
    settings: Given,
    limit: int | None = typer.Option(
        None, "--limit", min=1, help="Maximum number of tasks per source.", show_default=False
    ),
    price: Price = None,
    cache: Path | None = typer.Option(
        None,
        "--cache",
        help="Database of replies, so that none is paid for twice.",
        show_default="OUT/replies.sqlite",
    ),
    batch: Path | None = typer.Option(
        None,
        "--batch",
        help="Write requests as batch files to this folder instead of sending them; import the results with "
        "webgym llm import, and run the command again.",
        show_default=False,
    ),
    dry_run: bool = typer.Option(
        False, "--dry-run", help="Only estimate calls and cost: send and write nothing."
    ),
) -> None:
    """Build a task set: import, websites, rubrics, decomposition, duplicates, split, statistics.

    A build that was stopped for any reason continues when the same command is run again: no reply is paid for
    twice.
    """
    from webgym.cli import _run
    from webgym.llm.prices import Prices
    from webgym.taskset.construction.config import read_config
    from webgym.taskset.construction.progress import StageProgress
    from webgym.taskset.construction.run import BuildPaths, PendingBatches, run_dry

    if dry_run and batch is not None:
        raise UsageError("--dry-run and --batch exclude each other", hint="give one of them")
    paid = None if price is None else Prices.parse(price).of("*")
    prices = {} if paid is None else {"*": paid.model_dump()}
    overrides = settings | {"sources": _sources(source), "prices": prices}
    chosen = read_config(config, overrides, at_most=limit)
    paths = BuildPaths.of(out, cache)
    console = Console()
    stages = StageProgress(console)
    if dry_run:
        with stages.shown():
            estimate = _run.run(lambda: run_dry(chosen, paths, stages))
        show(estimate.parts(), console)
        if estimate.dollars is None:
            say("the price is unknown: give --price, or `prices:` in the config", console)
        return
    result = _run_stages(chosen, paths, batch, stages)
    if isinstance(result, PendingBatches):
        next_command = f"webgym llm import {paths.cache} RESULTS, then this command again"
        say(f"{result}\nnext     {next_command}", console)
    else:
        show(result.parts(), console)
        say(f"set      {paths.out}", console)


def _run_stages(
    settings: BuildConfig, paths: BuildPaths, batch: Path | None, stages: StageProgress
) -> FinishedBuild | PendingBatches:
    """Run all stages, or with a folder for batches those that need no further replies."""
    from webgym.cli import _run
    from webgym.taskset.construction.run import run_batch, run_build

    with stages.shown():
        if batch is None:
            return _run.run(lambda: run_build(settings, paths, stages), kept="all replies are stored")
        return _run.run(lambda: run_batch(settings, paths, batch, stages), kept="all replies are stored")


def _sources(given: Sequence[str]) -> dict[str, dict[str, str]]:
    sources = {}
    for source in given:
        name, equals, path = source.partition("=")
        if not equals or not name or not path:
            raise ConfigError(f"--source {source!r} is not NAME=PATH", hint="such as deepshop=data/deepshop")
        sources[name] = {"path": path}
    return sources
