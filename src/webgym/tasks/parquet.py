"""Task sets as Parquet: a column per field of :class:`webgym.core.task.Task`, the rubric nested and typed.

Fields without a column type (``truth``, ``extra``, ``files``) are JSON in string columns. ``difficulty`` is
written for other programs; when reading, it is computed from the rubric. The writer's settings are fixed, so
the same tasks give the same bytes with the same release of pyarrow.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, BinaryIO, Final, get_args

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from webgym.core.errors import TaskFileError
from webgym.core.task import LEVELS, Attachment, FactGroup, Rubric, Task, WebsiteFrom
from webgym.core.truth import Truth
from webgym.tasks.files import TaskCollector, task_of_record
from webgym.tasks.published import identity, looks_published, task_of

VERSION: Final = 1
"""Version of the columns. Files with a higher version are refused."""
_VERSION_KEY: Final = b"webgym.tasks"
_ROWS: Final = 1 << 15
"""Rows per row group, which are in memory twice while reading and writing."""

_GROUP: Final = pa.struct(
    [
        pa.field("id", pa.int64(), nullable=False),
        pa.field("description", pa.string(), nullable=False),
        pa.field("facts", pa.list_(pa.field("fact", pa.string(), nullable=False)), nullable=False),
    ]
)
SCHEMA: Final = pa.schema(
    [
        pa.field("id", pa.string(), nullable=False),
        pa.field("instruction", pa.string(), nullable=False),
        pa.field("website", pa.string(), nullable=False),
        pa.field("domain", pa.string(), nullable=False),
        pa.field("subdomain", pa.string(), nullable=False),
        pa.field("rubric", pa.list_(pa.field("group", _GROUP, nullable=False)), nullable=False),
        pa.field("difficulty", pa.int32(), nullable=False),
        pa.field("source", pa.string(), nullable=False),
        pa.field("reference_answer", pa.string()),
        pa.field("example_answer", pa.string()),
        pa.field("parent_id", pa.string()),
        pa.field("split", pa.string()),
        pa.field("website_from", pa.string(), nullable=False),
        pa.field("flags", pa.list_(pa.field("flag", pa.string(), nullable=False)), nullable=False),
        pa.field("extra", pa.string()),
        pa.field("truth", pa.string()),
        pa.field("files", pa.string()),
        pa.field("identity", pa.string()),
        pa.field("stated_level", pa.string()),
    ],
    metadata={_VERSION_KEY: str(VERSION)},
)
_RUBRIC_READ: Final = pa.list_(
    pa.struct([("id", pa.int64()), ("description", pa.string()), ("facts", pa.list_(pa.string()))])
)
"""The rubric as other programs may write it: with nulls, which are reported row by row."""
_FIELDS: Final = {field.name: field for field in msgspec.structs.fields(Task)}
_REPEATING: Final = frozenset(
    {"website", "domain", "subdomain", "source", "parent_id", "split", "website_from", "stated_level"}
)
_ALLOWED: Final = {
    "split": {"train", "test"},
    "website_from": {*get_args(WebsiteFrom)},
    "stated_level": {*LEVELS},
}
_JSON: Final[dict[str, Any]] = {
    "extra": dict[str, Any],
    "truth": Truth,
    "files": tuple[Attachment, ...],
    "identity": dict[str, Any],
}


# --- writing ----------------------------------------------------------------------------------------


def write_parquet(file: BinaryIO, tasks: Iterable[Task]) -> int:
    """Write tasks as Parquet; the number of tasks written.

    Raises:
        TaskFileError: a value does not fit into its column, such as a group's id beyond 64 bits.
    """
    remaining = iter(tasks)
    count = 0
    with pq.ParquetWriter(file, SCHEMA, compression="zstd", compression_level=3, version="2.6") as writer:
        while batch := list(islice(remaining, _ROWS)):
            try:
                writer.write_batch(_batch(batch), row_group_size=_ROWS)
            except (pa.ArrowException, OverflowError, UnicodeEncodeError) as error:
                raise TaskFileError(
                    f"tasks {count + 1} to {count + len(batch)} do not fit into Parquet: {error}",
                    hint="write JSON lines instead",
                ) from error
            count += len(batch)
    return count


def _batch(tasks: list[Task]) -> pa.RecordBatch:
    columns = {
        name: pa.array([getattr(task, name) for task in tasks], SCHEMA.field(name).type)
        for name in SCHEMA.names
        if name not in ("rubric", *_JSON)
    }
    columns["rubric"] = _rubrics([task.rubric for task in tasks])
    for name in _JSON:
        columns[name] = pa.array([_json(getattr(task, name) or None) for task in tasks], pa.string())
    return pa.RecordBatch.from_arrays([columns[name] for name in SCHEMA.names], schema=SCHEMA)


def _json(value: object) -> str | None:
    return None if value is None else msgspec.json.encode(value).decode()


def _offsets(sizes: Iterable[int]) -> pa.Array:
    ends, end = [0], 0
    for size in sizes:
        end += size
        ends.append(end)
    return pa.array(ends, pa.int32())


def _rubrics(rubrics: list[Rubric]) -> pa.Array:
    # Built from flat arrays, in a tenth of the time that nested dicts take.
    groups = [group for rubric in rubrics for group in rubric.groups]
    facts = pa.ListArray.from_arrays(
        _offsets(len(group.facts) for group in groups),
        pa.array([fact for group in groups for fact in group.facts], pa.string()),
        type=_GROUP.field("facts").type,
    )
    ids = pa.array([group.id for group in groups], pa.int64())
    descriptions = pa.array([group.description for group in groups], pa.string())
    flat = pa.StructArray.from_arrays([ids, descriptions, facts], fields=list(_GROUP))
    offsets = _offsets(len(rubric.groups) for rubric in rubrics)
    return pa.ListArray.from_arrays(offsets, flat, type=SCHEMA.field("rubric").type)


# --- reading ----------------------------------------------------------------------------------------


def read_parquet(path: Path, split: str | None, collector: TaskCollector) -> None:
    """Read a Parquet file: one of WebGym's own, or the published set as the hub converts it.

    Args:
        path: of the file.
        split: the split in its name, for the published set.
        collector: gets the tasks.

    Raises:
        TaskFileError: it cannot be read, lacks columns, or was written by a newer release.
    """
    try:
        with pq.ParquetFile(path) as file:
            names = file.schema_arrow.names
            is_published = looks_published(names)
            if not is_published:
                _check_columns(path, file.schema_arrow)
            pictures = {} if is_published else _pictures(file.schema_arrow)
            first = 1
            for batch in file.iter_batches(_ROWS, columns=[name for name in names if name not in pictures]):
                if is_published:
                    _add_rows(batch, path, first, collector, lambda row, _: task_of(row, split))
                elif pictures or not _add_in_bulk(batch, path, first, collector):
                    _add_rows(
                        batch,
                        path,
                        first,
                        collector,
                        lambda row, place: task_of_record(row | pictures, place),
                    )
                first += batch.num_rows
    except (OSError, pa.ArrowException) as error:
        raise TaskFileError(
            f"cannot read the task file {path}: {error}", hint="it may be incomplete or damaged"
        ) from error


def _check_columns(path: Path, schema: pa.Schema) -> None:
    version = int((schema.metadata or {}).get(_VERSION_KEY, VERSION))
    if version > VERSION:
        raise TaskFileError(
            f"{path} has columns of version {version}, this release reads {VERSION}",
            hint="install a newer webgym-rl",
        )
    missing = [name for name in ("instruction", "website") if name not in schema.names]
    if missing:
        raise TaskFileError(
            f"{path} contains no task: it has no column {missing[0]!r}",
            hint="docs/task-files.md lists the columns",
        )


def _pictures(schema: pa.Schema) -> dict[str, str]:
    """A file's name in place of what each column of bytes has, such as pictures: they are not read."""
    types = {field.name: str(field.type) for field in schema if field.name not in _FIELDS}
    return {name: "picture.png" for name, text in types.items() if "binary" in text}


