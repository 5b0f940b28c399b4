"""``webgym tasks show`` and ``sources``: list tasks, print one; list the benchmarks they come from."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.text import Text

from webgym.cli import EXIT_USAGE
from webgym.cli._print import say, say_some
from webgym.cli.tasks._files import print_set_aside, read_all
from webgym.core.errors import UsageError
from webgym.core.tables import Table, put
from webgym.core.text import counted, plain

if TYPE_CHECKING:
    from webgym.core.task import Task
    from webgym.tasks.index import TaskIndex, TaskQuery
    from webgym.tasks.sources import Read


def show(
    file: Path = typer.Argument(
        ..., help="Task file of any format, a folder of them, or the name of tasks, such as offline-v2."
    ),
    task_id: str | None = typer.Argument(None, help="Id of a task to print.", show_default=False),
    domain: str = typer.Option("", help="Only tasks of this domain.", show_default=False),
    subdomain: str = typer.Option("", help="Only tasks of this subdomain.", show_default=False),
    level: str = typer.Option("", help="Only tasks of this level: easy, medium or hard.", show_default=False),
    website: str = typer.Option("", help="Only tasks on this website: a host or a URL.", show_default=False),
    source: str = typer.Option("", help="Only tasks from this benchmark.", show_default=False),
    split: str = typer.Option("", help="Only tasks of this split: train or test.", show_default=False),
    flag: str = typer.Option("", help="Only tasks with this flag, such as dated.", show_default=False),
    text: str = typer.Option(
        "", help="Only tasks with these words in id, instruction, website or domain.", show_default=False
    ),
    page: int = typer.Option(1, min=1, help="With --limit: page of the list, counted from 1."),
    limit: int | None = typer.Option(None, min=1, help="Number of tasks per page.", show_default="all"),
) -> None:
    """List the tasks of a task set, or print one task with its rubric and the tasks it was derived from.

    In a terminal the list opens in the pager ($PAGER, else less); `webgym view` shows it in a web browser.
    In a pipe it consists of tab-separated lines: id, number of facts, level, website, domain, instruction.
    """
    from webgym.tasks.index import TaskIndex, TaskQuery

    records = read_all([file])
    index = TaskIndex(records.tasks)
    print_set_aside(records.set_aside)
    if records.broken:
        print(
            f"{len(records.broken)} broken records left out; webgym tasks check lists them", file=sys.stderr
        )
    if task_id is not None:
        _print_task(index, task_id, file)
        return
    query = TaskQuery(domain, subdomain, level, website, source, split, flag, text)
    found = index.find(query)
    if not found:
        raise UsageError(f"no task of {file} matches", hint=_hint(index, query))
    if limit is not None:
        pages = -(-len(found) // limit)
        if page > pages:
            raise UsageError(f"{len(found)} tasks have no page {page}", hint=f"there are {pages} pages")
        found = found[(page - 1) * limit : page * limit]
    _print_list(index, found)


def _print_task(index: TaskIndex, task_id: str, file: Path) -> None:
    task = index.get(task_id)
    if task is None:
        close = index.close_ids(task_id)
        hint = f"similar ids: {', '.join(close)}" if close else f"webgym tasks show {file} lists the ids"
        raise UsageError(f"there is no task {task_id!r} in {file}", hint=hint)
    for line in _page_of(task, index):  # foreign text: control characters in it are replaced
        print(line[: len(line) - len(line.lstrip())] + plain(line))


def _print_list(index: TaskIndex, positions: list[int]) -> None:
    rows = (_row_of(index.tasks[position]) for position in positions)
    if sys.stdin.isatty() and sys.stdout.isatty():
        import pydoc

        os.environ.setdefault("LESS", "-S")  # do not wrap lines
        lines = [f"{row[0]:<36}  {row[1]:>2}  {row[2]:<6}  {row[3]:<28}  {row[-1]}" for row in rows]
        pydoc.pager("\n".join(lines))
    else:
        _print_lines(map("\t".join, rows))


def _print_lines(lines: Iterable[str]) -> None:
    try:
        for line in lines:
            print(line)
        sys.stdout.flush()
    except BrokenPipeError:  # a reader such as head has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _hint(index: TaskIndex, query: TaskQuery) -> str:
    """The possible values of the first condition that no task meets."""
    from webgym.tasks.index import FACETS

    for facet in FACETS:
        value, known = getattr(query, facet), index.counts(facet)
        if value and value.casefold() not in map(str.casefold, known):
            return f"--{facet} is one of {', '.join(list(known)[:30])}" if known else f"no task has a {facet}"
    return "give fewer conditions"


def _row_of(task: Task) -> tuple[str, ...]:
    """A task as a row: id, number of facts, level, website, domain, instruction."""
    from webgym.tasks.index import website_key

    domain = " / ".join(filter(None, (task.domain, task.subdomain)))
    cells = (task.id, str(task.difficulty), task.level, website_key(task.website), domain, task.instruction)
    return tuple(map(plain, cells))


def _page_of(task: Task, index: TaskIndex) -> Iterator[str]:
    """Lines with all of a task: instruction, rubric, origin, and its relatives."""
    yield f"{task.id}  {task.level}, {counted(task.difficulty, 'fact')}"
    yield " · ".join(filter(None, (task.website, task.domain, task.subdomain)))
    yield from ("", task.instruction, "")
    for group in task.rubric.groups:
        yield f"{group.id}. {group.description}"
        yield from (f"  - {fact}" for fact in group.facts)
    properties = {
        "source": task.source,
        "split": task.split,
        "website": None if task.website_from == "given" else task.website_from,
        "flags": ", ".join(task.flags),
        "reference answer": task.reference_answer,
        "example answer": task.example_answer,
        **{name: str(value) for name, value in task.extra.items() if name != "published"},
    }
    yield ""
    yield from (f"{name}: {value}" for name, value in properties.items() if value)
    if task.parent_id is not None:
        parent = index.get(task.parent_id)
        yield from ("", "derived from")
        yield _relative(parent) if parent else f"  {task.parent_id} (not in this set)"
    if children := index.children(task.id):
        yield from ("", f"{len(children)} tasks derived from it", *map(_relative, children))
    if task.truth is not None:
        yield from ("", "solution", *(f"  {move!r}" for move in task.truth.moves))


def _relative(task: Task) -> str:
    groups = ", ".join(str(group.id) for group in task.rubric.groups)
    return f"  {task.id}  groups {groups}  {task.instruction}"


def sources(
    read: list[str] = typer.Option(
        [],
        "--read",
        metavar="NAME=WHERE",
        help="Count the tasks of a file, a folder or hub:OWNER/NAME[@REVISION][:SPLIT] of a source. "
        "Repeatable.",
    ),
    lines: int = typer.Option(
        20,
        "--lines",
        min=0,
        help="Maximum number of skipped records and of files without tasks to list per source.",
    ),
) -> None:
    """List the benchmarks that tasks come from; with --read, count tasks in files. Fails if one has none."""
    console = Console()
    if not read:
        _list(console)
        return
    without_tasks = False
    for name, location in [_name_and_location(option) for option in read]:
        without_tasks |= not _print_source(console, name, location, lines)
    if without_tasks:
        raise typer.Exit(EXIT_USAGE)


def _name_and_location(option: str) -> tuple[str, str]:
    from webgym.tasks.hub import address_of

    name, separator, location = option.partition("=")
    if not (separator and name and location):
        raise UsageError(f"--read {option!r} is not NAME=WHERE", hint="such as --read deepshop=PATH")
    return name.strip(), location if address_of(location) else str(Path(location).expanduser())


def _list(console: Console) -> None:
    from webgym.tasks.sources import SOURCES

    rows = [
        (source.name, source.licence, str(source.paper_tasks), str(source.paper_websites))
        for source in SOURCES.values()
    ]
    put(Table("", ("source", "licence", "tasks (paper)", "websites (paper)"), rows, names=2), console)


def _print_source(console: Console, name: str, location: str, lines: int) -> bool:
    """Read a source and print its counts; whether it contains any task."""
    from webgym.tasks.sources import SOURCES, read_source

    records = read_source(name, location)
    source = SOURCES[name]
    console.print(Text.assemble((name, "bold"), f"  {location}"), soft_wrap=True)
    for label, value in _counts(records, source.paper_tasks, source.paper_websites):
        say(f"  {label:<10} {value}", console)
    say_some(records.skipped, lines, console)
    say_some(records.passed_over, lines, console)
    return bool(records.tasks)


def _counts(records: Read, paper_tasks: int, paper_websites: int) -> Iterable[tuple[str, str]]:
    yield "records", f"{records.records:,}"
    yield "tasks", f"{len(records.tasks):,} (the paper's {paper_tasks:,})"
    yield "skipped", f"{len(records.skipped):,}"
    yield "websites", f"{records.websites():,} by registrable domain (the paper's {paper_websites:,})"
    for label, counts in (("website", records.websites_from()), ("flags", records.flags())):
        yield label, ", ".join(f"{count:,} {value}" for value, count in sorted(counts.items())) or "none"
    if records.passed_over:
        yield "no tasks", f"in {len(records.passed_over):,} files"
