"""Families: an original task and all tasks derived from it."""

from __future__ import annotations

from collections.abc import Iterable

from webgym.core.task import Task


def roots_of(tasks: Iterable[Task]) -> dict[str, str]:
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
