"""The published data set's JSON lines (SYSTEM.md 1.7), read as they are and written back byte for byte.

A row has more information than a task, in several forms: facts in four formats, a difficulty that is not
their number, numeric ids, extra columns. So a task keeps the line that it was read from in
``extra["published"]``, unless this module would write exactly that line. When the task is written, the line
is used again as long as reading it still gives the task; if the task was changed, only the columns that
differ are replaced.

Fields of a task that have no column (the origin of its website, an offline truth) are written to an
additional column, ``webgym``, which other programs can ignore.
"""

from __future__ import annotations

import json
from ast import literal_eval
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec
from msgspec.structs import replace

from webgym.core.errors import TaskFileError
from webgym.core.task import FactGroup, Rubric, Task, reference_of
from webgym.tasks.files import (
    BYTE_ORDER_MARK,
    NEEDS_PICTURES,
    NO_FACTS,
    NONE_FACT,
    TaskCollector,
    as_text,
    needs_pictures,
)
from webgym.tasks.missing_values import is_missing_value, is_no_fact

SOURCE: Final = "webgym"
"""Source of a task whose row has no benchmark."""
ORIGINAL_LINE: Final = "published"
"""Key in ``Task.extra``: the line that the task was read from, with surrounding blank lines."""
WEBGYM_COLUMN: Final = "webgym"
"""Column for fields of Task that have no column of their own, by name."""

DIFFICULTY_DIFFERS: Final = "difficulty-differs"
"""Flag: the row's difficulty is not the number of its facts."""
OLD_RUBRIC: Final = "old-rubric"
"""Flag: the facts have no groups (a string, strings, or descriptions with a difficulty)."""

_FIELD_OF: Final = {
    "benchmark_name": "source",
    "task_name": "instruction",
    "domain": "domain",
    "subdomain": "subdomain",
    "website": "website",
    "definite_answer": "reference_answer",
    "task_id": "id",
    "difficulty": "rubric",
    "evaluator_reference": "rubric",
    "task_id_decomposed_from": "parent_id",
}
"""Columns in the order of writing, and the field of Task of each."""
_TYPES: Final = {field.name: field.type for field in msgspec.structs.fields(Task)}
_BEGIN: Final = b'{"benchmark_name": '
"""Beginning of every line written by this module."""


def looks_published(names: Iterable[str]) -> bool:
    """Whether a record with these keys, or a table with these columns, is of the published format."""
    return "task_name" in names


# --- reading ----------------------------------------------------------------------------------------


def read_published(lines: Iterable[bytes], file: Path, split: str | None, collector: TaskCollector) -> None:
    """Read published rows.

    Args:
        lines: of the file, with their line ends.
        file: its path, for broken records.
        split: the split in the file's name.
        collector: gets the tasks.
    """
    blank, last = b"", None
    for number, line in enumerate(lines, 1):
        if not line.strip():
            blank += line
            continue
        row: Any = None
        try:
            row = decoded(line.removeprefix(BYTE_ORDER_MARK) if number == 1 else line)
            task = task_of(row, split)
        except (ValueError, RecursionError) as error:
            collector.skip(file, number, error, identity(row, split))
            blank = b""
            continue
        whole, blank = blank + line, b""
        if not _is_canonical(whole, row, task, split):
            task.extra[ORIGINAL_LINE] = whole.decode()
        if collector.add(file, number, task):
            last = task
    if last is not None and blank:
        last.extra[ORIGINAL_LINE] = (line_of(last, split) + blank).decode()


def task_of(row: object, split: str | None = None) -> Task:
    """The task of a published row.

    Args:
        row: the decoded row.
        split: of the task, unless the row has one.

    Raises:
        ValueError: the row is not a valid task; says why.
    """
    if not isinstance(row, dict):
        raise ValueError("not a JSON object")
    flags: list[str] = []
    source = _text(row, "benchmark_name") or SOURCE
    instruction = _required(row, "task_name")
    rubric = _rubric(row, instruction, flags)
    if needs_pictures(row, {*_FIELD_OF, WEBGYM_COLUMN, ORIGINAL_LINE}):
        flags.append(NEEDS_PICTURES)
    has_difficulty = row.get("difficulty") is not None and NO_FACTS not in flags
    if has_difficulty and not _is_number(row["difficulty"], rubric.difficulty):
        flags.append(DIFFICULTY_DIFFERS)
    parent = _text(row, "task_id_decomposed_from")
    answer = row.get("definite_answer")
    task = Task(
        id=_namespaced(_required(row, "task_id"), source),
        instruction=instruction,
        website=_required(row, "website"),
        domain=_text(row, "domain"),
        subdomain=_text(row, "subdomain"),
        rubric=rubric,
        source=source,
        reference_answer=reference_of(answer if isinstance(answer, str) else _text(row, "definite_answer")),
        parent_id=_namespaced(parent, source) if parent else None,
        split=split,  # type: ignore[arg-type]  # the file's name is one of the two
        flags=tuple(flags),
        extra={
            name: value
            for name, value in row.items()
            if name not in _FIELD_OF and name != ORIGINAL_LINE and value is not None
        },
    )
    return _with_webgym_fields(task) if WEBGYM_COLUMN in task.extra else task


