"""Task files as the sub-verbs take them: several at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from webgym.core.errors import TaskFileError
from webgym.core.task import Task
from webgym.tasks import BrokenRecord, read_tasks
from webgym.tasks.formats import split_of

_NAMED = 5


@dataclass(frozen=True)
class Held:
    """What files hold together: the tasks, in order, and the records that are none."""

    tasks: list[Task]
    broken: list[BrokenRecord]

    def tell_broken(self) -> None:
        """Say on stderr what was skipped, if anything was."""
        import sys

        for record in self.broken[:_NAMED]:
            print(record, file=sys.stderr)
        if len(self.broken) > _NAMED:
            print(f"and {len(self.broken) - _NAMED:,} more broken records", file=sys.stderr)


def read_all(files: Iterable[Path]) -> Held:
    """Read task files and folders of them. A file named ``train`` or ``test`` splits tasks that do not say.

    Raises:
        TaskFileError: one cannot be read or holds no task.
    """
    held = Held([], [])
    for path in files:
        found = read_tasks(path)
        split = split_of(path)
        held.tasks.extend(
            msgspec.structs.replace(task, split=split) if split is not None and task.split is None else task
            for task in found.tasks
        )
        held.broken.extend(found.broken)
    return held


def with_own_ids(files: Sequence[Path]) -> list[Task]:
    """As :func:`read_all`, for what needs every id once; broken records are told and left out.

    Raises:
        TaskFileError: as there; or an id stands in two files.
    """
    held = read_all(files)
    held.tell_broken()
    seen: set[str] = set()
    for task in held.tasks:
        if task.id in seen:
            raise TaskFileError(
                f"the id {task.id!r} stands in two of the files",
                hint="webgym tasks validate names all of them",
            )
        seen.add(task.id)
    return held.tasks
