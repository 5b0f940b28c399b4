"""Which script solves which task."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeAlias

from benchmarks.miniwob.hand import Hand

Solver: TypeAlias = Callable[[Hand], Awaitable[None]]

SOLVERS: dict[str, Solver] = {}


def solves(*tasks: str) -> Callable[[Solver], Solver]:
    """Register a script for these tasks, named by their pages."""

    def register(solver: Solver) -> Solver:
        SOLVERS.update(dict.fromkeys(tasks, solver))
        return solver

    return register
