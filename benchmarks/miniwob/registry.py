"""The registry of solvers by task."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeAlias

from benchmarks.miniwob.episode import Episode

Solver: TypeAlias = Callable[[Episode], Awaitable[None]]

SOLVERS: dict[str, Solver] = {}


def solves(*tasks: str) -> Callable[[Solver], Solver]:
    """A decorator that registers a solver of tasks, which are named by their pages."""

    def register(solver: Solver) -> Solver:
        SOLVERS.update(dict.fromkeys(tasks, solver))
        return solver

    return register
