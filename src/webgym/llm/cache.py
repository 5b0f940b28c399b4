"""A cache of replies in an SQLite file, keyed by the complete request.

A reply is on disk before its caller gets it: in write-ahead mode with full syncs, kill -9 at any moment, or a
power loss, loses no reply that a caller has received. Several processes on one machine may use one file (not
over a network file system).
"""

from __future__ import annotations

import asyncio
import sqlite3
import time
import zlib
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any, Final, Self, TypeVar

import msgspec

from webgym.core.errors import CacheError
from webgym.llm.prices import Call, Totals, Usage

_APPLICATION: Final = 0x57474C4D  # "WGLM"
_VERSION: Final = 1
_BUSY_SECONDS: Final = 30.0
"""How long to wait while another process writes."""

_SCHEMA: Final = f"""
begin immediate;
create table if not exists replies (
    key blob primary key,          -- SHA-256 of the request, see request.Request.key
    body blob not null,            -- the endpoint's reply, byte by byte
    crc integer not null,          -- CRC-32 of the body
    seconds real not null,
    at real not null               -- seconds since 1970
);
create table if not exists calls ( -- every one that was paid for, also those whose reply lost a race
    id integer primary key autoincrement, key blob not null, purpose text not null, model text not null,
    prompt_tokens integer not null, prompt_tokens_cached integer not null, completion_tokens integer not null,
    dollars real,                  -- null where the price was not known
    is_estimate integer not null,
    batch text unique,             -- the endpoint's id of a request in a batch
    at real not null
);
create table if not exists hits (
    purpose text not null, model text not null, count integer not null, primary key (purpose, model)
) without rowid;
create table if not exists noted ( -- requests that are to be answered in a batch
    key blob primary key, purpose text not null, model text not null,
    body blob not null,            -- of the request
    written integer not null default 0
);
create table if not exists formats ( -- what an endpoint takes as response_format
    endpoint text not null, model text not null, format text not null, primary key (endpoint, model)
) without rowid;
pragma application_id = {_APPLICATION};
pragma user_version = {_VERSION};
commit;
"""

_HINTS: Final = {
    "locked": "another process uses it; try again when it is done",
    "unable to open": "does the folder exist, and is it writable?",
    "readonly": "does the folder exist, and is it writable?",
    "full": "free disk space; stored replies are kept",
    "disk I/O": "free disk space; stored replies are kept",
}

T = TypeVar("T")


class CachedReply(msgspec.Struct, frozen=True, gc=False):
    """A reply as it was received.

    Attributes:
        body: body of the response, unchanged.
        seconds: wall time of the request.
    """

    body: bytes
    seconds: float


