"""Opening task files, the results of reading them, and writing them atomically.

Also WebGym's own JSON lines format: one :class:`webgym.core.task.Task` per line, in UTF-8.
"""

from __future__ import annotations

import datetime
import gc
import gzip
import io
import os
import uuid
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from mimetypes import guess_type
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, cast

import msgspec
from msgspec.structs import replace

from webgym.core.errors import TaskFileError
from webgym.core.task import WHOLE_TASK, Rubric, Task, reference_of
from webgym.core.text import plain
from webgym.core.websites import start_url_problem
from webgym.tasks.missing_values import is_missing_value, is_no_fact

BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
_GZIP: Final = b"\x1f\x8b"
_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_BUFFER: Final = 1 << 20


@dataclass(frozen=True)
class BrokenRecord:
    """A record that is not a valid task, or a task that cannot be judged.

    Attributes:
        file: path of the file.
        line: line number, or row number of a Parquet file, from 1; its place or id in a benchmark's file.
        reason: what is wrong with it.
    """

    file: Path
    line: int | str
    reason: str

    def __str__(self) -> str:
        return plain(f"{self.file}:{self.line}: {self.reason}")


@dataclass(frozen=True)
class TaskFile:
    """The contents of a task file or a folder of them.

    Attributes:
        tasks: valid tasks that can be judged.
        broken: records that are not valid tasks, and why.
        set_aside: tasks that cannot be judged, because none of their facts has content.
        withheld: what can be read of test tasks that are not among the tasks.
    """

    tasks: list[Task]
    broken: list[BrokenRecord]
    set_aside: list[BrokenRecord] = field(default_factory=list)
    withheld: list[Task] = field(default_factory=list)


@dataclass
class TaskCollector:
    """Collects the tasks while files are read. An id may occur only once in all of them: the first task with
    it counts, but a test task before any other.

    Attributes:
        tasks: valid tasks by id.
        broken, set_aside: as in :class:`TaskFile`.
        withheld: what can be read of test tasks that are not among the tasks. Nothing that leaks them may be
            trained on.
        split: of tasks without a split of their own, in the file that is being read.
    """

    tasks: dict[str, Task] = field(default_factory=dict)
    broken: list[BrokenRecord] = field(default_factory=list)
    set_aside: list[BrokenRecord] = field(default_factory=list)
    withheld: list[Task] = field(default_factory=list)
    split: Literal["train", "test"] | None = None
    _places: dict[str, tuple[Path, int | str]] = field(default_factory=dict)

    def add(self, file: Path, line: int | str, task: Task) -> bool:
        """Add a task; whether it was added. It is not if it cannot be attempted or judged or its id is in
        use."""
        if task.split is None and self.split is not None:
            task = replace(task, split=self.split)
        is_added = self._add(file, line, task)
        if not is_added and task.split == "test":
            self.withheld.append(task)
        return is_added

    def _add(self, file: Path, line: int | str, task: Task) -> bool:
        if why := unfit(task):
            self.skip(file, line, why)
            return False
        judged = _judgeable(task)
        if judged is None:
            self.set_aside.append(BrokenRecord(file, line, f"{task.id} has no fact to judge"))
            return False
        kept = self.tasks.get(judged.id)
        if kept is not None and (judged.split != "test" or kept.split == "test"):
            self.skip(file, line, f"a second task with the id {task.id!r}")
            return False
        if kept is not None:  # nothing may be trained on a test task
            self.skip(*self._places[judged.id], f"the id {task.id!r} is that of a test task, too")
        self.tasks[judged.id], self._places[judged.id] = judged, (file, line)
        return True

    def leave_out(self, task: Task, reason: str) -> None:
        """Leave out a task that was added."""
        self.skip(*self._places[task.id], reason)
        del self.tasks[task.id]

    def skip(self, file: Path, line: int | str, reason: object, record: object = None) -> None:
        """Note a record that is not a valid task.

        Args:
            file, line: its place.
            reason: what is wrong with it.
            record: its fields by name, as far as they can be read.
        """
        self.broken.append(BrokenRecord(file, line, str(reason)))
        if not isinstance(record, dict):
            return
        split = record.get("split")
        if split not in ("train", None) or (split is None and self.split == "test"):  # "Test" is no train
            names = ("id", "website", "parent_id")
            told: dict[str, Any] = {"id": f"{file.name}:{line}", "website": ""}
            told |= {name: record[name] for name in names if isinstance(record.get(name), str)}
            task = Task(instruction="", domain="", subdomain="", rubric=WHOLE_TASK, source="", **told)
            self.withheld.append(task)


NONE_FACT: Final = "none-fact"
"""Flag: a fact without content ("None", "N/A": a missing value written as text) was left out."""
NEEDS_PICTURES: Final = "needs-pictures"
"""Flag: the record has a picture, which belongs to the task and is not shown to the agent."""
NO_FACTS: Final = "no-facts"
"""Flag: no fact has content, and the instruction stands in for one. Nothing can be judged, so readers of task
files set the task aside."""


