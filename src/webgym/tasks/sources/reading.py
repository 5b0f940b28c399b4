"""Reads records from files in any of their formats: JSON lines, JSON, CSV, TSV or Parquet, compressed or not.

A broken record does not affect others: it is returned as :class:`Skipped`, with its position and what is
wrong. The format is recognised by the file's content first, and by its suffix where the content is ambiguous.
"""

from __future__ import annotations

import bz2
import codecs
import gzip
import io
import json
import lzma
import zlib
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeAlias

import msgspec

from webgym.core.errors import TaskFileError
from webgym.tasks.files import refuse_device
from webgym.tasks.sources.base import Skipped
from webgym.tasks.sources.csv_text import csv_rows
from webgym.tasks.sources.fields import Fields, kind
from webgym.tasks.sources.json_text import BrokenValue, json_values

SUFFIXES = (".jsonl", ".ndjson", ".json", ".csv", ".tsv", ".parquet")
COMPRESSIONS = (".gz", ".bz2", ".xz", ".zst")
REFUSED = tuple(".zip .tar .tgz .7z .rar .arrow .feather .xlsx .db .sqlite .pkl .pt".split())
"""Suffixes of files that may contain tasks, in formats that are not supported."""
_ROWS_AT_ONCE = 512
"""Parquet rows in memory at a time; a row of TravelPlanner may take 100 kB."""

_DAMAGE = (OSError, EOFError, zlib.error, lzma.LZMAError)
"""Exceptions raised when reading a damaged compressed file."""


class Record(NamedTuple):
    """A record and its position.

    Attributes:
        file: path of the file.
        place: line, row or key of the record.
        fields: its values.
    """

    file: str
    place: str
    fields: Fields


Found: TypeAlias = "Record | Skipped"
IsRecord: TypeAlias = Callable[[Fields], bool]


def read_records(path: Path, is_record: IsRecord) -> Iterator[Found]:
    """Every record of a file, in order; broken ones as :class:`Skipped`.

    Args:
        path: of the file.
        is_record: whether a top-level object is a record; otherwise it is read as a mapping of records, or as
            an object with lists of records.

    Raises:
        TaskFileError: the file cannot be opened, or its format is not supported.
    """
    if any(suffix.lower() in REFUSED for suffix in path.suffixes[-2:]) and path.is_file():
        raise TaskFileError(
            f"the format of {path} is not supported",
            hint="unpack it, or write it as JSON lines, CSV or Parquet",
        )
    refuse_device(path)
    try:
        with path.open("rb") as file:
            magic = file.read(6)
            file.seek(0)
            if magic[:4] == b"PAR1":
                yield from _parquet_records(path)
                return
            with _decompressed(file, magic) as stream:
                yield from _text_records(path, stream, is_record)
    except OSError as error:
        raise TaskFileError(f"cannot read {path}: {error.strerror or error}") from error


def _decompressed(file: IO[bytes], magic: bytes) -> IO[bytes]:
    if magic[:2] == b"\x1f\x8b":
        return gzip.open(file)  # type: ignore[return-value]
    if magic[:3] == b"BZh":
        return bz2.open(file)
    if magic == b"\xfd7zXZ\0":
        return lzma.open(file)
    if magic[:4] == b"\x28\xb5\x2f\xfd":
        import pyarrow as pa

        return io.BufferedReader(pa.CompressedInputStream(file, "zstd"))
    return file


# --- text ---------------------------------------------------------------------------------------------


def _text_records(path: Path, stream: IO[bytes], is_record: IsRecord) -> Iterator[Found]:
    name = str(path)
    suffix = next((part.lower() for part in reversed(path.suffixes) if part.lower() not in COMPRESSIONS), "")
    lines = _lines(name, stream)
    first = next((line for line in lines if isinstance(line, Skipped) or line[1].strip()), None)
    if first is None:
        return
    if isinstance(first, Skipped):
        yield from (first, *(line for line in lines if isinstance(line, Skipped)))
        return
    lines = chain([first], lines)
    start = first[1].lstrip()[:1]
    if start not in b"[{" and suffix not in (".json", ".jsonl", ".ndjson"):
        yield from _csv_records(name, lines)
    elif start == b"[" or (start == b"{" and _is_multiline_object(first[1], suffix)):
        yield from _json_records(name, lines, is_record)
    else:
        yield from _json_lines(name, lines, is_record)


Line: TypeAlias = "tuple[int, bytes] | Skipped"


def _lines(name: str, stream: IO[bytes]) -> Iterator[Line]:
    """The lines of a text with their numbers, from 1, without line ends and byte-order mark.

    A line ends with ``\\n``, ``\\r\\n`` or ``\\r``. If the data are damaged, the last item is
    :class:`Skipped`.
    """
    number = 0
    try:
        head = stream.read(4)
        rest: IO[bytes] = stream
        for mark, encoding in _MARKS:
            if head.startswith(mark):
                text = (head + stream.read()).decode(encoding, "replace")
                head, rest = b"", io.BytesIO(text.removeprefix("\ufeff").encode("utf-8", "surrogatepass"))
                break
        head = head.removeprefix(codecs.BOM_UTF8)
        # The head may contain complete lines.
        for chunk in chain(_with_rest(head, rest), rest):
            for line in chunk.splitlines():
                number += 1
                yield number, line
    except _DAMAGE as error:
        yield Skipped(name, f"after line {number}", f"the rest of the file is damaged: {error}")