class ReplyCache:
    """Replies in a file, for any number of clients. Open it first.

        async with ReplyCache("replies.sqlite") as cache, ChatClient(config, cache=cache) as client:
            ...

    What is asked of the file is done in a thread, one job after the other.

    Args:
        path: the file; created if it does not exist.
        busy_seconds: how long to wait while another process writes.

    Attributes:
        path: the file.
        totals: usage by all processes since the file was created, of paid calls and of cache hits.

    Raises:
        CacheError: on opening: the file belongs to another program, is damaged, or cannot be accessed.
    """

    def __init__(self, path: str | Path, *, busy_seconds: float = _BUSY_SECONDS) -> None:
        self.path = Path(path)
        self.totals = Totals()
        self._busy_seconds = busy_seconds
        self._last_call = 0
        self._hits: dict[tuple[str, str], int] = {}
        self._requests: dict[bytes, asyncio.Future[CachedReply]] = {}
        self._thread: ThreadPoolExecutor | None = None
        self._connection: sqlite3.Connection | None = None

    async def __aenter__(self) -> Self:
        self._connection = await asyncio.to_thread(_connect, self.path, self._busy_seconds)
        self._thread = ThreadPoolExecutor(1, f"llm-cache-{self.path.name}")
        self.totals, self._last_call = Totals(), 0
        try:
            self._count(await self.read(self._select_calls))
            hits = "select purpose, model, count from hits"
            for purpose, model, count in await self.read(lambda reading: reading.execute(hits).fetchall()):
                self.totals.hit(purpose, model, count)
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        try:
            if self._connection is not None and (hits := self._take_hits()):
                await self.write(lambda connection: _add_hits(connection, hits))
        finally:
            await self._close()

    async def _close(self) -> None:
        """Do what was asked for, then close the file."""
        if self._connection is None or self._thread is None:
            return
        connection, self._connection = self._connection, None
        await asyncio.get_running_loop().run_in_executor(self._thread, connection.close)
        self._thread.shutdown()

    # --- replies --------------------------------------------------------------------------------------

    async def get(self, key: bytes) -> CachedReply | None:
        """The reply to a request, if it is in the cache.

        Raises:
            CacheError: the file cannot be read, or the stored reply is damaged.
        """
        row = await self.read(
            lambda connection: connection.execute(
                "select body, crc, seconds from replies where key = ?", [key]
            ).fetchone()
        )
        if row is None:
            return None
        body, crc, seconds = row
        if zlib.crc32(body) != crc:
            hint = "the disk or a copy is damaged; restore the file, or delete the reply and pay for it again"
            raise CacheError(f"the reply {key.hex()} does not match its checksum", hint=hint)
        return CachedReply(body, seconds)

    async def put(self, key: bytes, reply: CachedReply, call: Call) -> CachedReply:
        """Store a reply and the record of its call in one transaction; on disk when this returns.

        Completed even if the caller is cancelled.

        Returns:
            The stored reply: an earlier one, if another process was faster, so that all continue with the
            same reply.

        Raises:
            CacheError: the file cannot be written, or the earlier reply is damaged.
        """
        hits = self._take_hits()

        def job(connection: sqlite3.Connection) -> bool:
            _add_hits(connection, hits)
            return insert(connection, key, reply, call)

        is_new = await self.write(job)
        return reply if is_new else (await self.get(key) or reply)

    async def discarded(self, key: bytes, call: Call) -> None:
        """Store the record of a call whose reply cannot be used.

        Raises:
            CacheError: the file cannot be written.
        """
        await self.write(lambda connection: _insert_call(connection, key, call))

    async def answer(
        self, key: bytes, ask: Callable[[], AbstractAsyncContextManager[tuple[CachedReply, Call]]]
    ) -> tuple[CachedReply, bool]:
        """The reply to a request, which is sent if the reply is not in the cache. Identical requests share
        one call.

        Args:
            key: key of the request.
            ask: sends the request, for the reply and the record of its call; its context is exited when they
                are on disk.

        Returns:
            The reply, and whether it came without sending the request.

        Raises:
            CacheError: the file cannot be read or written.
            LLMError: the request, or the identical one in flight, failed.
        """
        while (request := self._requests.get(key)) is not None:
            await asyncio.wait([request])
            if not request.cancelled():
                return request.result(), True
        request = self._requests[key] = asyncio.get_running_loop().create_future()
        try:
            if (stored := await self.get(key)) is not None:
                reply, was_stored = stored, True
            else:
                async with ask() as fresh:
                    reply, was_stored = await self.put(key, *fresh), False
        except Exception as error:
            request.set_exception(error)
            request.exception()  # retrieved here, because nobody else may wait for it
            raise
        except BaseException:
            request.cancel()
            raise
        else:
            request.set_result(reply)
        finally:
            del self._requests[key]
        return reply, was_stored

    def hit(self, purpose: str, model: str) -> None:
        """Count a call that was answered from the cache. On disk with the next reply, or on closing."""
        self.totals.hit(purpose, model)
        self._hits[purpose, model] = self._hits.get((purpose, model), 0) + 1

    def _take_hits(self) -> dict[tuple[str, str], int]:
        hits, self._hits = self._hits, {}
        return hits

    # --- the file ---------------------------------------------------------------------------------------

    async def read(self, job: Callable[[sqlite3.Connection], T]) -> T:
        """Run a job that only reads. It sees every write that was asked for before.

        Raises:
            CacheError: the file cannot be read.
        """
        return await self._in_thread(job)

    async def write(self, job: Callable[[sqlite3.Connection], T]) -> T:
        """Run a job in a transaction; on disk when this returns, also if the caller is cancelled.

        Raises:
            CacheError: the file cannot be written.
        """

        def transaction(connection: sqlite3.Connection) -> tuple[T, list[Any]]:
            with connection:
                connection.execute("begin immediate")
                result = job(connection)
            return result, self._select_calls(connection)

        async def counted(running: asyncio.Future[tuple[T, list[Any]]]) -> T:
            result, calls = await running
            self._count(calls)
            return result

        return await asyncio.shield(counted(self._in_thread(transaction)))

    def _in_thread(self, job: Callable[[sqlite3.Connection], T]) -> asyncio.Future[T]:
        if (connection := self._connection) is None:
            raise RuntimeError("the cache is not open: use it in an async with statement")

        def run() -> T:
            try:
                return job(connection)
            except sqlite3.Error as error:
                raise _failure(self.path, error) from error

        return asyncio.get_running_loop().run_in_executor(self._thread, run)

    # --- totals -----------------------------------------------------------------------------------------

    def _select_calls(self, connection: sqlite3.Connection) -> list[Any]:
        """Sums of the calls that any process recorded since the last query. Runs in the thread."""
        sums = connection.execute(
            "select max(id), purpose, model, count(*), count(batch), sum(prompt_tokens),"
            " sum(prompt_tokens_cached), sum(completion_tokens), total(dollars), sum(dollars is null),"
            " sum(is_estimate) from calls where id > ? group by purpose, model",
            [self._last_call],
        ).fetchall()
        self._last_call = max([self._last_call, *(last for last, *_ in sums)])
        return sums

    def _count(self, calls: list[Any]) -> None:
        for _, purpose, model, count, batched, *sums in calls:
            self.totals.add(purpose, model, Usage(count, 0, batched, *sums))


