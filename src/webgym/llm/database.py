"""The cache's SQLite file, and a thread that commits jobs on it in groups.

A commit costs one sync of the disk, whatever its size. So all jobs that were queued during the last commit
are
committed together: a single caller waits for one sync, a thousand callers share it.
"""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, TypeVar

from webgym.core.errors import CacheError

APPLICATION: Final = 0x57474C4D  # "WGLM"
VERSION: Final = 1

_SCHEMA: Final = """
create table replies (
    key blob primary key,          -- SHA-256 of the request, see request.Request.key
    body blob not null,            -- the endpoint's reply, byte by byte
    crc integer not null,          -- CRC-32 of the body
    seconds real not null,
    at real not null               -- seconds since 1970
);
create table calls (               -- every one that was paid for, also those whose reply lost a race
    id integer primary key autoincrement,
    key blob not null,
    purpose text not null,
    model text not null,
    prompt_tokens integer not null,
    prompt_tokens_cached integer not null,
    completion_tokens integer not null,
    dollars real,                  -- null where the price was not known
    is_estimate integer not null,
    batch text unique,             -- the endpoint's id of a request in a batch
    at real not null
);
create table hits (
    purpose text not null,
    model text not null,
    count integer not null,
    primary key (purpose, model)
) without rowid;
create table noted (               -- requests that are to be answered in a batch
    key blob primary key,
    purpose text not null,
    model text not null,
    body blob not null,            -- of the request
    written integer not null default 0
);
create table formats (             -- what an endpoint takes as response_format
    endpoint text not null,
    model text not null,
    format text not null,
    primary key (endpoint, model)
) without rowid;
"""

T = TypeVar("T")
Job = Callable[[sqlite3.Connection], Any]


def connect(path: Path, busy_seconds: float) -> sqlite3.Connection:
    """Open the file, which is created if it does not exist or is empty.

    Raises:
        CacheError: it belongs to another program, has another version, is damaged, or cannot be accessed.
    """
    try:
        # Without implicit transactions.
        connection = sqlite3.connect(
            path, timeout=busy_seconds, isolation_level=None, check_same_thread=False
        )
    except sqlite3.Error as error:
        raise failure(path, error) from error
    try:
        _create_schema(connection, path)
        # A commit is safely on disk when it returns; readers and the writer do not wait for each other.
        # Jobs share commits, so that the syncs cost little.
        connection.execute("pragma journal_mode = wal")
        connection.execute("pragma synchronous = full")
    except sqlite3.Error as error:
        connection.close()
        raise failure(path, error) from error
    except BaseException:
        connection.close()
        raise
    return connection


def _create_schema(connection: sqlite3.Connection, path: Path) -> None:
    """Create the tables if the file is empty; check that it belongs to this program before writing to it."""
    if _has_schema(connection, path):
        return
    connection.execute("begin immediate")  # a concurrent process then finds the tables
    try:
        if not _has_schema(connection, path):
            for statement in _SCHEMA.split(";"):
                connection.execute(statement)
            connection.execute(f"pragma application_id = {APPLICATION}")
            connection.execute(f"pragma user_version = {VERSION}")
        connection.execute("commit")
    except BaseException:
        connection.rollback()
        raise


def _has_schema(connection: sqlite3.Connection, path: Path) -> bool:
    """Whether the file has the tables.

    Raises:
        CacheError: it belongs to another program, or has another version.
    """
    [application] = connection.execute("pragma application_id").fetchone()
    [version] = connection.execute("pragma user_version").fetchone()
    [tables] = connection.execute("select count(*) from sqlite_master").fetchone()
    if application == APPLICATION:
        if version != VERSION:
            hint = "use the release that wrote it, or another file"
            raise CacheError(f"{path} has version {version} of the format", hint=hint)
        return True
    if application or version or tables:
        hint = "name another file; it is created if it does not exist"
        raise CacheError(f"{path} is a database of another program, not a cache of replies", hint=hint)
    return False


