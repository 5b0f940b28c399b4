"""An SQLite file of ours, and a thread that works on it in groups.

A commit costs one wait for the disk, however much it holds. So whatever has queued up while the last commit
ran goes into the next one together: a single caller waits for one sync, a thousand callers share it.
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
    """Open the file; made if it is not there or empty.

    Raises:
        CacheError: it is somebody else's, of a newer version, damaged, or out of reach.
    """
    try:
        # Transactions are begun and ended by hand.
        connection = sqlite3.connect(
            path, timeout=busy_seconds, isolation_level=None, check_same_thread=False
        )
    except sqlite3.Error as error:
        raise failure(path, error) from error
    try:
        _make_ours(connection, path)
        # A commit is on disk, power loss included, when it returns; readers and the writer do not wait
        # for each other. Commits are shared, so that the sync costs little.
        connection.execute("pragma journal_mode = wal")
        connection.execute("pragma synchronous = full")
    except sqlite3.Error as error:
        connection.close()
        raise failure(path, error) from error
    except BaseException:
        connection.close()
        raise
    return connection


def _make_ours(connection: sqlite3.Connection, path: Path) -> None:
    """Check whose file it is, before anything is written to it."""
    if _is_ours(connection, path):
        return
    connection.execute("begin immediate")  # whoever comes second finds the file made
    try:
        if not _is_ours(connection, path):
            for statement in _SCHEMA.split(";"):
                connection.execute(statement)
            connection.execute(f"pragma application_id = {APPLICATION}")
            connection.execute(f"pragma user_version = {VERSION}")
        connection.execute("commit")
    except BaseException:
        connection.rollback()
        raise


def _is_ours(connection: sqlite3.Connection, path: Path) -> bool:
    """Whether the file is made already; an error if it is somebody else's."""
    [application] = connection.execute("pragma application_id").fetchone()
    [version] = connection.execute("pragma user_version").fetchone()
    [tables] = connection.execute("select count(*) from sqlite_master").fetchone()
    if application == APPLICATION:
        if version != VERSION:
            hint = "use the release that wrote it, or another file"
            raise CacheError(f"{path} holds replies in version {version} of the format", hint=hint)
        return True
    if application or version or tables:
        hint = "name another file: what is not there is made"
        raise CacheError(f"{path} is a database of another program, not a cache of replies", hint=hint)
    return False


def failure(path: Path, error: sqlite3.Error) -> CacheError:
    """What SQLite says, in our terms."""
    said = str(error)
    hint = "is it a cache of replies? name another file, or move this one away"
    if "locked" in said or "busy" in said:
        hint = "another process holds it; try again when it is done"
    elif "unable to open" in said or "readonly" in said:
        hint = "is the folder there, and may it be written to?"
    elif "full" in said or "disk I/O" in said:
        hint = "make room on the disk; what was stored before is kept"
    return CacheError(f"the replies in {path} cannot be used: {said}", hint=hint)


class Worker:
    """A thread with a connection. Jobs that wait are done together, in their order.

    Args:
        path: the file, for what errors say.
        connection: used by the thread alone from now on, and closed by it.
        most: jobs in one group.
        commit: whether a group is one transaction. Then if one job fails, all of them do.
        afterwards: called in the thread after each group; what it returns goes to ``tell`` on the event
            loop, before any job's caller goes on.
        tell: see there.
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
        """Have a job done. It is done whatever becomes of the future.

        The future raises :class:`CacheError` if the file cannot be read or written.
        """
        future: asyncio.Future[T] = self._loop.create_future()
        self._waiting.put((job, future))
        return future

    async def close(self) -> None:
        """Do what waits, then close the connection."""
        self._waiting.put(None)
        await asyncio.to_thread(self._thread.join)

    def _run(self) -> None:
        goes_on = True
        while goes_on:
            group, goes_on = self._next_group()
            if group:
                self._do_group(group)
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

    def _do_group(self, group: Sequence[tuple[Job, asyncio.Future[Any]]]) -> None:
        jobs, futures = zip(*group, strict=True)
        told = None
        if self._commit:
            results, told = self._written(jobs)
        else:
            results = [self._tried(job) for job in jobs]
        if not self._loop.is_closed():  # else nobody waits any more
            self._loop.call_soon_threadsafe(self._deliver, futures, results, told)

    def _tried(self, job: Job) -> Any:
        """What a job returns, or its error in a :class:`_Failed`: the loop's business, not the thread's."""
        try:
            return job(self._connection)
        except sqlite3.Error as error:
            return _Failed(failure(self._path, error))
        except BaseException as error:
            return _Failed(error)

    def _written(self, jobs: Sequence[Job]) -> tuple[list[Any], Any]:
        def transaction(connection: sqlite3.Connection) -> tuple[list[Any], Any]:
            connection.execute("begin immediate")
            try:
                results = [job(connection) for job in jobs]
                connection.execute("commit")
            except BaseException:
                connection.rollback()
                raise
            return results, self._afterwards(connection)

        outcome = self._tried(transaction)
        return ([outcome] * len(jobs), None) if isinstance(outcome, _Failed) else outcome

    def _deliver(self, futures: Sequence[asyncio.Future[Any]], results: Sequence[Any], told: Any) -> None:
        if told is not None:
            self._tell(told)
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