_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def _with_rest(head: bytes, stream: IO[bytes]) -> Iterator[bytes]:
    if head:
        yield head + stream.readline() if not head.endswith(b"\n") else head


def _is_multiline_object(line: bytes, suffix: str) -> bool:
    """Whether the first object of a file continues after its first line."""
    if suffix in (".jsonl", ".ndjson"):
        return line.strip() == b"{"
    return not isinstance(_decoded(line), dict)


def _decoded(line: bytes) -> object | ValueError:
    """The value of a line, or what is wrong with it.

    A byte that is not UTF-8 becomes half of a surrogate pair, so only the field that contains it is invalid.
    """
    try:
        return msgspec.json.decode(line)  # type: ignore[no-any-return]
    except (ValueError, RecursionError):
        pass  # Python's json module accepts more numbers and has better messages
    try:
        return json.loads(line.decode("utf-8", "surrogateescape"))  # type: ignore[no-any-return]
    except ValueError as error:
        return error
    except RecursionError:
        return ValueError("it is nested too deeply")


def _json_lines(name: str, lines: Iterator[Line], is_record: IsRecord) -> Iterator[Found]:
    only: tuple[int, bytes] | None = None
    many = False
    for line in lines:
        if isinstance(line, Skipped):
            if only is not None:
                yield from _json_line(name, *only, is_record)
            yield line
            return
        if not line[1].strip():
            continue
        if only is not None:
            many = True
            yield from _json_line(name, *only, None)
        only = line
    if only is not None:
        yield from _json_line(name, *only, None if many else is_record)


def _json_line(name: str, number: int, line: bytes, is_record: IsRecord | None) -> Iterator[Found]:
    value = _decoded(line)
    if isinstance(value, ValueError):
        yield Skipped(name, f"line {number}", f"no JSON: {value}")
    elif is_record is None:
        yield _record(name, f"line {number}", value)
    else:  # a file of one line may be one object with all records
        yield from _top_level(name, f"line {number}", value, is_record)


def _json_records(name: str, lines: Iterator[Line], is_record: IsRecord) -> Iterator[Found]:
    damage: list[Skipped] = []
    parts: list[bytes] = []
    offset = 1
    for line in lines:
        if isinstance(line, Skipped):
            damage.append(line)
        else:
            offset = offset if parts else line[0]
            parts.append(line[1])
    text = b"\n".join(parts).decode("utf-8", "surrogateescape")
    del parts
    for result in json_values(text, first_line=offset):
        if isinstance(result, BrokenValue):
            yield Skipped(name, result.place, f"no JSON: {result.reason}")
        elif result.inside:
            yield _record(name, result.place, result.value, result.key)
        else:
            yield from _top_level(name, result.place, result.value, is_record)
    yield from damage


def _top_level(name: str, place: str, value: object, is_record: IsRecord) -> Iterator[Found]:
    """The records of a top-level object: itself, or those in its values."""
    if not isinstance(value, dict) or not value or is_record(Fields(value)):
        yield _record(name, place, value)
        return
    lists = {key: items for key, items in value.items() if isinstance(items, list) and _has_objects(items)}
    if lists:
        # {"data": [...]}, {"train": [...], "test": [...]}; other values are metadata
        for key, records in lists.items():
            for index, record in enumerate(records):
                yield _record(name, f"{key}[{index}]", record)
        return
    if not _has_objects(value.values()):
        yield _record(name, place, value)  # not a mapping of records: a record without its instruction
        return
    for key, record in value.items():
        yield _record(name, f"key {key!r}", record, key)


def _has_objects(values: Iterable[object]) -> bool:
    return any(isinstance(value, dict) for value in values)


def _record(name: str, place: str, value: object, key: str | None = None) -> Found:
    if not isinstance(value, dict):
        return Skipped(name, place, f"{kind(value)}, not an object")
    return Record(name, place, Fields(value, key))


def _csv_records(name: str, lines: Iterator[Line]) -> Iterator[Found]:
    damage: list[Skipped] = []

    def texts() -> Iterator[tuple[int, str]]:
        for line in lines:
            if isinstance(line, Skipped):
                damage.append(line)
            else:
                yield line[0], line[1].decode("utf-8", "surrogateescape")

    for place, row in csv_rows(texts()):
        yield Skipped(name, place, row) if isinstance(row, str) else Record(name, place, Fields(row))
    yield from damage


# --- Parquet ------------------------------------------------------------------------------------------


def _parquet_records(path: Path) -> Iterator[Found]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    row = 0
    try:
        with pq.ParquetFile(path) as file:
            for batch in file.iter_batches(batch_size=_ROWS_AT_ONCE):
                for value in _rows(batch):
                    row += 1
                    place = f"row {row}"
                    broken = isinstance(value, ValueError)
                    yield (
                        Skipped(str(path), place, str(value))
                        if broken
                        else Record(str(path), place, Fields(value))
                    )
    except (pa.ArrowException, *_DAMAGE, ValueError) as error:
        reason = str(error).strip().partition("\n")[0]
        yield Skipped(str(path), f"after row {row}", f"the rest of the Parquet file is damaged: {reason}")


def _rows(batch: Any) -> Iterator[Any]:
    """The rows of a batch; for a row that cannot be decoded (a text that is not UTF-8), the error."""
    try:
        yield from batch.to_pylist()
        return
    except ValueError:
        pass
    for index in range(batch.num_rows):
        try:
            yield batch.slice(index, 1).to_pylist()[0]
        except ValueError as error:
            yield error
