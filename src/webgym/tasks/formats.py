"""Reads and writes task sets in every format.

=========== =============================== ===========================================================
format      file names                      contents
=========== =============================== ===========================================================
jsonl       ``.jsonl``, also ``.gz .zst``   WebGym's own JSON lines (:mod:`webgym.tasks.files`)
parquet     ``.parquet``                    a typed column per field (:mod:`webgym.tasks.parquet`)
published   ``.jsonl``, also ``.gz .zst``   the published data set (:mod:`webgym.tasks.published`)
=========== =============================== ===========================================================

When reading, the format is recognised by the contents; when writing, it is given by the file's name or by an
argument. A folder contains one file (``tasks.*``), or one per split (``train.*``, ``test.*``).
"""

from __future__ import annotations

import codecs
import io
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, get_args

from webgym.core.errors import TaskFileError
from webgym.core.task import Task
from webgym.tasks.files import (
    BYTE_ORDER_MARK,
    TaskCollector,
    TaskFile,
    gc_paused,
    opened,
    read_lines,
    whole_file,
    write_lines,
)
from webgym.tasks.hub import address_of, download
from webgym.tasks.published import decoded, looks_published, read_published, write_published
from webgym.tasks.split import Leak, leaking, leaks

Format: TypeAlias = Literal["jsonl", "parquet", "published"]
FORMATS: Final[tuple[Format, ...]] = get_args(Format)

_PARQUET: Final = b"PAR1"
_JSONL_SUFFIXES: Final = (".jsonl", ".jsonl.gz", ".jsonl.zst")
_SUFFIXES: Final = (".parquet", *_JSONL_SUFFIXES)
"""Suffixes of task files; of two files that differ only in the suffix, the one that comes first here is
read."""
_WIDE_MARKS: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE, codecs.BOM_UTF32_BE)
"""How text in UTF-16 or UTF-32 begins; that of UTF-32 LE begins as UTF-16 LE does."""
_LONGEST_LINE: Final = 2**23
"""Bytes; a longer line is skipped."""
_SPLITS: Final[tuple[Literal["train", "test"], ...]] = ("train", "test")


def read_tasks(path: Path | str) -> TaskFile:
    """Read a task file, or the task files of a folder, in any format.

    A broken record is reported and skipped, and a task without a fact to judge is set aside.
    Tasks without a split get the one in the file's name, ``train`` or ``test``, if there is one. A
    task that leaks a test task which is skipped or set aside (:func:`webgym.tasks.split.leaks`) counts as
    broken unless it leaks another one as well, because nothing else would keep it out of training.

    Args:
        path: of a file or a folder, or an address on the hub (:mod:`webgym.tasks.hub`).

    Raises:
        TaskFileError: it cannot be read, or contains no task.
    """
    collector = TaskCollector()
    with gc_paused():
        for file in _files(path):
            _read(file, collector)
        for leak in leaks_of_withheld(list(collector.tasks.values()), collector.withheld):
            collector.leave_out(leak.task, f"{leak}, which is left out")
    if not collector.tasks:
        raise TaskFileError(
            f"{path} contains no task{_why_none(collector)}",
            hint="webgym tasks sources lists the benchmarks whose own files webgym tasks build reads; "
            "webgym eval --benchmark evaluates on some as they are"
            if collector.broken
            else "",
        )
    tasks = list(collector.tasks.values())
    return TaskFile(tasks, collector.broken, collector.set_aside, collector.withheld)


def leaks_of_withheld(tasks: Sequence[Task], withheld: Sequence[Task]) -> list[Leak]:
    """The tasks that leak test tasks which are not among them, and so must be left out; those that leak one
    of the tasks are not in the list."""
    found = leaks(tasks, withheld) if withheld else []
    leaked = leaking(tasks) if found else {}
    return [leak for leak in found if leak.task.id not in leaked]


def _why_none(collector: TaskCollector) -> str:
    if collector.set_aside:
        count = len(collector.set_aside)
        return f" that can be judged: {count:,} have no fact to judge; the first: {collector.set_aside[0]}"
    return f"; the first broken record: {collector.broken[0]}" if collector.broken else ", it is empty"


def write_tasks(path: Path | str, tasks: Iterable[Task], *, format: Format | None = None) -> int:
    """Write tasks atomically; the number of tasks written.

    Args:
        path: a file; or a folder (an existing one, or a name without a suffix), which gets a file per split.
            It must hold no other task files (see :func:`refuse_others`).
        tasks: the tasks to write.
        format: ``None`` takes the format from a file's name, and ``"jsonl"`` for a folder.

    Raises:
        TaskFileError: it cannot be written, name and format do not match, or a task to be written to a folder
            has no split; or the folder holds other task files.
    """
    path = Path(path)
    if not path.is_dir() and path.suffix:
        return _write(path, tasks, format or _format_of(path))
    ending = ".parquet" if format == "parquet" else ".jsonl"
    files: dict[str, Path] = {split: path / f"{split}{ending}" for split in _SPLITS}
    refuse_others(path, [file.name for file in files.values()])
    parts: dict[str, list[Task]] = {split: [] for split in _SPLITS}
    for task in tasks:
        if task.split is None:
            raise TaskFileError(
                f"a folder gets a file per split, and the task {task.id!r} has none",
                hint="split the tasks first, or name a file such as tasks.parquet",
            )
        parts[task.split].append(task)
    for split, part in parts.items():
        if part:
            _write(files[split], part, format or "jsonl")
        else:
            _delete(files[split])
    return sum(map(len, parts.values()))


