"""An index of a run's trajectories for its pages, in SQLite beside the run: ``.index.sqlite``.

It is made from the shards and may be deleted at any time. It grows as they do, by reading only what is new;
where they are not what was read before, as after ``webgym verify --set-aside``, it is made anew. Where it
cannot be written, it lives in memory.
"""

from __future__ import annotations

import hashlib
import sqlite3
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import msgspec

from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.report.content import Row, row
from webgym.rollout.files import TASKS, TRAJECTORIES
from webgym.rollout.records import CorruptLine, Entry, decode
from webgym.rollout.summary import Digest, digest_of

INDEX: Final = ".index.sqlite"
_VERSION: Final = 1
_BATCH: Final = 500
"""Trajectories between two commits: what a killed viewer has read is not read again."""

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
    """Which trajectories, and in which order.

    Attributes:
        q: words that all stand in the task, the website, the answer or the id; case does not count.
        outcome, level, domain, site: exactly this; empty for any.
        sort: the column of the table; empty for the order in which they ended.
        down: the greatest first.
    """

    q: str = ""
    outcome: str = ""
    level: str = ""
    domain: str = ""
    site: str = ""
    sort: str = ""
    down: bool = False

    def where(self) -> tuple[str, list[str]]:
        """The condition in SQL, and what stands for its question marks."""
        words = self.q.lower().split()
        exact = [(name, value) for name in _FILTERS if (value := getattr(self, name))]
        conditions = [f"{name} = ?" for name, _ in exact] + ["instr(search, ?)"] * len(words)
        return " AND ".join(conditions) or "1", [value for _, value in exact] + words

    def order(self) -> str:
        """The order in SQL."""
        if (by := _ORDERS.get(self.sort)) is None:
            return "number"
        return f"{by} {'DESC' if self.down else 'ASC'}, number"


