"""``webgym compare``: compare the success of two runs, and test whether it differs by more than chance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console

from webgym.core.tables import Table, markdown, show
from webgym.core.text import plain
from webgym.results.evaluation import Comparison, Difference, compare
from webgym.store.runs import RECORDED


def command(
    first: Annotated[Path, typer.Argument(help="A run folder.")],
    second: Annotated[Path, typer.Argument(help="Another run folder, over the same tasks.")],
    judge: Annotated[
        str, typer.Option(help="Judge whose verdicts count; recorded is the judge of the collection.")
    ] = (RECORDED),
    as_json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
    as_markdown: Annotated[bool, typer.Option("--markdown", help="Print the table as Markdown.")] = False,
) -> None:
    """Compare the success of two runs, task by task, with a 95 % interval (paired bootstrap) and
    an exact permutation test over the tasks; a run is better only if both say so.

    Only tasks with a reward in both runs are compared; the number of others is printed.
    """
    result = compare(first, second, judge)
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(result), indent=2).decode())
        return
    if as_markdown:
        typer.echo(markdown([_table(result)]), nl=False)
    else:
        show([_table(result)], Console(highlight=False))
    for line in _conclusions(result):
        typer.echo(line)


def _table(result: Comparison) -> Table:
    header = ("", "tasks", result.first, result.second, "difference", "95 %", "better", "worse")
    return Table("Success, %", header, [(group, *_cells(row)) for group, row in result.rows.items()])


def _cells(row: Difference) -> tuple[str, ...]:
    if row.first is None or row.second is None or row.difference is None:
        return (str(row.tasks), "-", "-", "-", "-", "-", "-")
    spread = "-" if row.interval is None else f"{100 * row.interval[0]:+.1f} to {100 * row.interval[1]:+.1f}"
    rates = (f"{100 * row.first:.1f}", f"{100 * row.second:.1f}", f"{100 * row.difference:+.1f}")
    return (str(row.tasks), *rates, spread, str(row.better), str(row.worse))


def _conclusions(result: Comparison) -> list[str]:
    overall = result.rows["overall"]
    better = result.second if (overall.difference or 0) > 0 else result.first
    conclusion = f"{better} is better" if overall.is_decided else "the difference may be chance"
    exact = "" if overall.p_value is None else f" (exact permutation test: p = {overall.p_value:.2g})"
    lines = [f"overall: {conclusion}{exact}"]
    if left_out := [
        f"{count:,} task{'' if count == 1 else 's'} with a reward in {name} only"
        for count, name in ((result.only_first, result.first), (result.only_second, result.second))
        if count
    ]:
        lines.append(f"left out: {', '.join(left_out)}")
    return [*lines, *map(plain, result.notes)]
