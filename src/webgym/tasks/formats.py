"""The one way to read and to write task sets, whatever the format.

=========== =============================== ===========================================================
format      names                           what it is
=========== =============================== ===========================================================
jsonl       ``.jsonl``, also ``.gz .zst``   WebGym's own JSON lines (:mod:`webgym.tasks.files`)
parquet     ``.parquet``                    a typed column per field (:mod:`webgym.tasks.parquet`)
published   ``.jsonl``, also ``.gz .zst``   the published data set (:mod:`webgym.tasks.published`)
=========== =============================== ===========================================================

Reading goes by what a file holds, writing by its name and by what is asked for. A folder holds one file
(``tasks.*``), or one per split (``train.*``, ``test.*``).
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from itertools import chain, count
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, get_args

from webgym.core.errors import TaskFileError
from webgym.core.task import Task
from webgym.tasks.files import (
    BYTE_ORDER_MARK,
    Findings,
    TaskFile,
    collector_paused,
    opened,
    read_lines,
    whole_file,
    write_lines,
)
from webgym.tasks.published import decoded, looks_published, read_published, write_published

Format: TypeAlias = Literal["jsonl", "parquet", "published"]
FORMATS: Final[tuple[Format, ...]] = get_args(Format)

_PARQUET: Final = b"PAR1"
_LINES: Final = (".jsonl", ".jsonl.gz", ".jsonl.zst")
_ENDINGS: Final = (".parquet", *_LINES)
"""What task files end in; of two files that differ in nothing else, the first counts."""
_LONGEST_LINE: Final = 2**23
"""Bytes of a line that is read."""
_SPLITS: Final[tuple[Literal["train", "test"], ...]] = ("train", "test")


def read_tasks(path: Path) -> TaskFile:
    """Read a task file, or the task files of a folder, in any format.

    A broken record is reported and skipped, and a task without a fact to judge is set aside; the rest loads.
    Tasks that do not say their split are of the one that the file's name tells, ``train`` or ``test``.

    Raises:
        TaskFileError: it cannot be read, or holds no task at all.
    """
    found = Findings()
    with collector_paused():
        for file in _files(path):
            _read(file, found)
    if not found.tasks:
        raise TaskFileError(f"{path} contains no task{_why_none(found)}")
    return TaskFile(list(found.tasks.values()), found.broken, found.set_aside)


def _why_none(found: Findings) -> str:
    if found.set_aside:
        count = len(found.set_aside)
        return f" that can be judged: {count:,} have no fact to judge; the first: {found.set_aside[0]}"
    return f"; the first record that is none: {found.broken[0]}" if found.broken else ", it is empty"


def write_tasks(path: Path, tasks: Iterable[Task], *, format: Format | None = None) -> int:
    """Write tasks, whole or not at all; the number of tasks written.

    Args:
        path: a file; or a folder (one that is there, or a name without an ending), which gets a file per
            split.
        tasks: to write.
        format: for a file, ``None`` goes by its name; for a folder it means ``"jsonl"``.

    Raises:
        TaskFileError: it cannot be written, name and format do not go together, or a folder is asked for
            and a task has no split.
    """
    if not path.is_dir() and path.suffix:
        return _write(path, tasks, format or _format_of(path))
    parts: dict[str, list[Task]] = {split: [] for split in _SPLITS}
    for task in tasks:
        if task.split is None:
            raise TaskFileError(
                f"a folder gets a file per split, and the task {task.id!r} has none",
                hint="split the tasks first, or name a file such as tasks.parquet",
            )
        parts[task.split].append(task)
    ending = ".parquet" if format == "parquet" else ".jsonl"
    return sum(
        _write(path / f"{split}{ending}", part, format or "jsonl") for split, part in parts.items() if part
    )


# --- one file ---------------------------------------------------------------------------------------


def _read(path: Path, found: Findings) -> None:
    found.split = split_of(path)  # for WebGym's own formats; the published one has its own say
    with opened(path) as file:
        if file.peek(len(_PARQUET)).startswith(_PARQUET):
            from webgym.tasks.parquet import read_parquet  # pyarrow takes its time to import

            read_parquet(path, split_of(path), found)
            return
        begin: list[bytes] = []
        whole = _bounded(file, path, found)
        is_published = _is_published(whole, begin)
        lines = chain(begin, whole)
        if is_published:
            found.split = None
            read_published(lines, path, split_of(path), found)
        else:
            read_lines(lines, path, found)


def _bounded(file: io.BufferedReader[Any], path: Path, found: Findings) -> Iterator[bytes]:
    """The lines of a file. One without end is left out, and never in memory: a task is a few kilobytes, and
    what decodes a line lets no other thread run."""
    for number in count(1):
        line = file.readline(_LONGEST_LINE)
        if not line:
            return
        if len(line) == _LONGEST_LINE and not line.endswith(b"\n"):
            length, part = len(line), line
            while part and not part.endswith(b"\n"):
                part = file.readline(_LONGEST_LINE)
                length += len(part)
            found.skip(path, number, f"it has {length:,} bytes, and at most {_LONGEST_LINE:,} are taken")
            line = b"\n"
        yield line


def _write(path: Path, tasks: Iterable[Task], format: Format) -> int:
    if (format == "parquet") != (path.suffix == ".parquet"):
        raise TaskFileError(
            f"{path.name} is no name for a file of the format {format}",
            hint="Parquet ends in .parquet, and nothing else does",
        )
    with whole_file(path) as file:
        if format == "parquet":
            from webgym.tasks.parquet import write_parquet

            return write_parquet(file, tasks)
        if format == "published":
            return write_published(file, tasks, split_of(path))
        return write_lines(file, tasks)


def _format_of(path: Path) -> Format:
    if path.suffix == ".parquet":
        return "parquet"
    if path.name.endswith(_LINES):
        return "jsonl"
    raise TaskFileError(
        f"{path.name} does not tell a format by its ending", hint=f"use one of {', '.join(_ENDINGS)}"
    )


def _is_published(lines: Iterator[bytes], begin: list[bytes]) -> bool:
    """Whether the first object among the lines is a published row. What was read is in ``begin``."""
    for line in lines:
        begin.append(line)
        try:
            record = decoded(line.removeprefix(BYTE_ORDER_MARK))
        except (ValueError, RecursionError):
            continue
        if isinstance(record, dict):
            return looks_published(record)
    return False


def split_of(path: Path) -> Literal["train", "test"] | None:
    """The split that a file's name tells: ``test.jsonl``, ``train-00000-of-00002.parquet``."""
    for split in _SPLITS:
        if path.name.startswith(split) and not path.name[len(split) : len(split) + 1].isalnum():
            return split
    return None


# --- folders ----------------------------------------------------------------------------------------


def task_files(folder: Path) -> list[Path]:
    """The task files of a folder: ``tasks.*`` if there is one, else those of the splits; maybe none."""
    files = sorted(each for each in folder.iterdir() if each.name.endswith(_ENDINGS) and each.is_file())
    return _alike([each for each in files if each.name.startswith("tasks.")])[:1] or [
        file for split in _SPLITS for file in _alike([each for each in files if split_of(each) == split])
    ]


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    if files := task_files(path):
        return files
    raise TaskFileError(
        f"cannot read the task file {path}: it is a folder without tasks.*, train.* or test.*",
        hint=f"name the file, or call it so; known endings: {', '.join(_ENDINGS)}",
    )


def _alike(files: list[Path]) -> list[Path]:
    """Those of the first known ending, so that tasks that are there in two formats are read once."""
    for ending in _ENDINGS:
        if same := [file for file in files if file.name.endswith(ending)]:
            return same
    return []
