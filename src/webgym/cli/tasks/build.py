"""``webgym tasks build``: from the sources' files to a split task set, in stages that can be resumed."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from webgym.cli._fields import Given, Options, takes
from webgym.tasks.construction import BuildConfig

if TYPE_CHECKING:
    from rich.console import Console

    from webgym.tasks.construction import BuildPaths, Estimate, FinishedBuild, PendingBatches


BUILD = Options(
    BuildConfig,
    {
        "--base-url": "model.base_url",
        "--model": "model.model",
        "--concurrency": "model.concurrency",
        "--test-size": "split.test_tasks",
        "--plaintext": "plaintext",
        "--budget": "budget.dollars",
        "--seed": "seed",
    },
)


@takes(settings=BUILD)
def build(
    *,
    out: Path = typer.Option(
        ..., "--out", help="Folder of the build; an unfinished build in it is continued."
    ),
    config: Path | None = typer.Option(
        None, "--config", help="YAML file of settings; the options below override it.", show_default=False
    ),
    source: list[str] = typer.Option(
        [], "--source", help="NAME=PATH of a source, as often as needed.", show_default=False
    ),
    settings: Given,
    limit: int | None = typer.Option(
        None, "--limit", min=1, help="Most tasks of each source.", show_default=False
    ),
    price: str | None = typer.Option(
        None,
        "--price",
        help="Dollars per million tokens: PROMPT,COMPLETION or PROMPT,CACHED,COMPLETION.",
        show_default=False,
    ),
    cache: Path | None = typer.Option(
        None, "--cache", help="File of paid replies.", show_default="OUT/replies.sqlite"
    ),
    batch: Path | None = typer.Option(
        None,
        "--batch",
        help="Folder for batch files of what has to be asked, in place of asking; import the results with "
        "webgym llm import, and give the command again.",
        show_default=False,
    ),
    dry_run: bool = typer.Option(False, "--dry-run", help="Estimate calls and cost; ask and write nothing."),
) -> None:
    """Build a task set: import, websites, rubrics, decomposition, duplicates, split, statistics.

    A build that was stopped for any reason continues when the same command is given again: no reply is
    paid for twice.
    """
    from rich.console import Console

    from webgym.cli import EXIT_INTERRUPTED, _run
    from webgym.core.errors import UsageError
    from webgym.tasks.construction import (
        BuildPaths,
        PendingBatches,
        StageProgress,
        read_config,
        run_batch,
        run_build,
        run_dry,
    )

    overrides = settings | {"sources": _sources(source), "prices": _prices(price)}
    chosen = read_config(config, overrides, at_most=limit)
    place = BuildPaths.of(out, cache)
    console = Console()
    stages = StageProgress(console)
    if dry_run and batch is not None:
        raise UsageError("--dry-run and --batch do not go together", hint="give one of them")
    if dry_run:
        with stages.shown():
            found = _run.run(lambda: run_dry(chosen, place, stages))
        _tell_estimate(found, console)
        return
    try:
        with stages.shown():
            if batch is None:
                done: FinishedBuild | PendingBatches = _run.run(lambda: run_build(chosen, place, stages))
            else:
                folder = batch
                done = _run.run(lambda: run_batch(chosen, place, folder, stages))
    except KeyboardInterrupt:
        print(
            "interrupted: what was paid for is kept, and the same command goes on from here", file=sys.stderr
        )
        raise typer.Exit(EXIT_INTERRUPTED) from None
    if isinstance(done, PendingBatches):
        _tell_batches(done, place, console)
    else:
        _tell_build(done, place, console)


def _sources(given: Sequence[str]) -> dict[str, dict[str, str]]:
    from webgym.core.errors import ConfigError

    sources = {}
    for each in given:
        name, equals, path = each.partition("=")
        if not equals or not name or not path:
            raise ConfigError(f"--source {each}: no NAME=PATH", hint="such as deepshop=data/deepshop")
        sources[name] = {"path": path}
    return sources


def _prices(given: str | None) -> dict[str, Any]:
    from webgym.llm.prices import Prices

    price = None if given is None else Prices.parse(given).of("*")
    return {} if price is None else {"*": price.model_dump()}


def _tell_estimate(found: Estimate, console: Console) -> None:
    from webgym.tables import Table, grid

    columns = ("stage", "tasks", "there", "calls", "prompt tokens", "reply tokens", "dollars")
    numbers = [
        (
            line.purpose,
            line.things,
            line.there,
            line.calls,
            line.prompt_tokens,
            line.reply_tokens,
            line.dollars,
        )
        for line in found.lines
    ]
    rows = [(*map(str, row[:-1]), _dollars(row[-1])) for row in numbers]
    sums = map(str, (found.calls, found.prompt_tokens, found.reply_tokens))
    rows.append(("all", "", "", *sums, _dollars(found.dollars)))
    console.print(grid(Table("", columns, rows)))
    for line in found.lines:
        if line.basis:
            console.print(
                f"{line.purpose} ({line.model}): {line.basis}", highlight=False, markup=False, soft_wrap=True
            )
    if found.dollars is None:
        console.print("no price is known: give --price, or `prices:` in the config", highlight=False)


def _dollars(value: float | None) -> str:
    return "?" if value is None else f"{value:,.2f}"


def _tell_batches(noted: PendingBatches, place: BuildPaths, console: Console) -> None:
    for file in noted.files:
        told = f"{file.path}  {file.requests:,} requests, about {file.prompt_tokens:,} prompt tokens"
        console.print(told, highlight=False, markup=False, soft_wrap=True)
    new = sum(file.requests for file in noted.files)
    console.print(
        f"\nwaiting  {noted.build.pending:,} replies, {new:,} of them asked for in the files above\n"
        f"next     webgym llm import {place.cache} RESULTS, and this command again",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


def _tell_build(finished: FinishedBuild, place: BuildPaths, console: Console) -> None:
    from webgym.tables import Table, grid

    build = finished.build
    rows: dict[str, list[Any]] = {}
    for row in build.accounting.rows:
        rows.setdefault(row.stage, []).append(row)
    cells = []
    for stage, of_stage in rows.items():
        reasons: dict[str, int] = {}
        for row in of_stage:
            for reason, count in row.lost.items():
                reasons[reason] = reasons.get(reason, 0) + count
        came, made, left = (sum(getattr(row, name) for row in of_stage) for name in ("came", "made", "left"))
        why = ", ".join(f"{reason} {count:,}" for reason, count in reasons.items())
        cells.append((stage, str(came), str(made), str(sum(reasons.values())), str(left), why))
    console.print(grid(Table("", ("stage", "in", "created", "removed", "out", "reasons for removal"), cells)))
    spent = finished.ledger.totals.all
    unpriced = f", {spent.unpriced:,} of them without a known price" if spent.unpriced else ""
    console.print(
        f"\npaid     ${spent.dollars:,.4f} for {spent.calls:,} calls{unpriced}, {spent.tokens:,} tokens",
        highlight=False,
        soft_wrap=True,
    )
    if may_pass := sum(failure.may_pass for failure in build.failures):
        console.print(
            f"failed   {may_pass:,} by the endpoint; run again to ask for them again", highlight=False
        )
    console.print(f"set      {place.out}", highlight=False, soft_wrap=True, markup=False)
