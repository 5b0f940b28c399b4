"""Task files on disk: how they are opened, what was found in them, how they come into being.

Also WebGym's own JSON lines: one :class:`webgym.core.task.Task` per line, in UTF-8.
"""

from __future__ import annotations

import gc
import gzip
import io
import os
import uuid
import zlib
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, cast

import msgspec
from msgspec.structs import replace

from webgym.core.errors import TaskFileError
from webgym.core.task import WHOLE_TASK, Rubric, Task
from webgym.core.text import plain
from webgym.core.websites import start_url_problem
from webgym.tasks.missing_values import is_no_fact

BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
_GZIP: Final = b"\x1f\x8b"
_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_BUFFER: Final = 1 << 20


@dataclass(frozen=True)
class BrokenRecord:
    """A record that is no task, or one that cannot be judged.

    Attributes:
        file: as it was given; where a folder was, the file in it.
        line: line, or row of a Parquet file, from 1.
        reason: what is wrong with it.
    """

    file: Path
    line: int
    reason: str

    def __str__(self) -> str:
        return plain(f"{self.file}:{self.line}: {self.reason}")


@dataclass(frozen=True)
class TaskFile:
    """What a file held.

    Attributes:
        tasks: that can be judged.
        broken: records that are no tasks, and why.
        set_aside: tasks that nobody can judge, for none of their facts says anything.
    """

    tasks: list[Task]
    broken: list[BrokenRecord]
    set_aside: list[BrokenRecord] = field(default_factory=list)


@dataclass
class Findings:
    """What reading has found so far. An id counts once, whichever file it stands in.

    Attributes:
        split: of the tasks of the file that is being read which do not say theirs.
    """

    tasks: dict[str, Task] = field(default_factory=dict)
    broken: list[BrokenRecord] = field(default_factory=list)
    set_aside: list[BrokenRecord] = field(default_factory=list)
    split: Literal["train", "test"] | None = None

    def add(self, file: Path, line: int, task: Task) -> bool:
        """Take a task in, unless it cannot be attempted or judged or its id is taken; whether it was."""
        if why := unfit(task):
            self.skip(file, line, why)
            return False
        judged = _judged(task)
        if judged is None:
            self.set_aside.append(BrokenRecord(file, line, f"{task.id} has no fact to judge"))
            return False
        if judged.split is None and self.split is not None:
            judged = replace(judged, split=self.split)
        if self.tasks.setdefault(judged.id, judged) is judged:
            return True
        self.skip(file, line, f"a second task with the id {task.id!r}")
        return False

    def skip(self, file: Path, line: int, reason: object) -> None:
        """Note a record that is no task."""
        self.broken.append(BrokenRecord(file, line, str(reason)))


NONE_FACT: Final = "none-fact"
"""Flag: a fact said nothing ("None", "N/A"), somebody's empty value made a text. It is left out."""
NO_FACTS: Final = "no-facts"
"""Flag: no fact says anything, and the instruction holds the place of one. Nothing can be judged, so readers
of task files set the task aside."""


def _judged(task: Task) -> Task | None:
    """The task with what a judge can use; ``None`` if no fact says anything.

    Facts and reference answers that stand for "there is none" go: judged, they make a reward of nothing.
    """
    if NO_FACTS in task.flags:
        return None
    if any(is_no_fact(fact) for group in task.rubric.groups for fact in group.facts):
        said = [
            (group, tuple(fact for fact in group.facts if not is_no_fact(fact)))
            for group in task.rubric.groups
        ]
        groups = tuple(replace(group, facts=facts) for group, facts in said if facts)
        if not groups:
            return None
        flags = dict.fromkeys((*task.flags, NONE_FACT))
        task = replace(task, rubric=Rubric(groups), flags=tuple(flags))
    answer = task.reference_answer
    if answer is not None and answer.strip() in ("", "None"):  # "none" may well be one, as GAIA's is
        task = replace(task, reference_answer=None)
    return task


