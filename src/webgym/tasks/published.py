"""The published data set's JSON lines (SYSTEM.md 1.7): read as they are, written again byte for byte.

A row says more than a task holds, and says it in one of several ways: facts in four shapes, a difficulty
that is not their number, ids that are numbers, columns of its own. So a task keeps the line that it was read
from, in ``extra["published"]``, unless this module would write that very line. Writing gives the line back as
long as reading it still gives the task; of a task that was changed since, only the columns that differ are
written anew.

What a row cannot say about one of our tasks (where its website comes from, an offline truth) goes into one
column of our own, ``webgym``, which nobody else needs to read.
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
from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks.files import BYTE_ORDER_MARK, NO_FACTS, NONE_FACT, Findings
from webgym.tasks.missing_values import is_missing_value, is_no_fact

SOURCE: Final = "webgym"
"""Source of a task whose row names no benchmark."""
KEPT: Final = "published"
"""Key in ``Task.extra``: the line that the task was read from, with what stood around it."""
OURS: Final = "webgym"
"""Column for what the others cannot say: fields of Task by name."""

DIFFICULTY_DIFFERS: Final = "difficulty-differs"
"""Flag: the row's difficulty is not the number of its facts."""
OLD_RUBRIC: Final = "old-rubric"
"""Flag: facts that came without groups (a string, strings, or descriptions with a difficulty)."""

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
"""Columns in the order of writing, and the field of Task that each tells."""
_TYPES: Final = {field.name: field.type for field in msgspec.structs.fields(Task)}
_BEGIN: Final = b'{"benchmark_name": '
"""How every line begins that is written here."""


def looks_published(names: Iterable[str]) -> bool:
    """Whether a record with these keys, or a table with these columns, is of the published format."""
    return "task_name" in names


# --- reading ----------------------------------------------------------------------------------------


def read_published(lines: Iterable[bytes], file: Path, split: str | None, found: Findings) -> None:
    """Read published rows.

    Args:
        lines: of the file, with their ends.
        file: named for broken records.
        split: that the file's name tells.
        found: takes what is read.
    """
    blank, last = b"", None
    for number, line in enumerate(lines, 1):
        if not line.strip():
            blank += line
            continue
        try:
            row = decoded(line.removeprefix(BYTE_ORDER_MARK) if number == 1 else line)
            task = task_of(row, split)
        except (ValueError, RecursionError) as error:
            found.skip(file, number, error)
            blank = b""
            continue
        whole, blank = blank + line, b""
        if not _is_ours(whole, row, task, split):
            task.extra[KEPT] = whole.decode()
        if found.add(file, number, task):
            last = task
    if last is not None and blank:
        last.extra[KEPT] = (line_of(last, split) + blank).decode()


def task_of(row: object, split: str | None = None) -> Task:
    """The task that a published row tells.

    Args:
        row: as JSON gives it.
        split: of the task, unless the row tells it.

    Raises:
        ValueError: it tells none; says why.
    """
    if not isinstance(row, dict):
        raise ValueError("not a JSON object")
    flags: list[str] = []
    source = _text(row, "benchmark_name") or SOURCE
    instruction = _needed(row, "task_name")
    rubric = _rubric(row, instruction, flags)
    is_told = "difficulty" in row and NO_FACTS not in flags
    if is_told and not _is_number(row["difficulty"], rubric.difficulty):
        flags.append(DIFFICULTY_DIFFERS)
    parent = _text(row, "task_id_decomposed_from")
    task = Task(
        id=_namespaced(_needed(row, "task_id"), source),
        instruction=instruction,
        website=_needed(row, "website"),
        domain=_text(row, "domain"),
        subdomain=_text(row, "subdomain"),
        rubric=rubric,
        source=source,
        reference_answer=_text(row, "definite_answer") or None,
        parent_id=_namespaced(parent, source) if parent else None,
        split=split,  # type: ignore[arg-type]  # the file's name is one of the two
        flags=tuple(flags),
        extra={name: value for name, value in row.items() if name not in _FIELD_OF and name != KEPT},
    )
    return _with_ours(task) if OURS in row else task


def _is_ours(line: bytes, row: dict[str, Any], task: Task, split: str | None) -> bool:
    """Whether a line is the one that would be written of the task that it tells."""
    if not line.startswith(_BEGIN):
        return False
    return line == (line_of(task, split) if OURS in row else _encoded(_updated(task, {}, None)))


def decoded(line: bytes) -> Any:
    """The JSON of a line.

    Raises:
        ValueError: it is none, or no text.
    """
    try:
        return msgspec.json.decode(line)
    except msgspec.DecodeError:
        # Python's own writer makes NaN of what is missing, and its reader alone takes that.
        try:
            row = json.loads(line, parse_constant=lambda _: None)
            msgspec.json.encode(row)  # half a surrogate pair is no text
        except ValueError:
            row = None
        if row is None:
            raise
        return row


def _with_ours(task: Task) -> Task:
    """What our own column tells; a column of that name that is somebody else's stays one."""
    extra = dict(task.extra)
    told = extra.pop(OURS)
    if not isinstance(told, dict) or not told.keys() <= _TYPES.keys():
        return task
    try:
        fields = {name: msgspec.convert(value, _TYPES[name]) for name, value in told.items()}
    except msgspec.ValidationError:
        return task
    return replace(task, **{"extra": extra, **fields})


