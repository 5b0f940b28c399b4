"""Forwards calls to one worker as bytes: no body is decoded, and a screenshot is forwarded while it is still
arriving.

This is a small HTTP/1.1 client of WebGym's own because a general-purpose client costs about as much processor
time per forwarded call as the rest of the gateway.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from typing import cast
from urllib.parse import urlsplit

import httptools

from webgym.server.config import GatewayConfig
from webgym.server.listening import keep_alive_options

Header = tuple[bytes, bytes]

_HIGH_WATER_BYTES = 256 * 1024
"""Reading pauses when this much of a body is buffered."""


class NotSent(Exception):
    """No connection could be made: the worker has not received the call."""


class Interrupted(Exception):
    """The connection ended before the answer: whether the call was carried out is unknown."""


class Answer:
    """An answer whose body may still be arriving.

    Attributes:
        status: HTTP status; 0 until the head has arrived.
        headers: header names in lower case, and values.
        is_complete: whether the whole body has arrived.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self.status = 0
        self.headers: list[Header] = []
        self.is_complete = False
        self._transport = transport
        self._chunks: deque[bytes] = deque()
        self._buffered_bytes = 0
        self._error: Interrupted | None = None
        self._changed = asyncio.Event()

    def feed(self, chunk: bytes) -> None:
        """Add a received part of the body."""
        self._chunks.append(chunk)
        self._buffered_bytes += len(chunk)
        if self._buffered_bytes > _HIGH_WATER_BYTES:
            self._transport.pause_reading()
        self._changed.set()

    def wake(self, error: Interrupted | None = None) -> None:
        """Wake the reader: the head has arrived, the body is complete, or neither will come."""
        self._error = error
        self._changed.set()

    async def wait_for_head(self) -> None:
        """Wait for the head.

        Raises:
            Interrupted: it does not come.
        """
        while not self.status:
            await self._change()

    async def chunks(self) -> AsyncIterator[bytes]:
        """The body, as it arrives.

        Raises:
            Interrupted: it ends too soon.
        """
        while True:
            while self._chunks:
                chunk = self._chunks.popleft()
                self._buffered_bytes -= len(chunk)
                crossed = self._buffered_bytes <= _HIGH_WATER_BYTES < self._buffered_bytes + len(chunk)
                if crossed and not self._transport.is_closing():
                    self._transport.resume_reading()
                yield chunk
            if self.is_complete:
                return
            await self._change()

    async def body(self) -> bytes:
        """The complete body.

        Raises:
            Interrupted: it ends too soon.
        """
        return b"".join([chunk async for chunk in self.chunks()])

    async def _change(self) -> None:
        if self._error is not None:
            raise self._error
        self._changed.clear()
        await self._changed.wait()


class _Connection(asyncio.Protocol):
    """One connection, one call at a time. Its parser calls the ``on_`` methods."""

    def __init__(self) -> None:
        self.is_open = False
        self._transport: asyncio.Transport
        self._parser = httptools.HttpResponseParser(self)
        self._answer: Answer | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)  # uvloop's is not a subclass
        self.is_open = True

    def connection_lost(self, exc: Exception | None) -> None:
        self.is_open = False
        if self._answer is not None:
            self._answer.wake(Interrupted(str(exc or "the other end closed it")))

    def data_received(self, data: bytes) -> None:
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserError:
            self.abort()

    def send(self, request: bytes) -> Answer:
        """Send a request; returns its answer, which has not arrived yet."""
        self._answer = Answer(self._transport)
        self._transport.write(request)
        return self._answer

    def abort(self) -> None:
        """Close the connection at once."""
        self.is_open = False
        self._transport.abort()

    def on_header(self, name: bytes, value: bytes) -> None:
        assert self._answer is not None
        self._answer.headers.append((name.lower(), value))

    def on_headers_complete(self) -> None:
        assert self._answer is not None
        self._answer.status = self._parser.get_status_code()
        self._answer.wake()

    def on_body(self, body: bytes) -> None:
        assert self._answer is not None
        self._answer.feed(body)

    def on_message_complete(self) -> None:
        assert self._answer is not None
        if not self._parser.should_keep_alive():
            self.is_open = False
        self._answer.is_complete = True
        self._answer.wake()
        self._answer = None


class Relay:
    """The connections to one worker.

    Args:
        base_url: the worker's base URL.
        config: deadlines.
    """

    def __init__(self, base_url: str, config: GatewayConfig) -> None:
        parts = urlsplit(base_url)
        assert parts.hostname is not None
        assert parts.port is not None
        self._address = parts.hostname, parts.port
        self._host = parts.netloc.encode("ascii")
        self._config = config
        self._idle: deque[tuple[float, _Connection]] = deque()
        self._busy: set[_Connection] = set()
        self._is_closed = False

    @asynccontextmanager
    async def call(
        self, method: str, path: str, headers: Iterable[Header] = (), body: bytes = b""
    ) -> AsyncIterator[Answer]:
        """Make a call; the answer's head has arrived when the block begins. Calls are never repeated.

        Args:
            method: HTTP method.
            path: plain ASCII without white space.
            headers: headers from an HTTP parser, so without line breaks.
            body: body of a POST request.

        Raises:
            NotSent: no connection could be opened.
            Interrupted: here or in the block: the connection failed.
        """
        connection = await self._connection()
        self._busy.add(connection)
        answer = connection.send(self._request(method, path, headers, body))
        try:
            await answer.wait_for_head()
            yield answer
        finally:
            self._busy.discard(connection)
            if not answer.is_complete or not connection.is_open or self._is_closed:
                connection.abort()
            else:
                self._idle.append((asyncio.get_running_loop().time(), connection))

    def close(self) -> None:
        """Close all connections; running calls are interrupted."""
        self._is_closed = True
        for connection in [*self._busy, *(connection for _, connection in self._idle)]:
            connection.abort()
        self._idle.clear()

    def _request(self, method: str, path: str, headers: Iterable[Header], body: bytes) -> bytes:
        head = [b"%s %s HTTP/1.1\r\nhost: %s\r\n" % (method.encode(), path.encode("ascii"), self._host)]
        head += [b"%s: %s\r\n" % header for header in headers]
        if method == "POST":
            head.append(b"content-length: %d\r\n" % len(body))
        return b"".join([*head, b"\r\n", body])

    async def _connection(self) -> _Connection:
        """An idle connection, else a new one."""
        if self._is_closed:
            raise NotSent("the worker is gone")
        loop = asyncio.get_running_loop()
        oldest = loop.time() - self._config.idle_seconds
        while self._idle and self._idle[0][0] < oldest:
            self._idle.popleft()[1].abort()
        while self._idle:
            connection = self._idle.pop()[1]
            if connection.is_open:
                return connection
        try:
            async with asyncio.timeout(self._config.connect_seconds):
                transport, connection = await loop.create_connection(_Connection, *self._address)
        except (OSError, TimeoutError) as error:
            raise NotSent(str(error) or "no answer in time") from None
        for option in keep_alive_options(self._config.dead_peer_seconds):
            transport.get_extra_info("socket").setsockopt(*option)
        return connection
