"""Task sets as JSON lines: one :class:`webgym.core.task.Task` per line, in UTF-8."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import msgspec

from webgym.core.errors import TaskFileError
from webgym.core.task import Task

BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class BrokenRecord:
    """A line that is no task.

    Attributes:
        file: as it was given.
        line: from 1.
        reason: what is wrong with it.
    """

    file: Path
    line: int
    reason: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.reason}"


@dataclass(frozen=True)
class TaskFile:
    """What a file held: the tasks, and the records that were skipped and why."""

    tasks: list[Task]
    broken: list[BrokenRecord]


def read_tasks(path: Path) -> TaskFile:
    """Read a task file. A broken record is reported and skipped; the rest loads.

    Survives a byte-order mark, carriage returns, empty lines and a last line without an end.

    Raises:
        TaskFileError: the file cannot be read, or holds no task at all.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise TaskFileError(
            f"cannot read the task file {path}: {error.strerror}",
            hint="give a file of JSON lines, such as webgym tasks offline writes",
        ) from error
    decoder = msgspec.json.Decoder(Task)
    tasks: dict[str, Task] = {}
    broken: list[BrokenRecord] = []
    for number, line in enumerate(data.removeprefix(BYTE_ORDER_MARK).split(b"\n"), start=1):
        if not line.strip():
            continue
        try:
            task = decoder.decode(line)
        except ValueError as error:  # msgspec's errors and broken UTF-8 are ValueErrors
            broken.append(BrokenRecord(path, number, str(error)))
            continue
        if task.id in tasks:
            broken.append(BrokenRecord(path, number, f"a second task with the id {task.id!r}"))
        else:
            tasks[task.id] = task
    if not tasks:
        reason = f"; the first line that is none: {broken[0]}" if broken else ", it is empty"
        raise TaskFileError(f"{path} holds no task{reason}")
    return TaskFile(list(tasks.values()), broken)


def write_tasks(path: Path, tasks: Iterable[Task]) -> int:
    """Write a task file; the number of tasks written."""
    encoder = msgspec.json.Encoder()
    count = 0
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        for task in tasks:
            file.write(encoder.encode(task) + b"\n")
            count += 1
    return count