def _text(row: Mapping[str, Any], column: str) -> str:
    """A column as text; empty for none. A number is the text that it is written as."""
    value = row.get(column)
    if is_missing_value(value):
        return ""
    return value if isinstance(value, str) else msgspec.json.encode(value).decode()


def _needed(row: Mapping[str, Any], column: str) -> str:
    if text := _text(row, column):
        return text
    raise ValueError(f"the row has no {column}" if column not in row else f"{column} is empty")


def _namespaced(name: str, source: str) -> str:
    return name if name.startswith(f"{source}/") else f"{source}/{name}"


def _is_number(value: object, number: int) -> bool:
    """Whether a value is this number, maybe written as a text."""
    if isinstance(value, str):
        return value.strip() == str(number)
    return not isinstance(value, bool) and value == number


def _rubric(row: Mapping[str, Any], instruction: str, flags: list[str]) -> Rubric:
    """The facts of a row in any of their shapes."""
    if "evaluator_reference" not in row:
        raise ValueError("the row has no evaluator_reference")
    items = _items(row["evaluator_reference"])
    groups: list[FactGroup] = []
    loose: list[str] = []
    for item in items:
        if isinstance(item, dict) and "facts" in item:
            if facts := tuple(_facts(item["facts"], flags)):
                groups.append(FactGroup(item.get("id"), _text(item, "description"), facts))  # type: ignore[arg-type]
        elif isinstance(item, dict):
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
        for decode in (msgspec.json.decode, literal_eval):  # Python writes its own lists, too
            with suppress(ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
                return _items(decode(reference.strip()))
        return [reference]  # a text that begins so
    if isinstance(reference, list | tuple):
        return list(reference)
    return [] if reference is None else [reference]


def _facts(facts: object, flags: list[str]) -> Iterator[str]:
    """The facts that say something; flags where one does not."""
    for fact in facts if isinstance(facts, list | tuple) else [facts]:
        if not (isinstance(fact, str | bool | int | float) or fact is None):
            raise ValueError("a fact in evaluator_reference is not text")
        text = fact if isinstance(fact, str) else "" if is_missing_value(fact) else str(fact)
        if not is_no_fact(text):
            yield text
        elif text.strip() or fact is None:
            flags.append(NONE_FACT)


def _numbered(groups: list[FactGroup]) -> list[FactGroup]:
    """Groups with ids that are numbers and different: their own if they are, else their places."""
    ids = {group.id for group in groups if type(group.id) is int}
    if len(ids) == len(groups):
        return groups
    return [replace(group, id=place) for place, group in enumerate(groups, 1)]


# --- writing ----------------------------------------------------------------------------------------


def write_published(file: BinaryIO, tasks: Iterable[Task], split: str | None) -> int:
    """Write tasks as published rows; the number of tasks written.

    Args:
        file: to write to.
        tasks: to write.
        split: that the file's name tells.

    Raises:
        TaskFileError: a task lacks what every row has.
    """
    count, ending = 0, b"\n"
    for task in tasks:
        try:
            line = line_of(task, split)
        except ValueError as error:
            raise TaskFileError(
                f"the task {task.id!r} makes no published row: {error}", hint="fix it or leave it out"
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
    """A task as a published row, with the end of its line.

    Raises:
        ValueError: it lacks what every row has.
    """
    row: dict[str, Any] = {}
    plain = None
    if isinstance(kept := task.extra.get(KEPT), str):
        try:
            row = decoded(kept.removeprefix("\ufeff").encode())
            plain = task_of(row, task.split)
        except ValueError:
            row = {}  # that line is not from here
        else:
            task = replace(task, extra={name: value for name, value in task.extra.items() if name != KEPT})
            if task == plain:
                return kept.encode()
    return _encoded(_told(task, split, _updated(task, row, plain)))


def _encoded(row: dict[str, Any]) -> bytes:
    line: bytes = msgspec.json.format(msgspec.json.encode(row), indent=0)
    return line + b"\n"


def _updated(task: Task, row: dict[str, Any], plain: Task | None) -> dict[str, Any]:
    """A row with what differs in the task written into it; for an empty one, that is everything."""
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
    before = {} if plain is None else plain.extra
    gone = before.keys() - task.extra.keys() | {OURS}
    row = {name: value for name, value in row.items() if name not in gone}
    for column, field in _FIELD_OF.items():
        if plain is None or getattr(plain, field) != getattr(task, field):
            row[column] = columns[column]
    for name, value in task.extra.items():
        if name not in _FIELD_OF and name not in (KEPT, OURS) and before.get(name, row) != value:
            row[name] = value
    return row


def _told(task: Task, split: str | None, row: dict[str, Any]) -> dict[str, Any]:
    """The row with a column for what reading it would not give back."""
    plain = task_of(msgspec.to_builtins(row), split)
    if plain == task:
        return row
    missing = {name: getattr(task, name) for name in _TYPES if getattr(plain, name) != getattr(task, name)}
    return row | {OURS: missing}
