"""Families: an original task and all tasks derived from it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from webgym.core.task import Task


class Member(Protocol):
    """A task of any type, with what its family depends on."""

    @property
    def id(self) -> str:
        """Its id."""

    @property
    def parent_id(self) -> str | None:
        """The id of the task that it was derived from."""


def roots_of(tasks: Iterable[Member]) -> dict[str, str]:
    """The id of the first ancestor of every derived task, by id; other tasks are their own root.

    A parent need not be among the tasks. Of tasks that are each other's ancestors, as in a broken file, the
    smallest id is the root.
    """
    parents = {task.id: task.parent_id for task in tasks if task.parent_id is not None}
    roots: dict[str, str] = {}
    for start in parents:
        trail: list[str] = []
        ancestor = start
        while ancestor in parents and ancestor not in roots and ancestor not in trail:
            trail.append(ancestor)
            ancestor = parents[ancestor]
        root = min(trail[trail.index(ancestor) :]) if ancestor in trail else roots.get(ancestor, ancestor)
        for descendant in trail:
            roots[descendant] = root
    return roots


def inherited(tasks: Iterable[Task], values: Mapping[str, str]) -> dict[str, str]:
    """The value of every task that has one or whose ancestor has one, by id: its own, else the nearest
    ancestor's.

    Args:
        tasks: ancestors are looked for among these.
        values: by id.
    """
    parents = {task.id: task.parent_id for task in tasks if task.parent_id is not None}
    found: dict[str, str | None] = dict(values)
    for start in parents:
        trail: dict[str, None] = {}
        ancestor = start
        while ancestor in parents and ancestor not in found and ancestor not in trail:
            trail[ancestor] = None
            ancestor = parents[ancestor]
        found |= dict.fromkeys(trail, found.get(ancestor))
    return {id: value for id, value in found.items() if value is not None}
