"""A cache of replies, keyed by the complete request.

A reply is on disk before its caller gets it. The file is an SQLite database in write-ahead mode with full
syncs: kill -9 at any moment, or a power loss, loses no reply that a caller has received. Several processes on
one machine may use one file (not over a network file system).
"""

from __future__ import annotations

import asyncio
import sqlite3
import time
import zlib
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any, Self, TypeVar

import msgspec

from webgym.core.errors import CacheError
from webgym.llm.config import CacheLimits
from webgym.llm.database import Worker, connect, failure
from webgym.llm.usage import Call, Totals, Usage

T = TypeVar("T")


class CachedReply(msgspec.Struct, frozen=True, gc=False):
    """A reply as it was received.

    Attributes:
        body: body of the response, unchanged.
        seconds: wall time of the request.
    """

    body: bytes
    seconds: float


class NewReply(msgspec.Struct, frozen=True, gc=False):
    """A reply that was just received, and the record of its call."""

    reply: CachedReply
    call: Call


class ReplyCache:
    """Replies in a file, for any number of clients. Open it first.

        async with ReplyCache("replies.sqlite") as cache, ChatClient(config, cache=cache) as client:
            ...

    Args:
        path: the file; created if it does not exist.
        limits: timeouts and sizes.

    Attributes:
        path: the file.
        totals: usage by all processes since the file was created, of paid calls and of cache hits.

    Raises:
        CacheError: on opening: the file belongs to another program, is damaged, or cannot be accessed.
    """

    def __init__(self, path: str | Path, limits: CacheLimits | None = None) -> None:
        self.path = Path(path)
        self.totals = Totals()
        self._limits = limits or CacheLimits()
        self._last_call = 0
        self._hits: dict[tuple[str, str], int] = {}
        self._requests: dict[bytes, asyncio.Future[CachedReply]] = {}
        self._writing: dict[bytes, asyncio.Future[CachedReply]] = {}
        self._reader: Worker | None = None
        self._writer: Worker | None = None

    async def __aenter__(self) -> Self:
        busy = self._limits.busy_seconds
        writing = await asyncio.to_thread(self._open, busy)
        try:
            reading = await asyncio.to_thread(connect, self.path, busy)
        except BaseException:
            writing.close()
            raise
        most = self._limits.group
        self._reader = Worker(self.path, reading, most=most, commit=False)
        self._writer = Worker(
            self.path, writing, most=most, commit=True, afterwards=self._new_calls, tell=self._count_calls
        )
        return self

    async def __aexit__(self, *exc: object) -> None:
        if self._writer is None or self._reader is None:
            return
        try:
            if hits := self._take_hits():
                await self._writer.do(lambda connection: _add_hits(connection, hits))
        finally:
            await self._writer.close()
            await self._reader.close()
            self._writer = self._reader = None

    # --- replies --------------------------------------------------------------------------------------

    async def get(self, key: bytes) -> CachedReply | None:
        """The reply to a request, if it is in the cache.

        Raises:
            CacheError: the file cannot be read, or the stored reply is damaged.
        """
        if (writing := self._writing.get(key)) is not None:
            return await asyncio.shield(writing)
        return await self.read(lambda connection: _select(connection, key))

    async def put(self, key: bytes, fresh: NewReply) -> CachedReply:
        """Store a reply and the record of its call in one transaction; on disk when this returns.

        Completed even if the caller is cancelled.

        Returns:
            The stored reply: an earlier one, if another process was faster, so that all continue with the
            same reply.

        Raises:
            CacheError: the file cannot be written.
        """
        hits = self._take_hits()

        def job(connection: sqlite3.Connection) -> CachedReply:
            _add_hits(connection, hits)
            return insert(connection, key, fresh.reply, fresh.call)

        writing = self._writing[key] = self.write(job)
        writing.add_done_callback(lambda _: self._written(key, writing))
        return await asyncio.shield(writing)

    async def discarded(self, key: bytes, call: Call) -> None:
        """Store the record of a call whose reply cannot be used.

        Raises:
            CacheError: the file cannot be written.
        """
        await asyncio.shield(self.write(lambda connection: insert_call(connection, key, call)))

    async def answer(
        self, key: bytes, ask: Callable[[], AbstractAsyncContextManager[NewReply]]
    ) -> tuple[CachedReply, bool]:
        """The reply to a request, which is sent if the reply is not in the cache. Identical requests share
        one call.

        Args:
            key: key of the request.
            ask: sends the request; its context is exited when the reply is on disk.

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
                    reply, was_stored = await self.put(key, fresh), False
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

    # --- for other modules of the package ---------------------------------------------------------------

    def read(self, job: Callable[[sqlite3.Connection], T]) -> asyncio.Future[T]:
        """Run a job on the reading connection, in its thread."""
        return _opened(self._reader).do(job)

    def write(self, job: Callable[[sqlite3.Connection], T]) -> asyncio.Future[T]:
        """Run a job in the writing thread's next transaction; committed when the future is done."""
        return _opened(self._writer).do(job)

    def _written(self, key: bytes, writing: asyncio.Future[CachedReply]) -> None:
        if self._writing.get(key) is writing:
            del self._writing[key]
        if not writing.cancelled():
            writing.exception()  # also raised to the caller of put, unless it was cancelled

    # --- totals -----------------------------------------------------------------------------------------

    def _open(self, busy_seconds: float) -> sqlite3.Connection:
        connection = connect(self.path, busy_seconds)
        try:
            self.totals, self._last_call = read_totals(connection)
        except sqlite3.Error as error:
            connection.close()
            raise failure(self.path, error) from error
        return connection

    def _new_calls(self, connection: sqlite3.Connection) -> tuple[int, list[Any]]:
        """Calls that were recorded since the last query, by any process."""
        rows = connection.execute(
            "select id, purpose, model, prompt_tokens, completion_tokens, prompt_tokens_cached, dollars,"
            " is_estimate, coalesce(batch, '') from calls where id > ? order by id",
            [self._last_call],
        ).fetchall()
        self._last_call = rows[-1][0] if rows else self._last_call
        return self._last_call, rows

    def _count_calls(self, new_calls: tuple[int, list[Any]]) -> None:
        for _, purpose, model, prompt, completion, cached, dollars, is_estimate, batch in new_calls[1]:
            self.totals.paid(
                Call(purpose, model, prompt, completion, cached, dollars, bool(is_estimate), batch)
            )

    def _take_hits(self) -> dict[tuple[str, str], int]:
        hits, self._hits = self._hits, {}
        return hits


