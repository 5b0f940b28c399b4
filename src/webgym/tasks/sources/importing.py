"""Reads a source's files, folder or data set: every record becomes a task or is counted as skipped."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator
from datetime import date
from fnmatch import fnmatch
from pathlib import Path

import msgspec
from msgspec.structs import replace

from webgym.core.errors import TaskFileError, UsageError
from webgym.core.task import WebsiteFrom, reference_of
from webgym.core.text import fold
from webgym.tasks.formats import split_of
from webgym.tasks.hub import address_of, download
from webgym.tasks.sources.base import (
    BAD_WEBSITE,
    CHATS,
    DATED,
    OUTDATED_ANSWER,
    Draft,
    Read,
    Skipped,
    Source,
    SourceTask,
)
from webgym.tasks.sources.benchmarks import SOURCES
from webgym.tasks.sources.dates import contains_past_date
from webgym.tasks.sources.fields import Companions, Fields, PassedOver, Unusable, website_url
from webgym.tasks.sources.reading import (
    COMPRESSIONS,
    REFUSED,
    SUFFIXES,
    Found,
    read_records,
)

_HASH_DIGITS = 12
"""Hexadecimal digits of ids made from a hash. Two of 300,000 tasks have the same with a probability of 1 in
6,000; one of them is then renamed."""
_LONGEST_ID = 200
"""Most characters of a native id; a longer one is not used."""
_DATA = frozenset({*SUFFIXES, *COMPRESSIONS, *REFUSED})
"""Suffixes of files that may contain tasks, including those that cannot be read, so that they are
reported."""


def read_source(name: str, where: str | Path, *, today: date | None = None) -> Read:
    """Read a source's native files as they are.

    A broken record is skipped and counted, with its file, place and reason; the rest loads. Everything is
    read again on every call, and the same files give the same tasks under the same ids.

    Args:
        name: of the source, a key of :data:`SOURCES`.
        where: a file (JSON lines, JSON, CSV, TSV, Parquet, compressed or not), a folder of them, or an
            address on the hub (:mod:`webgym.tasks.hub`).
        today: what lies before it has passed; the day of the call if not given.

    Raises:
        UsageError: there is no such source.
        TaskFileError: nothing is there, it cannot be read, or no record is in it.
        ConfigError: the hub's library is not installed.
    """
    source = SOURCES.get(name)
    if source is None:
        raise UsageError(f"unknown source {name!r}", hint=f"the sources are {', '.join(SOURCES)}")
    collected = _TaskCollector(source, date.today() if today is None else today)
    path = Path(where)
    if address := address_of(where):
        collected.add_files(download(address))
    elif path.is_dir():
        collected.add_files(_files(path))
    else:
        companions = Companions(path.parent)
        collected.add(read_records(path, collected.is_record), companions)
        collected.passed_over += companions.broken
    read = collected.read()
    if not read.records:
        passed = f"; {read.passed_over[0]}" if read.passed_over else ""
        raise TaskFileError(
            f"{where} contains no record of {source.name}{passed}",
            hint=f"a record of it has a field {' or '.join(map(repr, source.instruction))}",
        )
    return read


class _TaskCollector:
    """Collects the tasks of a source and gives them unique ids."""

    def __init__(self, source: Source, today: date) -> None:
        self._source = source
        self._others = [other for other in SOURCES.values() if other is not source]
        self._today = today
        self._places: dict[str, str] = {}
        self._tasks: dict[str, SourceTask] = {}
        self._joined: dict[tuple[Path | None, str], list[str]] = {}
        self._skipped: list[Skipped] = []
        self._known = 0  # records of this source, including repeated ones
        self.passed_over: list[PassedOver] = []

    def read(self) -> Read:
        tasks = list(self._tasks.values())
        records = len(tasks) + len(self._skipped)
        return Read(self._source.name, tasks, self._skipped, records, tuple(self.passed_over))

    def _refuse_anothers(self, fields: Fields) -> None:
        """Refuse records of other sources: a folder may contain several, often with the same name of a field.

        Raises:
            Unusable: the record has more identifying fields of another source than of this one.
        """
        own = _marked(self._source, fields)
        for other in self._others:
            if _marked(other, fields) > own:
                raise Unusable(f"a record of {other.name}, not of {self._source.name}")

    def is_record(self, fields: Fields) -> bool:
        """Whether an object is a record of the source."""
        return any(
            isinstance(value, str) or (name in CHATS and isinstance(value, list))
            for name in self._source.instruction
            for value in (fields.value(name),)
        )

    def add_files(self, paths: Iterable[Path]) -> None:
        """Read files of tasks. One without tasks is listed as passed over."""
        for path in paths:
            if any(fnmatch(path.name, pattern) for pattern in self._source.beside):
                self.passed_over.append(PassedOver(str(path), "is a companion file of the tasks"))
                continue
            companions = Companions(path.parent)
            known, skipped = self._known, len(self._skipped)
            try:
                self.add(read_records(path, self.is_record), companions)
            except TaskFileError as error:
                self.passed_over.append(PassedOver(str(path), error.message))
            else:
                if self._known == known:
                    self._pass_over(path, skipped)
            self.passed_over += companions.broken

    def _pass_over(self, path: Path, first: int) -> None:
        """List a file without a record of this source once, instead of all its records."""
        skipped = self._skipped[first:]
        del self._skipped[first:]
        reason = "it is empty"
        if skipped:
            reason = f"no record of {self._source.name} among {len(skipped)}; the first: {skipped[0].reason}"
        self.passed_over.append(PassedOver(str(path), reason))

    def add(self, records: Iterable[Found], companions: Companions) -> None:
        """Add records: their tasks, or why they give none."""
        for record in records:
            if isinstance(record, Skipped):
                self._skipped.append(record)
                continue
            try:
                self._refuse_anothers(record.fields)
                draft = self._source.draft(record.fields, companions)
                if self._source.is_split:
                    draft.split = draft.split or split_of(Path(record.file))
                task = _task(self._source, draft, self._today)
                self._known += 1
                native, task = task.id, self._with_unique_id(task)
            except Unusable as reason:
                self._skipped.append(Skipped(record.file, record.place, str(reason)))
            else:
                self._tasks[task.id] = task
                self._places[task.id] = f"{record.file}, {record.place}"
                if draft.joined:
                    same = self._joined.setdefault((companions.folder, native), [])
                    same.append(task.id)
                    self._withhold_answer(same)

    def _withhold_answer(self, same: list[str]) -> None:
        """Take the answer from the tasks that it was given to by one id, if they have different texts."""
        if len(same) == 1 or len({fold(self._tasks[id].instruction) for id in same}) == 1:
            return
        for id in same:
            task = self._tasks[id]
            flags = tuple(dict.fromkeys((*task.flags, OUTDATED_ANSWER)))
            self._tasks[id] = replace(task, reference_answer=None, example_answer=None, flags=flags)

    def _with_unique_id(self, task: SourceTask) -> SourceTask:
        """The task with a unique id.

        Raises:
            Unusable: the same task was added before.
        """
        known = self._tasks.get(task.id)
        if known is not None:
            if _content(known) == _content(task):
                if task.split == "test":  # nothing may be trained on a test task
                    self._tasks[task.id] = replace(known, split="test")
                raise Unusable(f"the same record as {self._places[task.id]}")
            # Some sources number the tasks of every file from 1. The hash keeps ids independent of the files'
            # order.
            task = replace(task, id=f"{task.id}~{_digest(task)}")
            if task.id in self._tasks:
                raise Unusable(f"the same record as {self._places[task.id]}")
        return task


def _files(folder: Path) -> Iterator[Path]:
    """The data files of a folder and its subfolders, sorted by path."""
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith((".", "__")) for part in path.relative_to(folder).parts)
        if not hidden and path.suffix.lower() in _DATA and path.is_file():
            yield path


def _marked(source: Source, fields: Fields) -> int:
    """The number of fields that identify a record as of this source; 0 if they do not."""
    return max((len(names) for names in source.marks if all(name in fields for name in names)), default=0)


def _task(source: Source, draft: Draft, today: date) -> SourceTask:
    """The task of a draft. Its id is the native one, else a hash of its contents, so that it does not depend
    on the split, order or format of the source's files.

    Raises:
        Unusable: a field is not valid Unicode or JSON.
    """
    flags = list(draft.flags)
    url, website_from = _website(draft)
    if draft.website and url is None:
        flags.append(BAD_WEBSITE)
    if not source.timeless and any(
        contains_past_date(text, today) for text in (draft.instruction, *draft.dates)
    ):
        flags.append(DATED)
    task = SourceTask(
        id="",
        source=source.name,
        instruction=draft.instruction,
        website=url,
        website_from=website_from,
        domain=draft.domain,
        subdomain=draft.subdomain,
        reference_answer=reference_of(draft.reference_answer),
        example_answer=draft.example_answer,
        hints=draft.hints,
        rubric=draft.rubric,
        split=draft.split,
        flags=tuple(dict.fromkeys(flags)),
        extra=draft.extra,
        level=draft.level,
    )
    try:
        msgspec.json.encode(task)
    except (ValueError, TypeError, OverflowError) as error:
        raise Unusable("a field is not valid Unicode or JSON") from error
    native, parent = (" ".join((id or "").split()) for id in (draft.native_id, draft.native_parent_id))
    return replace(
        task,
        id=f"{source.name}/{native if 0 < len(native) <= _LONGEST_ID else _digest(task)}",
        parent_id=f"{source.name}/{parent}" if parent else None,
    )


def _website(draft: Draft) -> tuple[str | None, WebsiteFrom]:
    if not draft.website:
        return None, "inferred"
    if url := website_url(draft.website):
        return url, draft.website_from
    first, *others = re.split(r"[\s,;|]+", draft.website.strip())
    url = website_url(first) if others else None
    return (url, "derived") if url else (None, "inferred")


def _content(task: SourceTask) -> tuple[str, str | None]:
    return task.instruction, task.website


def _digest(task: SourceTask) -> str:
    text = f"{task.instruction}\n{task.website or ''}"
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_DIGITS]
