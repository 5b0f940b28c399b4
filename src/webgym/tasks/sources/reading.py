"""Reads records from files in any of their formats (JSON lines, JSON, CSV, TSV, Parquet).

A broken record is not repaired: it is returned as :class:`Skipped`, with its line and what is wrong with it.
Where a format does not say where the next record begins (JSON outside of lines, a quotation mark in a CSV
file that is never closed), what follows is part of it. The format is recognised by the file's content first,
and by its suffix where the content is ambiguous.
"""

from __future__ import annotations

import bz2
import csv
import gzip
import io
import json
import lzma
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import IO, Any, Final, NamedTuple, TypeAlias

from webgym.core.errors import TaskFileError
from webgym.tasks.files import refuse_device
from webgym.tasks.sources.base import Skipped
from webgym.tasks.sources.fields import Fields, kind

SUFFIXES = (".jsonl", ".ndjson", ".json", ".csv", ".tsv", ".parquet")
COMPRESSIONS = (".gz", ".bz2", ".xz", ".zst")
REFUSED = tuple(".zip .tar .tgz .7z .rar .arrow .feather .xlsx .db .sqlite .pkl .pt".split())
"""Suffixes of files that may contain tasks, in formats that are not supported."""
_ROWS_AT_ONCE: Final = 512
"""Parquet rows in memory at a time; a row of TravelPlanner may take 100 kB."""
_LONGEST_CSV_FIELD: Final = 2**31 - 1
_DELIMITERS: Final = ",\t;|"
_BETWEEN_ELEMENTS: Final = re.compile(r"\s*,?\s*")

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
            lines = _Lines(path, _decompressed(file, magic))
            yield from _text_records(path, lines, is_record)
            if lines.damage is not None:
                yield lines.damage
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


Line: TypeAlias = tuple[int, str]


class _Lines:
    """The lines of a text with their numbers, from 1, up to where the file is damaged.

    Every line ends with ``\\n``. A byte that is not UTF-8 becomes half of a surrogate pair, so only the field
    that contains it is invalid.

    Attributes:
        damage: what is wrong with the file, once it was met.
    """

    def __init__(self, path: Path, stream: IO[bytes]) -> None:
        self._path = path
        self._stream = stream
        self.damage: Skipped | None = None

    def __iter__(self) -> Iterator[Line]:
        number = 0
        try:
            stream: Any = self._stream  # which has peek, whatever it was opened by
            head = stream.peek(4)[:4]
            encoding = json.detect_encoding(head)
            errors = "surrogateescape" if encoding.startswith("utf-8") else "replace"
            with io.TextIOWrapper(stream, encoding, errors) as texts:
                for number, text in enumerate(texts, start=1):
                    yield number, text
        except _DAMAGE as error:
            reason = f"the rest of the file is damaged: {error}"
            self.damage = Skipped(str(self._path), f"after line {number}", reason)


def _text_records(path: Path, lines: Iterable[Line], is_record: IsRecord) -> Iterator[Found]:
    name = str(path)
    suffix = next((part.lower() for part in reversed(path.suffixes) if part.lower() not in COMPRESSIONS), "")
    filled = iter(lines)
    first = next((line for line in filled if line[1].strip()), None)
    if first is None:
        return
    start = first[1].lstrip()[0]
    if start not in "[{" and suffix not in (".json", ".jsonl", ".ndjson"):
        yield from _csv_records(name, first, filled)
        return
    is_whole = not isinstance(_decoded(first[1]), ValueError)
    is_lines = is_whole or start not in "[{" or (start == "{" and suffix in (".jsonl", ".ndjson"))
    second = next((line for line in filled if line[1].strip()), None)
    others = filled if second is None else chain([second], filled)
    if is_lines and second is not None:
        yield from _json_lines(name, chain([first], others))
    else:
        yield from _json_document(name, first, others, is_record)


# --- JSON ---------------------------------------------------------------------------------------------


def _decoded(text: str) -> object | ValueError:
    """The value of a text, or what is wrong with it."""
    try:
        return json.loads(text)  # type: ignore[no-any-return]
    except ValueError as error:
        return error
    except RecursionError:
        return ValueError("it is nested too deeply")


def _json_lines(name: str, lines: Iterable[Line]) -> Iterator[Found]:
    for number, text in lines:
        if text.strip():
            yield _record(name, f"line {number}", _decoded(text))


def _json_document(name: str, first: Line, others: Iterable[Line], is_record: IsRecord) -> Iterator[Found]:
    blank = "\n" * (first[0] - 1)  # so that errors name the file's lines
    text = "".join((blank, first[1], *(line for _, line in others)))
    if text.lstrip().startswith("["):
        yield from _json_array(name, text)
    else:
        yield from _top_level(name, f"line {first[0]}", _decoded(text), is_record)


def _json_array(name: str, text: str) -> Iterator[Found]:
    """The elements of an array up to the first broken one, with which reading ends."""
    decoder = json.JSONDecoder()
    at, line, counted, index = text.index("[") + 1, 1, 0, 0
    while (at := _end(_BETWEEN_ELEMENTS, text, at)) < len(text) and text[at] != "]":
        line, counted, index = line + text.count("\n", counted, at), at, index + 1
        place = f"line {line} (record {index})"
        try:
            value, at = decoder.raw_decode(text, at)
        except (ValueError, RecursionError) as error:
            yield Skipped(name, place, f"no JSON, and nothing after it is read: {error}")
            return
        yield _record(name, place, value)
    if text[at:].strip() != "]":
        line += text.count("\n", counted, at)
        yield Skipped(name, f"line {line}", "the array is not closed, or something follows it")


def _end(pattern: re.Pattern[str], text: str, at: int) -> int:
    match = pattern.match(text, at)
    return match.end() if match else at


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
    if isinstance(value, ValueError):
        return Skipped(name, place, f"no JSON: {value}")
    if not isinstance(value, dict):
        return Skipped(name, place, f"{kind(value)}, not an object")
    return Record(name, place, Fields(value, key))


# --- CSV ----------------------------------------------------------------------------------------------


def _csv_records(name: str, first: Line, others: Iterable[Line]) -> Iterator[Found]:
    limit = csv.field_size_limit(_LONGEST_CSV_FIELD)  # of the process; TravelPlanner's fields are longer
    try:
        texts = chain([first[1]], (text for _, text in others))
        reader = csv.reader(texts, delimiter=max(_DELIMITERS, key=first[1].count), strict=True)
        header: list[str] | None = None
        while True:
            place = f"line {first[0] + reader.line_num}"
            try:
                cells = next(reader)
            except StopIteration:
                return
            except csv.Error as error:
                yield Skipped(name, place, f"no row of a CSV file: {error}")
                continue
            if header is None:
                header = [cell.strip() for cell in cells]
            elif len(cells) == len(header):
                yield Record(name, place, Fields(dict(zip(header, cells, strict=True))))
            elif "".join(cells).strip():
                yield Skipped(name, place, f"{len(cells)} columns where the header has {len(header)}")
    finally:
        csv.field_size_limit(limit)


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
                    if isinstance(value, ValueError):
                        yield Skipped(str(path), place, str(value))
                    else:
                        yield Record(str(path), place, Fields(value))
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
