"""Choosing tasks."""

from __future__ import annotations

import random
from collections.abc import Iterable
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