def identity(row: object, split: str | None) -> dict[str, Any]:
    """The fields of a row's task by which it is known, even if the row is not a valid task."""
    if not isinstance(row, dict):
        return {}
    source = _text(row, "benchmark_name") or SOURCE
    id, parent = _text(row, "task_id"), _text(row, "task_id_decomposed_from")
    told = {
        "id": _namespaced(id, source) if id else None,
        "website": _text(row, "website"),
        "parent_id": _namespaced(parent, source) if parent else None,
        "split": split,
    }
    own = row.get(WEBGYM_COLUMN)
    return told | own if isinstance(own, dict) else told


def _is_canonical(line: bytes, row: dict[str, Any], task: Task, split: str | None) -> bool:
    """Whether a line is exactly what this module would write for its task."""
    if not line.startswith(_BEGIN):
        return False
    return line == (line_of(task, split) if WEBGYM_COLUMN in row else _encoded(_updated(task, {}, None)))


def decoded(line: bytes) -> Any:
    """The value of a JSON line.

    Raises:
        ValueError: it is not valid JSON, or not valid Unicode.
    """
    try:
        return msgspec.json.decode(line)
    except msgspec.DecodeError:
        # Python's json module writes missing values as NaN, and only it reads them.
        try:
            row = json.loads(line, parse_constant=lambda _: None)
            msgspec.json.encode(row)  # half a surrogate pair is not valid Unicode
        except ValueError:
            row = None
        if row is None:
            raise
        return row


def _with_webgym_fields(task: Task) -> Task:
    """The task with the fields in the column ``webgym``; a foreign column of that name stays in ``extra``."""
    extra = dict(task.extra)
    values = extra.pop(WEBGYM_COLUMN)
    if not isinstance(values, dict) or not values.keys() <= _TYPES.keys():
        return task
    try:
        fields = {name: msgspec.convert(value, _TYPES[name]) for name, value in values.items()}
    except msgspec.ValidationError:
        return task
    return replace(task, **{"extra": extra, **fields})


def _text(row: Mapping[str, Any], column: str) -> str:
    """A column as text; empty if it is missing. A number is converted as JSON writes it."""
    value = row.get(column)
    if is_missing_value(value):
        return ""
    value = as_text(value)
    return value if isinstance(value, str) else msgspec.json.encode(value).decode()


def _required(row: Mapping[str, Any], column: str) -> str:
    if text := _text(row, column):
        return text
    raise ValueError(f"the row has no {column}" if column not in row else f"{column} is empty")


def _namespaced(name: str, source: str) -> str:
    return name if name.startswith(f"{source}/") else f"{source}/{name}"


def _is_number(value: object, number: int) -> bool:
    """Whether a value is this number, possibly as text."""
    if isinstance(value, str):
        return value.strip() == str(number)
    return not isinstance(value, bool) and value == number


def _rubric(row: Mapping[str, Any], instruction: str, flags: list[str]) -> Rubric:
    """The facts of a row in any of their formats; appends to ``flags``."""
    if "evaluator_reference" not in row:
        raise ValueError("the row has no evaluator_reference")
    items = _items(row["evaluator_reference"])
    groups: list[FactGroup] = []
    loose: list[str] = []
    for item in items:
        if isinstance(item, dict) and (item.get("facts") is not None or item.get("id") is not None):
            if facts := tuple(_facts(item.get("facts"), flags)):
                groups.append(FactGroup(item.get("id"), _text(item, "description"), facts))  # type: ignore[arg-type]
        elif isinstance(item, dict):
            if item and "description" not in item:
                raise ValueError(f"evaluator_reference has an unknown form, with the keys {', '.join(item)}")
            if facts := tuple(_facts(_text(item, "description"), flags)):
                groups.append(FactGroup(len(groups) + 1, "", facts))
                flags.append(OLD_RUBRIC)
        else:
            loose += _facts(item, flags)
    if loose:
        groups.append(FactGroup(len(groups) + 1, "", tuple(loose)))
        flags.append(OLD_RUBRIC)
    if not groups:
        groups = [FactGroup(1, "", (instruction,))]
        flags.append(NO_FACTS)
    flags[:] = dict.fromkeys(flags)
    return Rubric(tuple(_numbered(groups)))