def refuse_others(folder: Path, names: Collection[str]) -> None:
    """Refuse to write these task files to a folder in which others would be read with them or in their place.

    Raises:
        TaskFileError: there are others.
    """
    files = _task_files_in_any_format(folder) if folder.is_dir() else []
    if others := ", ".join(file.name for file in files if file.name not in names):
        raise TaskFileError(
            f"{folder} holds other task files, which would be read in place of the new ones: {others}",
            hint="write to another folder, or delete them",
        )


# --- one file ---------------------------------------------------------------------------------------


def _read(path: Path, collector: TaskCollector) -> None:
    collector.split = split_of(path)  # for WebGym's own formats only
    with opened(path) as file:
        if file.peek(4).startswith(_WIDE_MARKS):
            raise TaskFileError(
                f"{path} is written in UTF-16 or UTF-32", hint="save it as UTF-8, e.g. with iconv -t UTF-8"
            )
        if file.peek(len(_PARQUET)).startswith(_PARQUET):
            from webgym.tasks.parquet import read_parquet  # importing pyarrow takes long

            read_parquet(path, split_of(path), collector)
            return
        beginning: list[bytes] = []
        remaining = _lines(file, path, collector)
        is_published = _is_published(remaining, beginning)
        lines = chain(beginning, remaining)
        if is_published:
            collector.split = None
            read_published(lines, path, split_of(path), collector)
        else:
            read_lines(lines, path, collector)


def _lines(file: io.BufferedReader[Any], path: Path, collector: TaskCollector) -> Iterator[bytes]:
    """The lines of a file. Lines longer than :data:`_LONGEST_LINE` are skipped without holding them in
    memory."""
    for number in count(1):
        line = file.readline(_LONGEST_LINE)
        if not line:
            return
        if len(line) == _LONGEST_LINE and not line.endswith(b"\n"):
            length, part = len(line), line
            while part and not part.endswith(b"\n"):
                part = file.readline(_LONGEST_LINE)
                length += len(part)
            collector.skip(path, number, f"it has {length:,} bytes, and at most {_LONGEST_LINE:,} are taken")
            line = b"\n"
        yield line


def _write(path: Path, tasks: Iterable[Task], format: Format) -> int:
    if (format == "parquet") != (path.suffix == ".parquet"):
        raise TaskFileError(
            f"{path.name} is not a valid file name for the format {format}",
            hint="only Parquet files end in .parquet",
        )
    with whole_file(path) as file:
        if format == "parquet":
            from webgym.tasks.parquet import write_parquet

            return write_parquet(file, tasks)
        if format == "published":
            return write_published(file, tasks, split_of(path))
        return write_lines(file, tasks)


def _delete(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise TaskFileError(
            f"cannot delete {path}, which is of an older task set: {error.strerror or error}",
            hint="delete it, as it would be read with the new one or in place of it",
        ) from error


def _format_of(path: Path) -> Format:
    if path.suffix == ".parquet":
        return "parquet"
    if path.name.endswith(_JSONL_SUFFIXES):
        return "jsonl"
    raise TaskFileError(
        f"the file name {path.name} has no known suffix", hint=f"use one of {', '.join(_SUFFIXES)}"
    )


def _is_published(lines: Iterator[bytes], beginning: list[bytes]) -> bool:
    """Whether the first JSON object among the lines is a published row. Appends the lines it reads to
    ``beginning``."""
    for line in lines:
        beginning.append(line)
        try:
            record = decoded(line.removeprefix(BYTE_ORDER_MARK))
        except (ValueError, RecursionError):
            continue
        if isinstance(record, dict):
            return looks_published(record)
    return False


def split_of(path: Path) -> Literal["train", "test"] | None:
    """The split in a file's name: ``test.jsonl``, ``train-00000-of-00002.parquet``; ``None`` if there is
    none."""
    for split in _SPLITS:
        if path.name.startswith(split) and not path.name[len(split) : len(split) + 1].isalnum():
            return split
    return None


# --- folders ----------------------------------------------------------------------------------------


def task_files(folder: Path) -> list[Path]:
    """The task files of a folder: ``tasks.*`` if there is one, else those of the splits; may be empty."""
    return _of_a_set(_task_files_in_any_format(folder))


def _of_a_set(files: list[Path]) -> list[Path]:
    return _with_first_suffix([file for file in files if file.name.startswith("tasks.")])[:1] or [
        file
        for split in _SPLITS
        for file in _with_first_suffix([file for file in files if split_of(file) == split])
    ]


def _task_files_in_any_format(folder: Path) -> list[Path]:
    return sorted(
        file
        for file in folder.iterdir()
        if file.name.endswith(_SUFFIXES)
        and (file.name.startswith("tasks.") or split_of(file) is not None)
        and file.is_file()
    )


def _files(path: Path | str) -> list[Path]:
    if address := address_of(path):
        found = [file for file in download(address) if file.name.endswith(_SUFFIXES)]
        return _of_a_set(found) or found
    path = Path(path)
    if not path.is_dir():
        return [path]
    if files := task_files(path):
        return files
    raise TaskFileError(
        f"cannot read the task file {path}: it is a folder without tasks.*, train.* or test.*",
        hint=f"give a file, or rename it; known suffixes: {', '.join(_SUFFIXES)}",
    )


def _with_first_suffix(files: list[Path]) -> list[Path]:
    """The files with the first known suffix, so that tasks that exist in two formats are read once."""
    for ending in _SUFFIXES:
        if same := [file for file in files if file.name.endswith(ending)]:
            return same
    return []
