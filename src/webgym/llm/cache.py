"""Replies that were paid for are kept, by the whole of their request.

A reply is on disk before its caller sees it. The file is SQLite in write-ahead mode with full syncs: kill -9
at any moment, or a power loss, loses no reply that a caller has seen. Several processes may use one file on
one machine (not over a network file system).
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
        body: byte by byte.
        seconds: how long it took.
    """

    body: bytes
    seconds: float


class NewReply(msgspec.Struct, frozen=True, gc=False):
    """A reply that has just come, and what it cost."""

    reply: CachedReply
    call: Call


class ReplyCache:
    """Replies in a file. Give it to any number of clients; open it first.

        async with ReplyCache("replies.sqlite") as cache, ChatClient(config, cache=cache) as client:
            ...

    Args:
        path: the file; made if it is not there.
        limits: how patient and how busy.

    Attributes:
        path: the file.
        totals: what was paid for and what was answered from here, all time, by all processes.

    Raises:
        CacheError: on opening: the file is foreign, damaged or out of reach.
    """

    def __init__(self, path: str | Path, limits: CacheLimits | None = None) -> None:
        self.path = Path(path)
        self.totals = Totals()
        self._limits = limits or CacheLimits()
        self._last_call = 0
        self._hits: dict[tuple[str, str], int] = {}
        self._flights: dict[bytes, asyncio.Future[CachedReply]] = {}
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
            self.path, writing, most=most, commit=True, afterwards=self._news, tell=self._count_news
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
        """The reply to a request, if it is here.

        Raises:
            CacheError: the file cannot be read, or the reply in it is damaged.
        """
        if (writing := self._writing.get(key)) is not None:
            return await asyncio.shield(writing)
        return await self.read(lambda connection: _select(connection, key))

    async def put(self, key: bytes, fresh: NewReply) -> CachedReply:
        """Keep a reply and note what it cost, in one transaction; on disk when this returns.

        Carried through even if the caller is cancelled.

        Returns:
            The reply that is kept: an earlier one, if another process was faster, so that all continue with
            the same.

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

    async def answer(
        self, key: bytes, ask: Callable[[], AbstractAsyncContextManager[NewReply]]
    ) -> tuple[CachedReply, bool]:
        """The reply to a request, asked for if it is not here. Identical requests are asked once at a time.

        Args:
            key: of the request.
            ask: its context is left when the reply is on disk.

        Returns:
            The reply, and whether it came without asking.

        Raises:
            CacheError: the file cannot be read or written.
            LLMError: the one who asked, or who asks already, got no reply.
        """
        while (flight := self._flights.get(key)) is not None:
            await asyncio.wait([flight])
            if not flight.cancelled():
                return flight.result(), True
        flight = self._flights[key] = asyncio.get_running_loop().create_future()
        try:
            if (found := await self.get(key)) is not None:
                reply, was_here = found, True
            else:
                async with ask() as fresh:
                    reply, was_here = await self.put(key, fresh), False
        except Exception as error:
            flight.set_exception(error)
            flight.exception()  # nobody else may be waiting for it
            raise
        except BaseException:
            flight.cancel()
            raise
        else:
            flight.set_result(reply)
        finally:
            del self._flights[key]
        return reply, was_here

    def hit(self, purpose: str, model: str) -> None:
        """Count a call that was answered from here. On disk with the next reply, or on closing."""
        self.totals.hit(purpose, model)
        self._hits[purpose, model] = self._hits.get((purpose, model), 0) + 1

    # --- for the neighbours -----------------------------------------------------------------------------

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
            writing.exception()  # told to whoever put it, if they are still there

    # --- totals -----------------------------------------------------------------------------------------

    def _open(self, busy_seconds: float) -> sqlite3.Connection:
        connection = connect(self.path, busy_seconds)
        try:
            self.totals, self._last_call = read_totals(connection)
        except sqlite3.Error as error:
            connection.close()
            raise failure(self.path, error) from error
        return connection

    def _news(self, connection: sqlite3.Connection) -> tuple[int, list[Any]]:
        """Calls that were paid for since the last look, by whatever process."""
        rows = connection.execute(
            "select id, purpose, model, prompt_tokens, completion_tokens, prompt_tokens_cached, dollars,"
            " is_estimate, coalesce(batch, '') from calls where id > ? order by id",
            [self._last_call],
        ).fetchall()
        self._last_call = rows[-1][0] if rows else self._last_call
        return self._last_call, rows

    def _count_news(self, news: tuple[int, list[Any]]) -> None:
        for _, purpose, model, prompt, completion, cached, dollars, is_estimate, batch in news[1]:
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
    """Keep a reply and its call inside a transaction; the reply that is kept."""
    now = time.time()
    added = connection.execute(
        "insert or ignore into replies values (?, ?, ?, ?, ?)",
        [key, reply.body, zlib.crc32(reply.body), reply.seconds, now],
    ).rowcount
    # A result of a batch that is read twice was paid for once.
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
            now,
        ],
    )
    return reply if added else (_select(connection, key) or reply)


def _select(connection: sqlite3.Connection, key: bytes) -> CachedReply | None:
    row = connection.execute("select body, crc, seconds from replies where key = ?", [key]).fetchone()
    if row is None:
        return None
    body, crc, seconds = row
    if zlib.crc32(body) != crc:
        hint = "the disk or a copy is bad; restore the file, or delete the reply and pay for it again"
        raise CacheError(f"the reply {key.hex()} does not match its checksum", hint=hint)
    return CachedReply(body, seconds)


def _add_hits(connection: sqlite3.Connection, hits: Mapping[tuple[str, str], int]) -> None:
    connection.executemany(
        "insert into hits values (?, ?, ?) on conflict do update set count = count + excluded.count",
        [(purpose, model, count) for (purpose, model), count in hits.items()],
    )


def read_totals(connection: sqlite3.Connection) -> tuple[Totals, int]:
    """All that is in the file, and the number of the last call that is counted in."""
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
