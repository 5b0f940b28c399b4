"""An index of a run's trajectories, in SQLite in the run folder: ``.index.sqlite``.

Summary, report and viewer read it in place of the records. It is built from the shards, at the latest when
the run ends, and may be deleted at any time. It is updated by reading only new records; if the shards were
changed otherwise, as by ``webgym verify --set-aside``, it is built again. If it cannot be written, it is kept
in memory.
"""

from __future__ import annotations

import hashlib
import sqlite3
import threading
import uuid
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TypedDict, TypeVar

import msgspec

from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Trajectory
from webgym.core.websites import host_or_text
from webgym.results.summary import Digest, digest_of
from webgym.store.files import TASKS, TRAJECTORIES
from webgym.store.records import CorruptLine, Entry, decode

INDEX: Final = ".index.sqlite"
_SNIPPET: Final = 200
"""Characters of an answer that the search covers."""


class Row(TypedDict):
    """A row of the table of trajectories."""

    id: str
    outcome: str
    task: str
    site: str
    domain: str
    subdomain: str
    level: str
    difficulty: int
    steps: int
    seconds: float
    started: float
    answer: str
    code: str


def row(trajectory: Trajectory, task: Task | None) -> Row:
    """The row of a trajectory; ``task`` is ``None`` if the run does not contain it."""
    episode = trajectory.episode
    failure = episode.failure or trajectory.judge_failure
    return {
        "id": episode.attempt_id,
        "outcome": trajectory.outcome.value,
        "task": task.instruction if task else episode.task_id,
        "site": host_or_text(task.website) if task else "",
        "domain": task.domain if task else "",
        "subdomain": task.subdomain if task else "",
        "level": task.level if task else "",
        "difficulty": task.difficulty if task else 0,
        "steps": len(episode.steps),
        "seconds": round(episode.seconds, 2),
        "started": episode.started_at,
        "answer": (episode.answer or "")[:_SNIPPET],
        "code": failure.code if failure else "",
    }


_VERSION: Final = 1
_BATCH: Final = 500
"""Trajectories per transaction: those that a killed viewer has committed are not read again."""

_COLUMNS: Final = tuple(Row.__annotations__)
_FILTERS: Final = ("outcome", "level", "domain", "site")
_ORDERS: Final = {
    "outcome": "outcome_rank",
    "task": "lower(task)",
    "site": "site",
    "domain": "domain || subdomain",
    "difficulty": "difficulty",
    "steps": "steps",
    "seconds": "seconds",
}
_SCHEMA: Final = f"""
    CREATE TABLE IF NOT EXISTS meta (name TEXT PRIMARY KEY, value);
    CREATE TABLE IF NOT EXISTS shards (name TEXT PRIMARY KEY, end INTEGER, lines INTEGER, last INTEGER,
        digest BLOB);
    CREATE TABLE IF NOT EXISTS corrupt (file TEXT, line INTEGER, reason TEXT);
    CREATE TABLE IF NOT EXISTS digests (number INTEGER PRIMARY KEY, digest BLOB);
    CREATE TABLE IF NOT EXISTS rows (number INTEGER PRIMARY KEY, {", ".join(_COLUMNS)},
        outcome_rank INTEGER, search TEXT, task_id TEXT, sample INTEGER, retry INTEGER,
        shard TEXT, offset INTEGER, length INTEGER);
    CREATE UNIQUE INDEX IF NOT EXISTS by_id ON rows (id);
"""
_TABLES: Final = ("meta", "shards", "corrupt", "digests", "rows")

T = TypeVar("T")


class TrajectoryQuery(NamedTuple):
    """A query for trajectories.

    Attributes:
        q: words that must all occur in the task, the website, the answer or the id, ignoring case.
        outcome, level, domain, site: exact value; empty for any.
        sort: column to sort by; empty for the order in which the attempts ended.
        down: sort in descending order.
    """

    q: str = ""
    outcome: str = ""
    level: str = ""
    domain: str = ""
    site: str = ""
    sort: str = ""
    down: bool = False

    def where(self) -> tuple[str, list[str]]:
        """The condition in SQL, and the values of its parameters."""
        words = self.q.lower().split()
        exact = [(name, value) for name in _FILTERS if (value := getattr(self, name))]
        conditions = [f"{name} = ?" for name, _ in exact] + ["instr(search, ?)"] * len(words)
        return " AND ".join(conditions) or "1", [value for _, value in exact] + words

    def order(self) -> str:
        """The ``ORDER BY`` clause in SQL."""
        if (key := _ORDERS.get(self.sort)) is None:
            return "number"
        return f"{key} {'DESC' if self.down else 'ASC'}, number"


