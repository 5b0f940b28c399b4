"""``webgym compare``: compare the success of two runs, and test whether it differs by more than chance."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from webgym.cli._print import AsJson, AsMarkdown, counted, print_json, print_tables, refuse_several
from webgym.core.tables import Table
from webgym.core.text import plain
from webgym.results.evaluation import Comparison, Difference, compare
from webgym.store.runs import RECORDED


def command(
    first: Annotated[Path, typer.Argument(help="A run folder.")],
    second: Annotated[Path, typer.Argument(help="Another run folder, over the same tasks.")],
    judge: Annotated[
        str, typer.Option(help="Judge whose verdicts count; recorded is the judge of the collection.")
    ] = (RECORDED),
    as_json: AsJson = False,
    as_markdown: AsMarkdown = False,
) -> None:
    """Compare the success of two runs, task by task, with a 95 % interval (paired bootstrap) and
    an exact permutation test over the tasks; a run is better only if both say so.

    Only tasks with a reward in both runs are compared; the number of others is printed.
    """
    refuse_several(json=as_json, markdown=as_markdown)
    result = compare(first, second, judge)
    if as_json:
        print_json(result)
        return
    print_tables([_table(result)], Console(highlight=False), as_markdown=as_markdown)
    for line in _conclusions(result):
        print(line)


def _table(result: Comparison) -> Table:
    header = ("", "tasks", result.first, result.second, "difference", "95 %", "better", "worse")
    return Table("Success, %", header, [(group, *_cells(row)) for group, row in result.rows.items()])


def _cells(row: Difference) -> tuple[str, ...]:
    if row.first is None or row.second is None or row.difference is None:
        return (str(row.tasks), "-", "-", "-", "-", "-", "-")
    spread = "-" if row.interval is None else f"{100 * row.interval[0]:+.1f} to {100 * row.interval[1]:+.1f}"
    rates = (f"{100 * row.first:.1f}", f"{100 * row.second:.1f}", f"{100 * row.difference:+.1f}")
    return (str(row.tasks), *rates, spread, str(row.better), str(row.worse))


def _conclusions(result: Comparison) -> Iterator[str]:
    overall = result.rows["overall"]
    better = result.second if (overall.difference or 0) > 0 else result.first
    conclusion = f"{better} is better" if overall.is_decided else "the difference may be chance"
    exact = "" if overall.p_value is None else f" (exact permutation test: p = {overall.p_value:.2g})"
    yield f"overall: {conclusion}{exact}"
    alone = ((result.only_first, result.first), (result.only_second, result.second))
    left_out = [f"{counted(count, 'task')} with a reward in {name} only" for count, name in alone if count]
    if left_out:
        yield f"left out: {', '.join(left_out)}"
    yield from map(plain, result.notes)