def _judgeable(task: Task) -> Task | None:
    """The task without facts and reference answers that mean "none"; ``None`` if no fact has content.

    Judging such a fact or answer would give an arbitrary reward.
    """
    if NO_FACTS in task.flags:
        return None
    if any(is_no_fact(fact) for group in task.rubric.groups for fact in group.facts):
        filtered = [
            (group, tuple(fact for fact in group.facts if not is_no_fact(fact)))
            for group in task.rubric.groups
        ]
        groups = tuple(replace(group, facts=facts) for group, facts in filtered if facts)
        if not groups:
            return None
        flags = dict.fromkeys((*task.flags, NONE_FACT))
        task = replace(task, rubric=Rubric(groups), flags=tuple(flags))
    if task.reference_answer is not None and reference_of(task.reference_answer) is None:
        task = replace(task, reference_answer=None)
    return task


@contextmanager
def gc_paused() -> Iterator[None]:
    """Disable garbage collection inside of this context: it would scan all tasks repeatedly while they are
    loaded."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def refuse_device(path: Path) -> None:
    """Refuse a device such as ``/dev/zero``, which may never end. A pipe is read to its end.

    Raises:
        TaskFileError: it is one.
    """
    if path.is_char_device():
        raise TaskFileError(f"{path} is a device", hint="give a file")


@contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader[Any]]:
    """Open a file for reading, decompressed if its first bytes are those of gzip or zstd.

    Raises:
        TaskFileError: it cannot be opened, or not be read inside of this context.
    """
    refuse_device(path)
    try:
        with ExitStack() as stack:
            file = stack.enter_context(io.BufferedReader(path.open("rb", buffering=0), _BUFFER))
            magic = file.peek(4)
            if magic.startswith(_GZIP):
                yield io.BufferedReader(gzip.GzipFile(fileobj=file), _BUFFER)
            elif magic.startswith(_ZSTD):
                from pyarrow import CompressedInputStream

                yield io.BufferedReader(stack.enter_context(CompressedInputStream(file, "zstd")), _BUFFER)
            else:
                yield file
    except (OSError, EOFError, zlib.error) as error:  # pyarrow raises OSError, gzip any of these
        raise TaskFileError(
            f"cannot read the task file {path}: {getattr(error, 'strerror', None) or error}",
            hint="give a file of JSON lines or Parquet, such as webgym tasks offline writes",
        ) from error


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Write a file atomically: it gets its name once it is complete and on disk.

    It is compressed if the name ends in ``.gz`` or ``.zst``; the same content gives the same bytes.

    Raises:
        TaskFileError: it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb", buffering=_BUFFER) as file, ExitStack() as stack:
            yield _compressed(path, file, stack)
        _sync(temporary)
        temporary.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise TaskFileError(
            f"cannot write {path}: {error.strerror or error}", hint="choose another place or free some space"
        ) from error
    finally:
        with suppress(OSError):  # a read-only file system refuses even to look for it
            temporary.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Flush a file's content, or a folder's entries, to disk."""
    opened_again = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened_again)
    finally:
        os.close(opened_again)


def _compressed(path: Path, file: BinaryIO, stack: ExitStack) -> BinaryIO:
    if path.suffix == ".gz":  # without name and time, for reproducible bytes
        zipped = gzip.GzipFile("", "wb", compresslevel=6, fileobj=file, mtime=0)
        return cast(BinaryIO, stack.enter_context(zipped))
    if path.suffix == ".zst":
        from pyarrow import CompressedOutputStream

        return cast(BinaryIO, stack.enter_context(CompressedOutputStream(file, "zstd")))
    return file


def read_lines(lines: Iterable[bytes], file: Path, collector: TaskCollector) -> None:
    """Read tasks in WebGym's own JSON lines format.

    Accepts a byte-order mark, carriage returns, empty lines and a last line without a line end.
    """
    decode, keys_of = msgspec.json.Decoder(Task).decode, msgspec.json.Decoder(dict[str, msgspec.Raw]).decode
    for number, line in enumerate(lines, 1):
        try:
            if not keys_of(line).keys() <= _FIELDS:
                raise msgspec.ValidationError("there may be a misspelt key")
            task = decode(line)
        except (ValueError, RecursionError):  # msgspec's errors and broken UTF-8 are ValueErrors
            if number == 1:
                line = line.removeprefix(BYTE_ORDER_MARK)
            if not line.strip():
                continue
            try:
                task = task_of_record(msgspec.json.decode(line), f"{file.name.partition('.')[0]}/{number}")
            except (ValueError, RecursionError) as error:
                record = None
                with suppress(ValueError, RecursionError):
                    record = msgspec.json.decode(line)
                collector.skip(file, number, error, record)
                continue
        collector.add(file, number, task)