def _add_rows(
    batch: pa.RecordBatch, path: Path, first: int, collector: TaskCollector, make: Callable[[Any, str], Task]
) -> None:
    """Add the tasks of a batch row by row, whatever types its columns have."""
    types = {field.name: field.type for field in batch.schema}
    for number, values in enumerate(batch.to_pylist(maps_as_pydicts="lossy"), first):
        row = {name: _plain(value, types[name]) for name, value in values.items()}
        try:
            task = make(row, f"{path.name.partition('.')[0]}/{number}")
        except ValueError as error:
            known = identity(row, collector.split) if looks_published(row) else row
            collector.skip(path, number, error, known)
        else:
            collector.add(path, number, task)


def _plain(value: Any, kind: pa.DataType) -> Any:
    """The value of a column, with what is of Arrow's type for JSON decoded."""
    if value is None:
        return None
    if isinstance(kind, pa.BaseExtensionType):
        return msgspec.json.decode(value) if kind.extension_name == "arrow.json" else value
    if pa.types.is_struct(kind):
        return {field.name: _plain(value[field.name], field.type) for field in kind}
    if pa.types.is_list(kind) or pa.types.is_large_list(kind):
        return [_plain(each, kind.value_type) for each in value]
    return value


def _add_in_bulk(batch: pa.RecordBatch, path: Path, first: int, collector: TaskCollector) -> bool:
    """Add the tasks of a batch if its columns are as this module writes them and no row is broken; whether
    they were added. Row by row takes several times as long."""
    if not set(batch.schema.names) <= set(SCHEMA.names):
        return False
    try:
        tasks = list(_in_bulk(batch))
    except (ValueError, TypeError, pa.ArrowException):
        return False
    for number, task in enumerate(tasks, first):
        collector.add(path, number, task)
    return True


