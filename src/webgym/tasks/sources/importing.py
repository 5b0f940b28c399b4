"""From a source's files, folder or dataset to its tasks: every record becomes a task or is counted."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import date
from fnmatch import fnmatch
from pathlib import Path

import msgspec
from msgspec.structs import replace

from webgym.core.errors import TaskFileError
from webgym.core.task import WebsiteFrom
from webgym.tasks.sources.base import BAD_WEBSITE, CHATS, DATED, Draft, Read, Skipped, Source, SourceTask
from webgym.tasks.sources.companions import Companions
from webgym.tasks.sources.dates import names_past
from webgym.tasks.sources.fields import Fields, website_url
from webgym.tasks.sources.hub import HUB, hub_records
from webgym.tasks.sources.problems import PassedOver, Unusable
from webgym.tasks.sources.reading import COMPRESSIONS, REFUSED, SUFFIXES, Found, read_records

_HASH_DIGITS = 12
"""Hexadecimal: two of 300,000 tasks get the same with a chance of 1 in 6,000, and then one is renamed."""
_LONGEST_ID = 200
"""Characters of a native id; a longer one is none."""
_DATA = frozenset({*SUFFIXES, *COMPRESSIONS, *REFUSED})
"""Suffixes of files that may hold tasks, those included that are not read, so that they are told."""


def read_with(source: Source, where: str | Path, today: date, known: Sequence[Source]) -> Read:
    """Read a source: see :func:`webgym.tasks.sources.read_source`.

    Args:
        known: every source, so that records of another are told from this one's.
    """
    collected = _Collected(source, today, known)
    if str(where).startswith(HUB):
        collected.add(hub_records(str(where)), Companions(None))
    else:
        path = Path(where)
        if path.is_dir():
            collected.add_folder(path)
        else:
            beside = Companions(path.parent)
            collected.add(read_records(path, collected.is_record), beside)
            collected.passed_over += beside.broken
    read = collected.read()
    if not read.records:
        passed = f"; {read.passed_over[0]}" if read.passed_over else ""
        raise TaskFileError(
            f"{where} holds no record of {source.name}{passed}",
            hint=f"a record of it has a field {' or '.join(map(repr, source.instruction))}",
        )
    return read


class _Collected:
    """The tasks of a source as they come in, each with an id of its own."""

    def __init__(self, source: Source, today: date, known: Sequence[Source]) -> None:
        self._source = source
        self._others = [other for other in known if other is not source]
        self._today = today
        self._places: dict[str, str] = {}
        self._tasks: dict[str, SourceTask] = {}
        self._skipped: list[Skipped] = []
        self._known = 0  # records of this source, those included that were there already
        self.passed_over: list[PassedOver] = []

    def read(self) -> Read:
        tasks = list(self._tasks.values())
        records = len(tasks) + len(self._skipped)
        return Read(self._source.name, tasks, self._skipped, records, tuple(self.passed_over))

    def _refuse_anothers(self, fields: Fields) -> None:
        """A folder may hold several benchmarks, and many call their instruction alike.

        Raises:
            Unusable: the record is marked as another source's more than as this one's.
        """
        own = _marked(self._source, fields)
        for other in self._others:
            if _marked(other, fields) > own:
                raise Unusable(f"a record of {other.name}, not of {self._source.name}")

    def is_record(self, fields: Fields) -> bool:
        """Whether an object by itself is a record."""
        return any(
            isinstance(value, str) or (name in CHATS and isinstance(value, list))
            for name in self._source.instruction
            for value in (fields.value(name),)
        )

    def add_folder(self, folder: Path) -> None:
        """Every file of tasks in a folder and those in it. A file that gives no task is passed over whole."""
        for path in _files(folder):
            if any(fnmatch(path.name, pattern) for pattern in self._source.beside):
                self.passed_over.append(PassedOver(str(path), "belongs to the tasks beside it"))
                continue
            beside = Companions(path.parent)
            known, skipped = self._known, len(self._skipped)
            try:
                self.add(read_records(path, self.is_record), beside)
            except TaskFileError as error:
                self.passed_over.append(PassedOver(str(path), error.message))
            else:
                if self._known == known:
                    self._pass_over(path, skipped)
            self.passed_over += beside.broken

    def _pass_over(self, path: Path, first: int) -> None:
        """Count a file in which no record is of this source as one."""
        skipped = self._skipped[first:]
        del self._skipped[first:]
        reason = "it is empty"
        if skipped:
            reason = f"no record of {self._source.name} among {len(skipped)}; the first: {skipped[0].reason}"
        self.passed_over.append(PassedOver(str(path), reason))

    def add(self, records: Iterable[Found], beside: Companions) -> None:
        """Every record: a task, or why there is none."""
        for record in records:
            if isinstance(record, Skipped):
                self._skipped.append(record)
                continue
            try:
                self._refuse_anothers(record.fields)
                draft = self._source.draft(record.fields, beside)
                task = _task(self._source, draft, self._today)
                self._known += 1
                task = self._told_apart(task)
            except Unusable as reason:
                self._skipped.append(Skipped(record.file, record.place, str(reason)))
            else:
                self._tasks[task.id] = task
                self._places[task.id] = f"{record.file}, {record.place}"

    def _told_apart(self, task: SourceTask) -> SourceTask:
        """The task with an id that no other has.

        Raises:
            Unusable: it is there already, with the same id.
        """
        known = self._tasks.get(task.id)
        if known is not None:
            if _content(known) == _content(task):
                raise Unusable(f"the same record as {self._places[task.id]}")
            # Some sets begin to count anew in every file; which is the first must not matter for the others.
            task = replace(task, id=f"{task.id}~{_digest(task)}")
            if task.id in self._tasks:
                raise Unusable(f"the same record as {self._places[task.id]}")
        return task


def _files(folder: Path) -> Iterator[Path]:
    """The files of a folder and those in it that hold data, in the order of their names."""
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith((".", "__")) for part in path.relative_to(folder).parts)
        if not hidden and path.suffix.lower() in _DATA and path.is_file():
            yield path


def _marked(source: Source, fields: Fields) -> int:
    """How many fields mark a record as a source's; 0 for none."""
    return max((len(names) for names in source.marks if all(name in fields for name in names)), default=0)


def _task(source: Source, draft: Draft, today: date) -> SourceTask:
    """A checked task. Its id is the native one, else a hash of what it says: not of its place, so that it is
    the same in another split, order or format of the source."""
    flags = list(draft.flags)
    url, website_from = _website(draft)
    if draft.website and url is None:
        flags.append(BAD_WEBSITE)
    if not source.timeless and any(names_past(text, today) for text in (draft.instruction, *draft.dates)):
        flags.append(DATED)
    task = SourceTask(
        id="",
        source=source.name,
        instruction=draft.instruction,
        website=url,
        website_from=website_from,
        domain=draft.domain,
        subdomain=draft.subdomain,
        reference_answer=draft.reference_answer,
        example_answer=draft.example_answer,
        hints=draft.hints,
        rubric=draft.rubric,
        flags=tuple(dict.fromkeys(flags)),
        extra=draft.extra,
    )
    try:
        msgspec.json.encode(task)
    except (ValueError, TypeError, OverflowError) as error:
        raise Unusable("a field is not UTF-8, or holds half a character or no JSON") from error
    native = " ".join((draft.native_id or "").split())
    return replace(task, id=f"{source.name}/{native if 0 < len(native) <= _LONGEST_ID else _digest(task)}")


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