_DEFAULTS: Final = {
    "domain": "Misc.",
    "subdomain": "General Info.",
    "rubric": msgspec.to_builtins(WHOLE_TASK),
    "source": "own",
}
"""Defaults of keys that may be missing. The default of ``id`` is made of file name and line number."""
_TYPES: Final = {each.name: each.type for each in msgspec.structs.fields(Task)}
_FIELDS: Final = _TYPES.keys()
_KEY_SIMILARITY: Final = 0.75
"""Similarity from which an unknown key counts as a misspelling. Other unknown keys are ignored."""
_HINTS: Final = {
    "rubric": '; write {"groups": [{"id": 1, "description": "...", "facts": ["..."]}]}',
    "reference_answer": "; a text that was read as a number may have lost digits: pandas needs dtype=False",
}
_NESTED: Final = frozenset({"rubric", "flags", "extra", "truth", "files", "identity"})
"""Fields that are not text."""
_LONGEST_INSTRUCTION: Final = 100_000
_LONGEST_ID: Final = 1_000


def unfit(task: Task) -> str:
    """Why a task cannot be attempted, in one line; empty if it can."""
    problems = [f"{name}: it is empty" for name in ("id", "instruction") if not getattr(task, name).strip()]
    if (length := len(task.id)) > _LONGEST_ID:
        problems.append(f"id: it has {length:,} characters, and at most {_LONGEST_ID:,} are taken")
    if (length := len(task.instruction)) > _LONGEST_INSTRUCTION:
        problems.append(
            f"instruction: it has {length:,} characters, and at most {_LONGEST_INSTRUCTION:,} are taken"
        )
    if problem := start_url_problem(task.website):
        problems.append(f"website: {problem}")
    return "; ".join(problems)


def task_of_record(record: object, place: str) -> Task:
    """The task of a record with WebGym's own keys, as other programs may have written it.

    A key that is null is missing, and a missing one has its default. A value that a column cannot hold may be
    JSON in a string; a text that looks like a number may be one, as long as it has no fraction.

    Args:
        record: the record.
        place: the id of a task without one.

    Raises:
        ValueError: the record is not a valid task; lists all that is wrong.
    """
    if not isinstance(record, dict):
        raise ValueError("it is not a JSON object")
    given: dict[str, Any] = without_nulls(record)
    problems = []
    values = {}
    for name, value in ({"id": place} | _DEFAULTS | given).items():
        if name in _TYPES:
            try:
                values[name] = msgspec.convert(_as_field(name, value), _TYPES[name])
            except ValueError as error:
                problems.append(f"{name}: {error}{_HINTS.get(name, '')}")
        elif nearest := get_close_matches(name, _FIELDS, 1, _KEY_SIMILARITY):
            problems.append(f"there is no key {name!r}; did you mean {nearest[0]}?")
    problems += [f"{name}: it is missing" for name in ("instruction", "website") if name not in given]
    if problems:
        raise ValueError("; ".join(problems))
    if needs_pictures(given, _FIELDS):
        values["flags"] = tuple(dict.fromkeys((*values.get("flags", ()), NEEDS_PICTURES)))
    return Task(**values)


def without_nulls(value: Any) -> Any:
    """The value without members that are null or NaN: writers of tables give each row the keys of all."""
    if isinstance(value, dict):
        return {
            name: without_nulls(each) for name, each in value.items() if each is not None and each == each
        }
    return [without_nulls(each) for each in value] if isinstance(value, list) else value


def as_text(value: object) -> object:
    """A value of a text column as text: a number without a fraction, or a day; any other as it is."""
    if isinstance(value, int | float) and not isinstance(value, bool) and value == value // 1:
        return str(int(value))
    return str(value).removesuffix(" 00:00:00") if isinstance(value, datetime.date) else value


def _as_field(name: str, value: Any) -> Any:
    if name not in _NESTED:
        return as_text(value)
    if isinstance(value, str):
        value = without_nulls(msgspec.json.decode(value))
    if name != "rubric":
        return value
    if isinstance(value, dict):
        value = value.get("groups", value.get("fact_groups", value))  # the rubric writer's own key
    return {"groups": value} if isinstance(value, list | tuple) else value


def needs_pictures(record: Mapping[str, Any], known: Collection[str]) -> bool:
    """Whether a record has a picture beside its known keys, which no agent is shown."""
    return any(_is_picture(value, name) for name, value in record.items() if name not in known)


def _is_picture(value: object, name: str) -> bool:
    """Whether a value names or holds a picture, or a list of them, as those of a key that is called so."""
    if isinstance(value, list | tuple):
        return any(_is_picture(each, name) for each in value)
    if isinstance(value, dict):
        return any(_is_picture(each, f"{name}.{key}") for key, each in value.items())
    is_named = "image" in name.lower() and not is_missing_value(value) and isinstance(value, str | bytes)
    kind = guess_type(value)[0] if isinstance(value, str) and len(value) < _LONGEST_ID else None
    return is_named or (kind or "").startswith("image/")


def write_lines(file: BinaryIO, tasks: Iterable[Task]) -> int:
    """Write tasks in WebGym's own JSON lines format; the number of tasks written."""
    encoder = msgspec.json.Encoder()
    buffer = bytearray()
    count = 0
    for count, task in enumerate(tasks, 1):  # noqa: B007 - the last count is the result
        encoder.encode_into(task, buffer)
        buffer += b"\n"
        file.write(buffer)
    return count
