"""Reading of several task files at once, for the sub-verbs of ``webgym tasks``."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from webgym.core.errors import TaskFileError
from webgym.core.task import Task
from webgym.store.files import TRAJECTORIES
from webgym.tasks.files import BrokenRecord
from webgym.tasks.formats import leaks_of_withheld, read_tasks, task_files
from webgym.tasks.hub import address_of

_LIMIT = 5
"""Number of broken records that are printed."""


@dataclass(frozen=True)
class TaskRecords:
    """The records of several task files.

    Attributes:
        tasks: in the order of the files.
        broken: records that cannot be read as tasks.
        set_aside: tasks without a fact to judge, which are left out.
        withheld: what can be read of test tasks that are not among the tasks.
    """

    tasks: list[Task]
    broken: list[BrokenRecord]
    set_aside: list[BrokenRecord]
    withheld: list[Task] = field(default_factory=list)

    def print_left_out(self) -> None:
        """Print on stderr which records were left out, if there are any."""
        print_set_aside(self.set_aside)
        for record in self.broken[:_LIMIT]:
            print(record, file=sys.stderr)
        if len(self.broken) > _LIMIT:
            print(f"and {len(self.broken) - _LIMIT:,} more broken records", file=sys.stderr)


def has_tasks(path: Path) -> bool:
    """Whether a path is a task set: a file, a folder of task files that is no run (which has one, too), or an
    address on the hub."""
    if address_of(path):
        return True
    if path.is_dir():
        return not (path / TRAJECTORIES).is_dir() and bool(task_files(path))
    return path.is_file() or bool(path.suffix)


def print_set_aside(records: Sequence[BrokenRecord]) -> None:
    """Print on stderr how many tasks were set aside because they have no fact to judge."""
    if records:
        message = f"set aside {len(records):,} tasks without a fact to judge; the first: {records[0]}"
        print(message, file=sys.stderr)


def read_all(files: Iterable[Path]) -> TaskRecords:
    """Read task files, folders of them, and tasks with a name, such as ``offline-v2``.

    Tasks without a split get it from the name of their file, if that is ``train`` or ``test``.

    Raises:
        TaskFileError: a file cannot be read or contains no task.
    """
    from webgym.env.environment import config_of
    from webgym.offline.config import collection_of
    from webgym.run.choice import all_tasks

    records = TaskRecords([], [], [])
    for path in files:
        if collection_of(str(path)):
            tell = partial(print, file=sys.stderr)
            records.tasks.extend(all_tasks(config_of(str(path), "all"), tell))
            continue
        found = read_tasks(path)
        records.tasks.extend(found.tasks)
        records.broken.extend(found.broken)
        records.set_aside.extend(found.set_aside)
        records.withheld.extend(found.withheld)
    return records


def read_unique(files: Sequence[Path]) -> list[Task]:
    """Read tasks as :func:`read_all`, and print which records were left out: also those of one file that leak
    a test task of another which cannot be read or judged.

    Raises:
        TaskFileError: a file cannot be read or contains no task, or two tasks have the same id.
    """
    records = read_all(files)
    records.print_left_out()
    seen: set[str] = set()
    for task in records.tasks:
        if task.id in seen:
            raise TaskFileError(
                f"two tasks have the id {task.id!r}", hint="webgym tasks validate lists all of them"
            )
        seen.add(task.id)
    leaked = {leak.task.id: leak for leak in leaks_of_withheld(records.tasks, records.withheld)}
    for leak in leaked.values():
        print(f"left out: {leak}", file=sys.stderr)
    return [task for task in records.tasks if task.id not in leaked]