def _items(reference: object) -> list[Any]:
    if isinstance(reference, str) and reference.lstrip().startswith(("[", "{")):
        for decode in (msgspec.json.decode, literal_eval):  # some are Python literals
            with suppress(ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
                return _items(decode(reference.strip()))
        return [reference]  # a text that begins with a bracket
    if isinstance(reference, dict):  # of the rubric writer, or of WebGym
        reference = reference.get("fact_groups", reference.get("groups", reference))
    if isinstance(reference, list | tuple):
        return list(reference)
    return [] if reference is None else [reference]


def _facts(facts: object, flags: list[str]) -> Iterator[str]:
    """The facts with content; appends a flag if one has none."""
    for fact in facts if isinstance(facts, list | tuple) else [facts]:
        if not (isinstance(fact, str | bool | int | float) or fact is None):
            raise ValueError("a fact in evaluator_reference is not text")
        text = fact if isinstance(fact, str) else "" if is_missing_value(fact) else str(fact)
        if not is_no_fact(text):
            yield text
        elif text.strip() or fact is None:
            flags.append(NONE_FACT)


def _numbered(groups: list[FactGroup]) -> list[FactGroup]:
    """Groups with unique integer ids: their own if possible, else numbered from 1."""
    ids = {group.id for group in groups if type(group.id) is int}
    if len(ids) == len(groups):
        return groups
    return [replace(group, id=number) for number, group in enumerate(groups, 1)]


# --- writing ----------------------------------------------------------------------------------------


def write_published(file: BinaryIO, tasks: Iterable[Task], split: str | None) -> int:
    """Write tasks as published rows; the number of tasks written.

    Args:
        file: the file to write to.
        tasks: the tasks to write.
        split: the split in the file's name.

    Raises:
        TaskFileError: a task has no value for a required column.
    """
    count, ending = 0, b"\n"
    for task in tasks:
        try:
            line = line_of(task, split)
        except ValueError as error:
            raise TaskFileError(
                f"the task {task.id!r} cannot be written as a published row: {error}",
                hint="fix it or leave it out",
            ) from error
        if count:
            line = line.removeprefix(BYTE_ORDER_MARK)
        if not ending.endswith(b"\n"):
            file.write(b"\n")
        file.write(line)
        ending = line[-1:]
        count += 1
    return count


def line_of(task: Task, split: str | None) -> bytes:
    """A task as a published row, with a line end.

    Raises:
        ValueError: it has no value for a required column.
    """
    row: dict[str, Any] = {}
    original = None
    if isinstance(kept := task.extra.get(ORIGINAL_LINE), str):
        try:
            row = decoded(kept.removeprefix("\ufeff").encode())
            original = task_of(row, task.split)
        except ValueError:
            row = {}  # not a line of a published set
        else:
            task = replace(
                task, extra={name: value for name, value in task.extra.items() if name != ORIGINAL_LINE}
            )
            if task == original:
                return kept.encode()
    return _encoded(_with_webgym_column(task, split, _updated(task, row, original)))


def _encoded(row: dict[str, Any]) -> bytes:
    line: bytes = msgspec.json.format(msgspec.json.encode(row), indent=0)
    return line + b"\n"


def _updated(task: Task, row: dict[str, Any], original: Task | None) -> dict[str, Any]:
    """The row with the columns in which the task differs from ``original`` replaced; all columns if ``row``
    is empty."""
    columns: dict[str, Any] = {
        "benchmark_name": task.source,
        "task_name": task.instruction,
        "domain": task.domain,
        "subdomain": task.subdomain,
        "website": task.website,
        "definite_answer": task.reference_answer or "",
        "task_id": task.id,
        "difficulty": task.difficulty,
        "evaluator_reference": task.rubric.groups,
        "task_id_decomposed_from": task.parent_id,
    }
    before = {} if original is None else original.extra
    removed = before.keys() - task.extra.keys() | {WEBGYM_COLUMN}
    row = {name: value for name, value in row.items() if name not in removed}
    for column, field in _FIELD_OF.items():
        if original is None or getattr(original, field) != getattr(task, field):
            row[column] = columns[column]
    for name, value in task.extra.items():
        if (
            name not in _FIELD_OF
            and name not in (ORIGINAL_LINE, WEBGYM_COLUMN)
            and before.get(name, row) != value
        ):
            row[name] = value
    return row


def _with_webgym_column(task: Task, split: str | None, row: dict[str, Any]) -> dict[str, Any]:
    """The row, with the column ``webgym`` for fields that could not be read back from the others."""
    read_back = task_of(msgspec.to_builtins(row), split)
    if read_back == task:
        return row
    missing = {
        name: getattr(task, name) for name in _TYPES if getattr(read_back, name) != getattr(task, name)
    }
    return row | {WEBGYM_COLUMN: missing}