@contextmanager
def collector_paused() -> Iterator[None]:
    """No garbage collection inside: it would visit every task again and again while they are loaded."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader[Any]]:
    """A file to read from, decompressed if its first bytes say that it is gzip or zstd.

    Raises:
        TaskFileError: it cannot be read, now or while it is being read.
    """
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
    except (OSError, EOFError, zlib.error) as error:  # pyarrow's are OSErrors, gzip's may be any of them
        raise TaskFileError(
            f"cannot read the task file {path}: {getattr(error, 'strerror', None) or error}",
            hint="give a file of JSON lines or Parquet, such as webgym tasks offline writes",
        ) from error


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write to that stands under its name once it is complete and on disk, or not at all.

    Compressed if the name ends in ``.gz`` or ``.zst``; the same content gives the same bytes.

    Raises:
        TaskFileError: it cannot be written.
    """
    torn = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with torn.open("wb", buffering=_BUFFER) as file, ExitStack() as stack:
            yield _compressed(path, file, stack)
        _sync(torn)
        torn.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise TaskFileError(
            f"cannot write {path}: {error.strerror or error}", hint="choose another place or free some space"
        ) from error
    finally:
        with suppress(OSError):  # a read-only file system refuses even to look for it
            torn.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Be sure that a file's content, or a folder's names, are on disk."""
    opened_again = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened_again)
    finally:
        os.close(opened_again)


def _compressed(path: Path, file: BinaryIO, stack: ExitStack) -> BinaryIO:
    if path.suffix == ".gz":  # neither name nor time of day inside
        zipped = gzip.GzipFile("", "wb", compresslevel=6, fileobj=file, mtime=0)
        return cast(BinaryIO, stack.enter_context(zipped))
    if path.suffix == ".zst":
        from pyarrow import CompressedOutputStream

        return cast(BinaryIO, stack.enter_context(CompressedOutputStream(file, "zstd")))
    return file


def read_lines(lines: Iterable[bytes], file: Path, found: Findings) -> None:
    """Read WebGym's own JSON lines.

    Survives a byte-order mark, carriage returns, empty lines and a last line without an end.
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
                task = _completed(line, file, number)
            except (ValueError, RecursionError) as error:
                found.skip(file, number, error)
                continue
        found.add(file, number, task)


_DEFAULTS: Final = {
    "domain": "Misc.",
    "subdomain": "General Info.",
    "rubric": msgspec.to_builtins(WHOLE_TASK),
    "source": "own",
}
"""What a task of one's own need not say, beside its id, which is the file's name and the line."""
_TYPES: Final = {each.name: each.type for each in msgspec.structs.fields(Task)}
_FIELDS: Final = _TYPES.keys()
_ALIKE: Final = 0.75
"""How alike two spellings are, at least, to be taken for one key. Other keys are of no concern here."""
_LONGEST_INSTRUCTION: Final = 100_000
_LONGEST_ID: Final = 1_000


def unfit(task: Task) -> str:
    """Why a task cannot be attempted, whoever gave it, in one line; empty if it can."""
    why = []
    if (length := len(task.id)) > _LONGEST_ID:
        why.append(f"id: it has {length:,} characters, and at most {_LONGEST_ID:,} are taken")
    if (length := len(task.instruction)) > _LONGEST_INSTRUCTION:
        why.append(
            f"instruction: it has {length:,} characters, and at most {_LONGEST_INSTRUCTION:,} are taken"
        )
    if problem := start_url_problem(task.website):
        why.append(f"website: {problem}")
    return "; ".join(why)


def _completed(line: bytes, file: Path, number: int) -> Task:
    """The task of a line that says less than everything.

    Raises:
        ValueError: with all that is wrong with it.
    """
    said = msgspec.json.decode(line)
    if not isinstance(said, dict):
        raise ValueError("it is not a JSON object")
    wrong = []
    values = {}
    for name, value in ({"id": f"{file.name.partition('.')[0]}/{number}"} | _DEFAULTS | said).items():
        if name in _TYPES:
            try:
                values[name] = msgspec.convert(value, _TYPES[name])
            except ValueError as error:
                wrong.append(f"{name}: {error}")
        elif nearest := get_close_matches(name, _FIELDS, 1, _ALIKE):
            wrong.append(f"there is no key {name!r}; did you mean {nearest[0]}?")
    wrong += [f"{name}: it is missing" for name in ("instruction", "website") if name not in said]
    if wrong:
        raise ValueError("; ".join(wrong))
    return Task(**values)


def write_lines(file: BinaryIO, tasks: Iterable[Task]) -> int:
    """Write WebGym's own JSON lines; the number of tasks written."""
    encoder = msgspec.json.Encoder()
    buffer = bytearray()
    count = 0
    for count, task in enumerate(tasks, 1):  # noqa: B007 - the last count is what is asked for
        encoder.encode_into(task, buffer)
        buffer += b"\n"
        file.write(buffer)
    return count