def failure(path: Path, error: sqlite3.Error) -> CacheError:
    """The error for an error of SQLite."""
    message = str(error)
    hint = "is it a cache of replies? name another file, or move this one away"
    if "locked" in message or "busy" in message:
        hint = "another process uses it; try again when it is done"
    elif "unable to open" in message or "readonly" in message:
        hint = "does the folder exist, and is it writable?"
    elif "full" in message or "disk I/O" in message:
        hint = "free disk space; stored replies are kept"
    return CacheError(f"the replies in {path} cannot be used: {message}", hint=hint)


class Worker:
    """A thread with a connection. Waiting jobs are run together, in order.

    Args:
        path: the file, for errors.
        connection: used and closed only by the thread from now on.
        most: most jobs in one group.
        commit: whether a group is one transaction. Then all jobs of a group fail if one fails.
        afterwards: called in the thread after each committed group.
        tell: called on the event loop with the result of ``afterwards``, before the callers of the jobs
            continue.
    """

    def __init__(
        self,
        path: Path,
        connection: sqlite3.Connection,
        *,
        most: int,
        commit: bool,
        afterwards: Callable[[sqlite3.Connection], T] | None = None,
        tell: Callable[[T], None] | None = None,
    ) -> None:
        self._path = path
        self._connection = connection
        self._most = most
        self._commit = commit
        self._afterwards: Callable[[sqlite3.Connection], Any] = afterwards or (lambda _: None)
        self._tell: Callable[[Any], None] = tell or (lambda _: None)
        self._loop = asyncio.get_running_loop()
        self._waiting: SimpleQueue[tuple[Job, asyncio.Future[Any]] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=f"llm-cache-{path.name}", daemon=True)
        self._thread.start()

    def do(self, job: Callable[[sqlite3.Connection], T]) -> asyncio.Future[T]:
        """Run a job in the thread, even if the future is cancelled.

        The future raises :class:`CacheError` if the file cannot be read or written.
        """
        future: asyncio.Future[T] = self._loop.create_future()
        self._waiting.put((job, future))
        return future

    async def close(self) -> None:
        """Run the waiting jobs, then close the connection."""
        self._waiting.put(None)
        await asyncio.to_thread(self._thread.join)

    def _run(self) -> None:
        continues = True
        while continues:
            group, continues = self._next_group()
            if group:
                self._run_group(group)
        self._connection.close()

    def _next_group(self) -> tuple[list[tuple[Job, asyncio.Future[Any]]], bool]:
        group = []
        item = self._waiting.get()
        while item is not None:
            group.append(item)
            if len(group) == self._most:
                return group, True
            try:
                item = self._waiting.get_nowait()
            except Empty:
                return group, True
        return group, False

    def _run_group(self, group: Sequence[tuple[Job, asyncio.Future[Any]]]) -> None:
        jobs, futures = zip(*group, strict=True)
        news = None
        if self._commit:
            results, news = self._run_transaction(jobs)
        else:
            results = [self._run_job(job) for job in jobs]
        if not self._loop.is_closed():  # otherwise no caller waits any more
            self._loop.call_soon_threadsafe(self._deliver, futures, results, news)

    def _run_job(self, job: Job) -> Any:
        """The result of a job, or its error in a :class:`_Failed`, to be raised on the event loop."""
        try:
            return job(self._connection)
        except sqlite3.Error as error:
            return _Failed(failure(self._path, error))
        except BaseException as error:
            return _Failed(error)

    def _run_transaction(self, jobs: Sequence[Job]) -> tuple[list[Any], Any]:
        def transaction(connection: sqlite3.Connection) -> tuple[list[Any], Any]:
            connection.execute("begin immediate")
            try:
                results = [job(connection) for job in jobs]
                connection.execute("commit")
            except BaseException:
                connection.rollback()
                raise
            return results, self._afterwards(connection)

        outcome = self._run_job(transaction)
        return ([outcome] * len(jobs), None) if isinstance(outcome, _Failed) else outcome

    def _deliver(self, futures: Sequence[asyncio.Future[Any]], results: Sequence[Any], news: Any) -> None:
        if news is not None:
            self._tell(news)
        for future, result in zip(futures, results, strict=True):
            if future.done():
                continue
            if isinstance(result, _Failed):
                future.set_exception(result.error)
            else:
                future.set_result(result)


class _Failed:
    def __init__(self, error: BaseException) -> None:
        self.error = error