class RunIndex:
    """The index of a run. Blocks; one call at a time, from any thread.

    Args:
        run: the run folder.
        tasks: of the run, by id.
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
        except sqlite3.OperationalError:  # a folder that may only be read
            return self._prepared(":memory:")
        except sqlite3.DatabaseError:  # it is broken
            path.unlink()
            return self._prepared(path)

    def _prepared(self, path: Path | str) -> sqlite3.Connection:
        connection = sqlite3.connect(path, timeout=60, isolation_level=None, check_same_thread=False)
        try:
            connection.execute("PRAGMA synchronous = OFF")  # a machine that loses power has it made anew
            connection.execute("BEGIN IMMEDIATE")
            for statement in filter(str.strip, _SCHEMA.split(";")):
                connection.execute(statement)
            connection.execute("COMMIT")
        except BaseException:
            connection.close()
            raise
        return connection

    def stop(self) -> None:
        """End a reading that is under way soon: what was read is kept. May be called from any thread."""
        self._is_stopped.set()

    def close(self) -> None:
        """Let the index go."""
        self._connection.close()

    # --- what is known ------------------------------------------------------------------------------

    def __len__(self) -> int:
        return self._one("SELECT count(*) FROM rows", int)

    @property
    def corrupt(self) -> list[CorruptLine]:
        """The lines that are no records."""
        found = self._connection.execute("SELECT file, line, reason FROM corrupt ORDER BY file, line")
        return [CorruptLine(*each) for each in found]

    @property
    def version(self) -> str:
        """Another one whenever known rows have changed, so that what was made from them is out of date."""
        return self.kept("version", str) or ""

    def find(self, wanted: TrajectoryQuery, after: int, count: int) -> tuple[int, list[Row]]:
        """How many trajectories fit, and so many of them after the first so many."""
        where, values = wanted.where()
        total = self._one(f"SELECT count(*) FROM rows WHERE {where}", int, *values)  # noqa: S608 - our own words
        chosen = f"FROM rows WHERE {where} ORDER BY {wanted.order()} LIMIT ? OFFSET ?"
        found = self._connection.execute(f"SELECT {', '.join(_COLUMNS)} {chosen}", [*values, count, after])
        return total, [msgspec.convert(dict(zip(_COLUMNS, each, strict=True)), Row) for each in found]

    def options(self) -> dict[str, list[str]]:
        """What there is to choose from: the values of each filter."""
        found = {name: self._connection.execute(f"SELECT DISTINCT {name} FROM rows") for name in _FILTERS}  # noqa: S608
        return {name: [value for (value,) in values if value] for name, values in found.items()}

    def entry(self, attempt_id: str) -> Entry:
        """Where a trajectory lies.

        Raises:
            KeyError: there is none of this id.
        """
        found = self._connection.execute(
            "SELECT id, task_id, sample, retry, outcome, shard, offset, length FROM rows WHERE id = ?",
            (attempt_id,),
        ).fetchone()
        if found is None:
            raise KeyError(attempt_id)
        return msgspec.convert(found, Entry)

    def digests(self, after: int) -> Iterator[Digest]:
        """Of all trajectories but the first so many, in the order in which they ended."""
        decoder = msgspec.msgpack.Decoder(Digest)
        found = self._connection.execute(
            "SELECT digest FROM digests WHERE number > ? ORDER BY number", (after,)
        )
        return (decoder.decode(each) for (each,) in found)

    def kept(self, name: str, kind: type[T]) -> T | None:
        """What :meth:`keep` was given last under this name; ``None`` if it is nothing of this kind."""
        found = self._connection.execute("SELECT value FROM meta WHERE name = ?", (name,)).fetchone()
        try:
            return msgspec.json.decode(found[0], type=kind) if found else None
        except msgspec.MsgspecError:
            return None

    def keep(self, name: str, value: Any) -> None:
        """Keep something that was made from the rows, for the next who opens the index."""
        data = msgspec.json.encode(value)
        self._connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (name, data))

    def _one(self, query: str, kind: type[T], *values: Any) -> T:
        return msgspec.convert(self._connection.execute(query, values).fetchone()[0], kind)

    # --- keeping up ---------------------------------------------------------------------------------

    def refresh(self, told: Callable[[int], object] = lambda _: None) -> None:
        """Take in what was written since.

        Args:
            told: now and then, how many records of the shard that is read have been.
        """
        shards = sorted((self._run / TRAJECTORIES).glob("*.jsonl"))
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            if not self._continues(shards):
                for table in _TABLES:
                    self._connection.execute(f"DELETE FROM {table}")  # noqa: S608 - our own words
                self._connection.execute("INSERT INTO meta VALUES ('made_for', ?)", (self._made_for(),))
                self._change()
            for shard in shards:
                self._read(shard, told)
        finally:
            self._connection.execute("COMMIT")  # also of an unfinished reading: every line is whole

    def _change(self) -> None:
        self.keep("version", uuid.uuid4().hex)

    def _made_for(self) -> bytes:
        """What rows were made with, beside the shards."""
        tasks = (self._run / TASKS).stat()
        return msgspec.json.encode([_VERSION, tasks.st_size, tasks.st_mtime_ns])

    def _continues(self, shards: list[Path]) -> bool:
        """Whether the shards begin with what was read of them."""
        made_for = self._connection.execute("SELECT value FROM meta WHERE name = 'made_for'").fetchone()
        if made_for != (self._made_for(),):
            return False
        known = self._connection.execute("SELECT name, end, last, digest FROM shards").fetchall()
        there = {shard.name: shard for shard in shards}
        return all(
            name in there and _digest(there[name], last, end) == digest for name, end, last, digest in known
        )

    def _read(self, shard: Path, told: Callable[[int], object]) -> None:
        found = self._connection.execute(
            "SELECT end, lines FROM shards WHERE name = ?", (shard.name,)
        ).fetchone()
        end, lines = found or (0, 0)
        if shard.stat().st_size == end or self._is_stopped.is_set():
            return
        with shard.open("rb") as file:
            file.seek(end)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                lines += 1
                self._take(shard, lines, end, line)
                end += len(line)
                at = (shard.name, end, lines, end - len(line), hashlib.sha256(line).digest())
                self._connection.execute("INSERT OR REPLACE INTO shards VALUES (?, ?, ?, ?, ?)", at)
                if lines % _BATCH == 0:
                    self._connection.execute("COMMIT")
                    self._connection.execute("BEGIN IMMEDIATE")
                    told(lines)
                    if self._is_stopped.is_set():
                        return

    def _take(self, shard: Path, number: int, offset: int, line: bytes) -> None:
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
        shown = row(trajectory, self._tasks.get(episode.task_id))
        searched = (shown[name] for name in ("id", "task", "site", "domain", "subdomain", "answer", "code"))
        values = [
            known[0] if known else None,
            *shown.values(),
            list(Outcome).index(trajectory.outcome),
            "\n".join(searched).lower(),
            *(episode.task_id, episode.sample, episode.retry, shard.name, offset, len(line)),
        ]
        marks = ", ".join("?" * len(values))
        kept = self._connection.execute(f"INSERT OR REPLACE INTO rows VALUES ({marks})", values)  # noqa: S608
        if known is not None:
            self._change()
        digest = msgspec.msgpack.encode(digest_of(trajectory))
        self._connection.execute("INSERT OR REPLACE INTO digests VALUES (?, ?)", (kept.lastrowid, digest))


def _digest(shard: Path, start: int, end: int) -> bytes:
    """Of the bytes of a file between two offsets."""
    with shard.open("rb") as file:
        file.seek(start)
        return hashlib.sha256(file.read(end - start)).digest()
