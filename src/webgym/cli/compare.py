"""``webgym compare``: compare the success of two runs, and test whether it differs by more than chance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from webgym.cli._print import AsJson, AsMarkdown, print_json, print_tables, refuse_several
from webgym.results.evaluation import compare
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
    print_tables(result.tables(), Console(highlight=False), as_markdown=as_markdown)
    for line in result.conclusions():
        print(line)