# --- statements -----------------------------------------------------------------------------------------


def insert(connection: sqlite3.Connection, key: bytes, reply: CachedReply, call: Call) -> bool:
    """Store a reply and its call inside a transaction; returns whether there was no reply before."""
    added = connection.execute(
        "insert or ignore into replies values (?, ?, ?, ?, ?)",
        [key, reply.body, zlib.crc32(reply.body), reply.seconds, time.time()],
    ).rowcount
    _insert_call(connection, key, call)
    return added > 0


def _insert_call(connection: sqlite3.Connection, key: bytes, call: Call) -> None:
    """Store the record of a call. A batch result that is imported twice was paid for once."""
    row = {field: getattr(call, field) for field in call.__struct_fields__}
    connection.execute(
        "insert or ignore into calls values (null, :key, :purpose, :model, :prompt_tokens,"
        " :prompt_tokens_cached, :completion_tokens, :dollars, :is_estimate, nullif(:batch, ''), :at)",
        row | {"key": key, "at": time.time()},
    )


def _add_hits(connection: sqlite3.Connection, hits: Mapping[tuple[str, str], int]) -> None:
    connection.executemany(
        "insert into hits values (?, ?, ?) on conflict do update set count = count + excluded.count",
        [(purpose, model, count) for (purpose, model), count in hits.items()],
    )


# --- opening --------------------------------------------------------------------------------------------


def _connect(path: Path, busy_seconds: float) -> sqlite3.Connection:
    """Open the file, which is created if it does not exist or is empty.

    Raises:
        CacheError: it belongs to another program, has another version, is damaged, or cannot be accessed.
    """
    connection = None
    try:
        # Without implicit transactions.
        connection = sqlite3.connect(
            path, timeout=busy_seconds, isolation_level=None, check_same_thread=False
        )
        if not _has_schema(connection, path):
            connection.executescript(_SCHEMA)
        connection.execute("pragma journal_mode = wal")
        connection.execute("pragma synchronous = full")
        return connection
    except BaseException as error:
        if connection is not None:
            connection.close()
        if isinstance(error, sqlite3.Error):
            raise _failure(path, error) from error
        raise


def _has_schema(connection: sqlite3.Connection, path: Path) -> bool:
    """Whether the file has the tables; nothing is written to it.

    Raises:
        CacheError: it belongs to another program, or has another version.
    """
    [application] = connection.execute("pragma application_id").fetchone()
    [version] = connection.execute("pragma user_version").fetchone()
    [tables] = connection.execute("select count(*) from sqlite_master").fetchone()
    if application == _APPLICATION and version != _VERSION:
        hint = "use the release that wrote it, or another file"
        raise CacheError(f"{path} has version {version} of the format", hint=hint)
    if application != _APPLICATION and (application or version or tables):
        hint = "name another file; it is created if it does not exist"
        raise CacheError(f"{path} is a database of another program, not a cache of replies", hint=hint)
    return bool(application)


def _failure(path: Path, error: sqlite3.Error) -> CacheError:
    message = str(error)
    hints = (hint for words, hint in _HINTS.items() if words in message)
    hint = next(hints, "is it a cache of replies? name another file, or move this one away")
    return CacheError(f"the replies in {path} cannot be used: {message}", hint=hint)
