"""``webgym tasks show``."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from webgym.tasks.index import TaskIndex, TaskQuery


def show(
    file: Path = typer.Argument(..., help="Task file of any format, or a folder of them."),
    task_id: str | None = typer.Argument(None, help="Id of a task, to see it whole.", show_default=False),
    domain: str = typer.Option("", help="Only tasks of this domain.", show_default=False),
    subdomain: str = typer.Option("", help="Only tasks of this subdomain.", show_default=False),
    level: str = typer.Option("", help="easy, medium or hard.", show_default=False),
    website: str = typer.Option("", help="Only tasks on this website: a host or a URL.", show_default=False),
    source: str = typer.Option("", help="Only tasks from this benchmark.", show_default=False),
    split: str = typer.Option("", help="train or test.", show_default=False),
    flag: str = typer.Option("", help="Only tasks with this flag, such as dated.", show_default=False),
    text: str = typer.Option(
        "", help="Words that stand in id, instruction, website or domain.", show_default=False
    ),
    page: int = typer.Option(1, min=1, help="Which page of the list, with --limit."),
    limit: int | None = typer.Option(None, min=1, help="Tasks per page.", show_default="all"),
) -> None:
    """Browse a task set, or print one task whole: its rubric, and what it was derived from.

    In a terminal the list opens in the pager ($PAGER, else less); `webgym view` browses it in a web browser.
    Into a pipe it is one line per task, tab-separated: id, facts, level, website, domain, instruction.
    """
    from webgym.cli.tasks._files import tell_set_aside
    from webgym.core.errors import UsageError
    from webgym.tasks.formats import read_tasks
    from webgym.tasks.index import TaskIndex, TaskQuery

    found = read_tasks(file)
    index = TaskIndex(found.tasks)
    tell_set_aside(found.set_aside)
    if found.broken:
        print(f"{len(found.broken)} broken records left out; webgym tasks check names them", file=sys.stderr)
    if task_id is not None:
        _one(index, task_id, file)
        return
    wanted = TaskQuery(domain, subdomain, level, website, source, split, flag, text)
    places = index.find(wanted)
    if not places:
        raise UsageError(f"no task of {file} fits", hint=_values(index, wanted))
    if limit is not None:
        pages = -(-len(places) // limit)
        if page > pages:
            raise UsageError(f"there is no page {page} of {len(places)} tasks", hint=f"there are {pages}")
        places = places[(page - 1) * limit : page * limit]
    _list(index, places)


def _one(index: TaskIndex, task_id: str, file: Path) -> None:
    from rich.console import Console

    from webgym.cli.tasks._pages import page_of
    from webgym.core.errors import UsageError

    task = index.get(task_id)
    if task is None:
        close = index.close_ids(task_id)
        hint = f"there is {', '.join(close)}" if close else f"webgym tasks show {file} lists what it holds"
        raise UsageError(f"there is no task {task_id!r} in {file}", hint=hint)
    Console(highlight=False, soft_wrap=not sys.stdout.isatty()).print(page_of(task, index))


def _list(index: TaskIndex, places: list[int]) -> None:
    from webgym.cli.tasks._pages import row_of

    rows = (row_of(index.tasks[place]) for place in places)
    if sys.stdin.isatty() and sys.stdout.isatty():
        import pydoc

        os.environ.setdefault("LESS", "-S")  # a line per task, however long it is
        lines = [f"{row[0]:<36}  {row[1]:>2}  {row[2]:<6}  {row[3]:<28}  {row[-1]}" for row in rows]
        pydoc.pager("\n".join(lines))
    else:
        _print(map("\t".join, rows))


def _print(lines: Iterable[str]) -> None:
    try:
        for line in lines:
            print(line)
        sys.stdout.flush()
    except BrokenPipeError:  # head has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _values(index: TaskIndex, wanted: TaskQuery) -> str:
    """What could have been asked for, of the first value that no task has."""
    from webgym.tasks.index import FACETS

    for facet in FACETS:
        value, known = getattr(wanted, facet), index.counts(facet)
        if value and value.casefold() not in map(str.casefold, known):
            return f"--{facet} is one of {', '.join(list(known)[:30])}" if known else f"none has a {facet}"
    return "ask for less"
