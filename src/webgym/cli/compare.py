"""``webgym compare``: whether one run is better than another by more than chance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console

from webgym.rollout.comparison import Comparison, Difference, compare
from webgym.rollout.rejudge import RECORDED
from webgym.tables import Table, markdown, show


def command(
    first: Annotated[Path, typer.Argument(help="A run folder.")],
    second: Annotated[Path, typer.Argument(help="Another, over the same tasks.")],
    judge: Annotated[str, typer.Option(help="Whose verdicts count: the collection's own, or a judge's.")] = (
        RECORDED
    ),
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    as_markdown: Annotated[bool, typer.Option("--markdown", help="Print a Markdown table.")] = False,
) -> None:
    """Compare the success of two runs, task by task, with a 95 % interval (paired bootstrap).

    Only tasks that have a reward in both runs are compared; how many do not is said.
    """
    found = compare(first, second, judge)
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(found), indent=2).decode())
        return
    if as_markdown:
        typer.echo(markdown([_table(found)]), nl=False)
    else:
        show([_table(found)], Console(highlight=False))
    for line in _told(found):
        typer.echo(line)


def _table(found: Comparison) -> Table:
    header = ("", "tasks", found.first, found.second, "difference", "95 %", "better", "worse")
    return Table("Success, %", header, [(group, *_cells(row)) for group, row in found.rows.items()])


def _cells(row: Difference) -> tuple[str, ...]:
    if row.first is None or row.second is None or row.difference is None:
        return (str(row.tasks), "-", "-", "-", "-", "-", "-")
    spread = "-" if row.interval is None else f"{100 * row.interval[0]:+.1f} to {100 * row.interval[1]:+.1f}"
    rates = (f"{100 * row.first:.1f}", f"{100 * row.second:.1f}", f"{100 * row.difference:+.1f}")
    return (str(row.tasks), *rates, spread, str(row.better), str(row.worse))


def _told(found: Comparison) -> list[str]:
    whole = found.rows["overall"]
    better = found.second if (whole.difference or 0) > 0 else found.first
    said = f"{better} is better" if whole.is_decided else "the difference may be chance"
    lines = [f"overall: {said}"]
    if left := [
        f"{count:,} tasks with a reward in {name} alone"
        for count, name in ((found.only_first, found.first), (found.only_second, found.second))
        if count
    ]:
        lines.append(f"left out: {', '.join(left)}")
    return lines