def _opened(worker: Worker | None) -> Worker:
    if worker is None:
        raise RuntimeError("the cache is not open: use it in an async with statement")
    return worker


# --- statements -----------------------------------------------------------------------------------------


def insert(connection: sqlite3.Connection, key: bytes, reply: CachedReply, call: Call) -> CachedReply:
    """Store a reply and its call inside a transaction; returns the stored reply."""
    added = connection.execute(
        "insert or ignore into replies values (?, ?, ?, ?, ?)",
        [key, reply.body, zlib.crc32(reply.body), reply.seconds, time.time()],
    ).rowcount
    insert_call(connection, key, call)
    return reply if added else (_select(connection, key) or reply)


def insert_call(connection: sqlite3.Connection, key: bytes, call: Call) -> None:
    """Store the record of a call. A batch result that is imported twice was paid for once."""
    connection.execute(
        "insert or ignore into calls values (null, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [
            key,
            call.purpose,
            call.model,
            call.prompt_tokens,
            call.prompt_tokens_cached,
            call.completion_tokens,
            call.dollars,
            call.is_estimate,
            call.batch or None,
            time.time(),
        ],
    )


def _select(connection: sqlite3.Connection, key: bytes) -> CachedReply | None:
    row = connection.execute("select body, crc, seconds from replies where key = ?", [key]).fetchone()
    if row is None:
        return None
    body, crc, seconds = row
    if zlib.crc32(body) != crc:
        hint = "the disk or a copy is damaged; restore the file, or delete the reply and pay for it again"
        raise CacheError(f"the reply {key.hex()} does not match its checksum", hint=hint)
    return CachedReply(body, seconds)


def _add_hits(connection: sqlite3.Connection, hits: Mapping[tuple[str, str], int]) -> None:
    connection.executemany(
        "insert into hits values (?, ?, ?) on conflict do update set count = count + excluded.count",
        [(purpose, model, count) for (purpose, model), count in hits.items()],
    )


def read_totals(connection: sqlite3.Connection) -> tuple[Totals, int]:
    """The totals of the file, and the id of the last call that they include."""
    totals = Totals()
    connection.execute("begin")
    rows = connection.execute(
        "select purpose, model, count(*), count(batch), sum(prompt_tokens), sum(prompt_tokens_cached),"
        " sum(completion_tokens), total(dollars), sum(dollars is null), sum(is_estimate)"
        " from calls group by purpose, model"
    ).fetchall()
    for purpose, model, calls, batched, *rest in rows:
        totals.add(purpose, model, Usage(calls, 0, batched, *rest))
    for purpose, model, count in connection.execute("select purpose, model, count from hits"):
        totals.hit(purpose, model, count)
    [last] = connection.execute("select coalesce(max(id), 0) from calls").fetchone()
    connection.execute("commit")
    return totals, last
