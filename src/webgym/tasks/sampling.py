"""Choosing tasks."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from itertools import zip_longest
from typing import TypeVar

T = TypeVar("T")


def draw(tasks: Iterable[T], count: int | None, seed: int) -> list[T]:
    """``count`` of the tasks, uniformly and without replacement, in a seeded order.

    Args:
        count: ``None`` for all; more than there are gives all.
    """
    shuffled = list(tasks)
    random.Random(f"tasks/{seed}").shuffle(shuffled)
    return shuffled[:count]


def draw_spread(tasks: Iterable[T], count: int | None, seed: int, *, key: Callable[[T], str]) -> list[T]:
    """As :func:`draw`, but every group of tasks is drawn from before any is drawn from again.

    Args:
        key: the group of a task, such as its website.
    """
    groups: dict[str, list[T]] = {}
    for task in draw(tasks, None, seed):
        groups.setdefault(key(task), []).append(task)
    rounds = zip_longest(*groups.values())
    spread = [task for turn in rounds for task in turn if task is not None]
    return spread[:count]
