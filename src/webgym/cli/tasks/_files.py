"""Task files as the sub-verbs take them: several at once."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from webgym.core.errors import TaskFileError
from webgym.core.task import Task
from webgym.tasks.files import BrokenRecord
from webgym.tasks.formats import read_tasks

_NAMED = 5


@dataclass(frozen=True)
class Held:
    """What files hold together: the tasks, in order, the records that are none, and what nobody can judge."""

    tasks: list[Task]
    broken: list[BrokenRecord]
    set_aside: list[BrokenRecord]

    def tell_left_out(self) -> None:
        """Say on stderr what was skipped or set aside, if anything was."""
        tell_set_aside(self.set_aside)
        for record in self.broken[:_NAMED]:
            print(record, file=sys.stderr)
        if len(self.broken) > _NAMED:
            print(f"and {len(self.broken) - _NAMED:,} more broken records", file=sys.stderr)


def tell_set_aside(records: Sequence[BrokenRecord]) -> None:
    """Say on stderr how many tasks were set aside because they have no fact to judge."""
    if records:
        told = f"set aside {len(records):,} tasks without a fact to judge; the first: {records[0]}"
        print(told, file=sys.stderr)


def read_all(files: Iterable[Path]) -> Held:
    """Read task files and folders of them. A file named ``train`` or ``test`` splits tasks that do not say.

    Raises:
        TaskFileError: one cannot be read or holds no task.
    """
    held = Held([], [], [])
    for path in files:
        found = read_tasks(path)
        held.tasks.extend(found.tasks)
        held.broken.extend(found.broken)
        held.set_aside.extend(found.set_aside)
    return held


def with_own_ids(files: Sequence[Path]) -> list[Task]:
    """As :func:`read_all`, for what needs every id once; what is broken or set aside is told.

    Raises:
        TaskFileError: as there; or an id stands in two files.
    """
    held = read_all(files)
    held.tell_left_out()
    seen: set[str] = set()
    for task in held.tasks:
        if task.id in seen:
            raise TaskFileError(
                f"the id {task.id!r} stands in two of the files",
                hint="webgym tasks validate names all of them",
            )
        seen.add(task.id)
    return held.tasks
