"""Families of derived tasks. Duplicates, split and validation use these functions."""

from __future__ import annotations

from collections.abc import Iterable

from webgym.core.task import Task


def roots_of(tasks: Iterable[Task]) -> dict[str, str]:
    """The first ancestor of every derived task, by id; a task that is not in it is its own.

    A parent that is not among the tasks still ties its children together. Of tasks that are each other's
    ancestors, which only a broken file holds, the smallest id is the root.
    """
    parents = {task.id: task.parent_id for task in tasks if task.parent_id is not None}
    roots: dict[str, str] = {}
    for start in parents:
        trail: list[str] = []
        at = start
        while at in parents and at not in roots and at not in trail:
            trail.append(at)
            at = parents[at]
        root = min(trail[trail.index(at) :]) if at in trail else roots.get(at, at)
        for each in trail:
            roots[each] = root
    return roots