def _in_bulk(batch: pa.RecordBatch) -> Iterable[Task]:
    """The tasks of a batch without broken rows.

    Raises:
        ValueError, TypeError: a row is broken.
    """
    given = {name: batch.column(name) for name in _FIELDS if name in batch.schema.names}
    if missing := [name for name, field in _FIELDS.items() if field.required and name not in given]:
        raise ValueError(f"{missing} must get defaults")
    columns: list[list[Any]] = []
    for name in _FIELDS:
        if name not in given:
            columns.append([_default(name) for _ in range(batch.num_rows)])
        elif name == "rubric":
            columns.append(_rubrics_of(given[name].cast(_RUBRIC_READ)))
        else:
            column = given[name]
            # Building a struct checks no types, and a number that is cast may not be the text it was.
            if column.type not in (SCHEMA.field(name).type, pa.large_string(), pa.string_view()):
                raise TypeError(f"{name} is {column.type}")
            if column.null_count and not SCHEMA.field(name).nullable:
                raise ValueError(f"{name} is null")
            columns.append(_values(name, column.cast(SCHEMA.field(name).type)))
    return map(Task, *columns)


def _default(name: str) -> Any:
    default, make = _FIELDS[name].default, _FIELDS[name].default_factory
    return default if make is msgspec.NODEFAULT else make()


def _rubrics_of(column: pa.Array) -> list[Rubric]:
    groups = column.values
    facts = groups.field("facts")
    ids, descriptions = groups.field("id").to_pylist(), groups.field("description").to_pylist()
    if groups.field("id").null_count or groups.field("description").null_count:
        raise ValueError("a group has no id or no description")
    texts = facts.values.to_pylist()
    fact_lists = [tuple(texts[begin:end]) for begin, end in pairwise(facts.offsets.to_pylist())]
    fact_groups = list(map(FactGroup, ids, descriptions, fact_lists))
    return [Rubric(tuple(fact_groups[begin:end])) for begin, end in pairwise(column.offsets.to_pylist())]


def _values(name: str, column: pa.Array) -> list[Any]:
    """The values of a column, as fields of Task."""
    if name in _REPEATING:  # equal strings are one string in memory
        coded = column.dictionary_encode()
        values = [*coded.dictionary.to_pylist(), None]
        if name in _ALLOWED:  # msgspec compares with defaults, which it omits, by identity
            if not _ALLOWED[name].issuperset(values[:-1]):
                raise ValueError(f"{name} is not one of {_ALLOWED[name]}")
            values = [value and sys.intern(value) for value in values]
        return [values[code] for code in coded.indices.fill_null(-1).to_pylist()]
    values = column.to_pylist()
    if name in _JSON:
        decode = msgspec.json.Decoder(_JSON[name]).decode
        return [_default(name) if text is None else decode(text) for text in values]
    return [tuple(flags) for flags in values] if name == "flags" else values