class RunIndex:
    """The index of a run. Blocking; one call at a time, from any thread.

    Args:
        run: the run folder.
        tasks: the run's tasks, by id.
    """

    def __init__(self, run: Path, tasks: Mapping[str, Task]) -> None:
        self._run = run
        self._tasks = tasks
        self._is_stopped = threading.Event()
        self._connection = self._open()

    def _open(self) -> sqlite3.Connection:
        path = self._run / INDEX
        try:
            return self._prepared(path)
        except sqlite3.OperationalError:  # a read-only folder
            return self._prepared(":memory:")
        except sqlite3.DatabaseError:  # a broken file
            path.unlink()
            return self._prepared(path)

    def _prepared(self, path: Path | str) -> sqlite3.Connection:
        connection = sqlite3.connect(path, timeout=60, isolation_level=None, check_same_thread=False)
        try:
            connection.execute("PRAGMA synchronous = OFF")  # after a power failure it is built again
            connection.execute("BEGIN IMMEDIATE")
            for statement in filter(str.strip, _SCHEMA.split(";")):
                connection.execute(statement)
            connection.execute("COMMIT")
        except BaseException:
            connection.close()
            raise
        return connection

    def stop(self) -> None:
        """Make a running :meth:`refresh` end soon; what it has read is kept. May be called from any
        thread."""
        self._is_stopped.set()

    def close(self) -> None:
        """Close the database."""
        self._connection.close()

    def agrees_with(self, entries: Mapping[str, Entry]) -> bool:
        """Whether it has these records, where they are, and no others."""
        rows = self._connection.execute("SELECT id, outcome, shard, offset FROM rows")
        return {tuple(row) for row in rows} == {
            (entry.attempt_id, entry.outcome.value, entry.shard, entry.offset) for entry in entries.values()
        }

    def forget(self) -> None:
        """Have the next :meth:`refresh` read all records again: one changed where it stands."""
        self._connection.execute("DELETE FROM meta WHERE name = 'made_for'")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    # --- reading the index ------------------------------------------------------------------------------

    def __len__(self) -> int:
        return self._one("SELECT count(*) FROM rows", int)

    @property
    def corrupt(self) -> list[CorruptLine]:
        """The lines of the shards that are not valid records."""
        lines = self._connection.execute("SELECT file, line, reason FROM corrupt ORDER BY file, line")
        return [CorruptLine(*line) for line in lines]

    @property
    def version(self) -> str:
        """Changes whenever existing rows changed, so that everything derived from them is outdated."""
        return self.cached("version", str) or ""

    def find(self, query: TrajectoryQuery, after: int, count: int) -> tuple[int, list[Row]]:
        """The number of matching trajectories, and ``count`` of their rows after the first ``after``."""
        where, values = query.where()
        total = self._one(f"SELECT count(*) FROM rows WHERE {where}", int, *values)  # noqa: S608 - no user input
        chosen = f"FROM rows WHERE {where} ORDER BY {query.order()} LIMIT ? OFFSET ?"
        rows = self._connection.execute(f"SELECT {', '.join(_COLUMNS)} {chosen}", [*values, count, after])
        return total, [msgspec.convert(dict(zip(_COLUMNS, row, strict=True)), Row) for row in rows]

    def options(self) -> dict[str, list[str]]:
        """The existing values of each filter."""
        distinct = {name: self._connection.execute(f"SELECT DISTINCT {name} FROM rows") for name in _FILTERS}  # noqa: S608
        return {name: [value for (value,) in values if value] for name, values in distinct.items()}

    def lengths(self) -> tuple[Counter[str], dict[str, list[tuple[int, str, int]]]]:
        """The number of trajectories by outcome; and (steps, outcome, number) by level."""
        outcomes, by_level = Counter[str](), defaultdict[str, list[tuple[int, str, int]]](list)
        counted = "SELECT level, steps, outcome, count(*) FROM rows GROUP BY level, steps, outcome"
        for level, steps, outcome, count in self._connection.execute(counted):
            outcomes[outcome] += count
            if level:
                by_level[level].append((steps, outcome, count))
        return outcomes, dict(by_level)

    def entry(self, attempt_id: str) -> Entry:
        """The position of a trajectory's record.

        Raises:
            KeyError: there is no trajectory with this id.
        """
        row = self._connection.execute(
            "SELECT id, task_id, sample, retry, outcome, shard, offset, length FROM rows WHERE id = ?",
            (attempt_id,),
        ).fetchone()
        if row is None:
            raise KeyError(attempt_id)
        return msgspec.convert(row, Entry)

    def digests(self, after: int) -> Iterator[Digest]:
        """The digests of all trajectories after the first ``after``, in the order in which they ended."""
        decoder = msgspec.msgpack.Decoder(Digest)
        rows = self._connection.execute(
            "SELECT digest FROM digests WHERE number > ? ORDER BY number", (after,)
        )
        return (decoder.decode(digest) for (digest,) in rows)

    def cached(self, name: str, kind: type[T]) -> T | None:
        """The last value given to :meth:`cache` under this name; ``None`` if there is none of this type."""
        row = self._connection.execute("SELECT value FROM meta WHERE name = ?", (name,)).fetchone()
        try:
            return msgspec.json.decode(row[0], type=kind) if row else None
        except msgspec.MsgspecError:
            return None

    def cache(self, name: str, value: Any) -> None:
        """Store a value derived from the rows, for everyone who opens the index, if there is space."""
        with suppress(sqlite3.OperationalError):
            self._put(name, value)

    def _put(self, name: str, value: Any) -> None:
        data = msgspec.json.encode(value)
        self._connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (name, data))

    def _one(self, query: str, kind: type[T], *values: Any) -> T:
        return msgspec.convert(self._connection.execute(query, values).fetchone()[0], kind)

    # --- updating the index ---------------------------------------------------------------------------------

    def refresh(self, progress: Callable[[int], object] = lambda _: None) -> None:
        """Add the records that were written since the last call.

        Args:
            progress: called from time to time with the number of records read of the current shard.
        """
        try:
            self._refresh(progress)
        except sqlite3.DatabaseError:  # the disk is full or cannot lock the file, or it was full before
            self._connection.close()
            self._connection = self._prepared(":memory:")
            self._refresh(progress)

    def _refresh(self, progress: Callable[[int], object]) -> None:
        shards = sorted((self._run / TRAJECTORIES).glob("*.jsonl"))
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            if not self._continues(shards):
                for table in _TABLES:
                    self._connection.execute(f"DELETE FROM {table}")  # noqa: S608 - no user input
                self._connection.execute("INSERT INTO meta VALUES ('made_for', ?)", (self._made_for(),))
                self._set_new_version()
            for shard in shards:
                self._read(shard, progress)
        finally:
            self._connection.execute("COMMIT")  # even if interrupted: every line was added completely

    def _set_new_version(self) -> None:
        self._put("version", uuid.uuid4().hex)

    def _made_for(self) -> bytes:
        """What the rows depend on in addition to the shards: the version and the file of tasks."""
        tasks = (self._run / TASKS).stat()
        return msgspec.json.encode([_VERSION, tasks.st_size, tasks.st_mtime_ns])

    def _continues(self, shards: list[Path]) -> bool:
        """Whether the shards still begin with what was read of them."""
        made_for = self._connection.execute("SELECT value FROM meta WHERE name = 'made_for'").fetchone()
        if made_for != (self._made_for(),):
            return False
        known = self._connection.execute("SELECT name, end, last, digest FROM shards").fetchall()
        present = {shard.name: shard for shard in shards}
        return all(
            name in present and _digest(present[name], last, end) == digest
            for name, end, last, digest in known
        )

    def _read(self, shard: Path, progress: Callable[[int], object]) -> None:
        row = self._connection.execute(
            "SELECT end, lines FROM shards WHERE name = ?", (shard.name,)
        ).fetchone()
        end, lines = row or (0, 0)
        if shard.stat().st_size == end or self._is_stopped.is_set():
            return
        with shard.open("rb") as file:
            file.seek(end)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                lines += 1
                self._add(shard, lines, end, line)
                end += len(line)
                position = (shard.name, end, lines, end - len(line), hashlib.sha256(line).digest())
                self._connection.execute("INSERT OR REPLACE INTO shards VALUES (?, ?, ?, ?, ?)", position)
                if lines % _BATCH == 0:
                    self._connection.execute("COMMIT")
                    self._connection.execute("BEGIN IMMEDIATE")
                    progress(lines)
                    if self._is_stopped.is_set():
                        return

    def _add(self, shard: Path, number: int, offset: int, line: bytes) -> None:
        try:
            trajectory = decode(line)
            episode = trajectory.episode
            known = self._connection.execute(
                "SELECT number, outcome FROM rows WHERE id = ?", (episode.attempt_id,)
            ).fetchone()
            if known is not None and known[1] != Outcome.JUDGE_ERROR.value:
                raise ValueError(f"{episode.attempt_id} is recorded a second time")
        except (ValueError, RecursionError) as error:
            place = (f"{TRAJECTORIES}/{shard.name}", number, str(error))
            self._connection.execute("INSERT INTO corrupt VALUES (?, ?, ?)", place)
            return
        table_row = row(trajectory, self._tasks.get(episode.task_id))
        searched = (
            table_row[name] for name in ("id", "task", "site", "domain", "subdomain", "answer", "code")
        )
        values = [
            known[0] if known else None,
            *table_row.values(),
            list(Outcome).index(trajectory.outcome),
            "\n".join(searched).lower(),
            *(episode.task_id, episode.sample, episode.retry, shard.name, offset, len(line)),
        ]
        marks = ", ".join("?" * len(values))
        inserted = self._connection.execute(f"INSERT OR REPLACE INTO rows VALUES ({marks})", values)  # noqa: S608
        if known is not None:
            self._set_new_version()
        digest = msgspec.msgpack.encode(digest_of(trajectory))
        self._connection.execute("INSERT OR REPLACE INTO digests VALUES (?, ?)", (inserted.lastrowid, digest))


def _digest(shard: Path, start: int, end: int) -> bytes:
    """The SHA-256 of the bytes of a file between two offsets."""
    with shard.open("rb") as file:
        file.seek(start)
        return hashlib.sha256(file.read(end - start)).digest()
