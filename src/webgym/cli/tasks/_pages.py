"""Tasks as text for a terminal: a row per task, or all of one task.

The text of tasks is foreign: control characters in it are replaced before it is printed.
"""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from webgym.core.task import FactGroup, Task
from webgym.core.text import plain
from webgym.tasks.index import TaskIndex, website_key

_LEVEL_COLORS = {"easy": "green", "medium": "yellow", "hard": "red"}


def row_of(task: Task) -> tuple[str, ...]:
    """A task as a row: id, number of facts, level, website, domain, instruction."""
    domain = " / ".join(filter(None, (task.domain, task.subdomain)))
    cells = (task.id, str(task.difficulty), task.level, website_key(task.website), domain, task.instruction)
    return tuple(map(plain, cells))


def page_of(task: Task, index: TaskIndex) -> RenderableType:
    """All of a task: instruction, rubric, origin, and the tasks that it was derived from or into."""
    return Group(*_parts(task, index))


def _parts(task: Task, index: TaskIndex) -> Iterator[RenderableType]:
    facts = f"{task.difficulty} {'fact' if task.difficulty == 1 else 'facts'}"
    yield Text.assemble((plain(task.id), "bold"), "  ", (task.level, _LEVEL_COLORS[task.level]), f", {facts}")
    yield Text(plain(" · ".join(filter(None, (task.website, task.domain, task.subdomain)))), style="dim")
    yield Padding(Text(plain(task.instruction)), (1, 0))
    for group in task.rubric.groups:
        yield from _group(group)
    yield Text()
    yield _about(task)
    yield from _family(task, index)
    if task.truth is not None:
        yield Text("\nsolution", style="dim")
        for move in task.truth.moves:
            yield Padding(Text(plain(repr(move))), (0, 0, 0, 2))


def _group(group: FactGroup) -> Iterator[RenderableType]:
    yield Text(f"{group.id}. {plain(group.description)}", style="bold")
    for fact in group.facts:
        bullet = Table.grid(padding=(0, 1, 0, 0))
        bullet.add_row("  -", Text(plain(fact)))
        yield bullet


def _about(task: Task) -> Table:
    properties = {
        "source": task.source,
        "split": task.split,
        "website": None if task.website_from == "given" else task.website_from,
        "flags": ", ".join(task.flags),
        "reference answer": task.reference_answer,
        "example answer": task.example_answer,
        **{name: str(value) for name, value in task.extra.items() if name != "published"},
    }
    table = Table.grid(padding=(0, 2, 0, 0))
    for name, value in properties.items():
        if value:
            table.add_row(Text(plain(name), style="dim"), Text(plain(value)))
    return table


def _family(task: Task, index: TaskIndex) -> Iterator[RenderableType]:
    """The task that this one was derived from, and the tasks derived from it, with their fact groups."""
    if task.parent_id is not None:
        parent = index.get(task.parent_id)
        yield Text("\nderived from", style="dim")
        yield _relative(parent) if parent else Text(f"  {plain(task.parent_id)} (not in this set)")
    if children := index.children(task.id):
        yield Text(f"\n{len(children)} tasks derived from it", style="dim")
        for child in children:
            yield _relative(child)


def _relative(task: Task) -> Table:
    groups = ", ".join(str(group.id) for group in task.rubric.groups)
    row = Table.grid(padding=(0, 2, 0, 0))
    row.add_row(
        Text(f"  {plain(task.id)}", style="cyan"), Text(f"groups {groups}"), Text(plain(task.instruction))
    )
    return row
