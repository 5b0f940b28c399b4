"""Joins two connections: data read from one is written to the other.

While one end cannot be written to, reading from the other is paused, so the data buffered for a frozen
browser never exceeds the limit of the write buffer plus the kernel's buffers.
"""

from __future__ import annotations

import asyncio
import socket
import struct
from collections import Counter
from typing import cast

from webgym.browser.egress.budget import Budget
from webgym.browser.egress.config import EgressConfig

_KEEPALIVE_PROBES = 4
_RESET_ON_CLOSE = struct.pack("ii", 1, 0)

KEEPALIVE_SECONDS = 60
"""Idle time after which a TCP keepalive probe is sent to a server."""

BUFFER_BYTES = 256 * 1024
"""Unsent bytes per direction above which reading from the sender is paused: a frozen browser reads nothing
for minutes."""


class Connections:
    """The open connections of one proxy, and totals over all of them."""

    def __init__(self, config: EgressConfig) -> None:
        self.config = config
        self.transports: set[asyncio.Transport] = set()
        self._is_empty = asyncio.Event()
        self._is_empty.set()
        self.results: Counter[str] = Counter()
        self.open = 0
        self.sent = 0
        self.received = 0

    def enter(self, transport: asyncio.Transport) -> None:
        """Add a connection."""
        self.transports.add(transport)
        self._is_empty.clear()

    def leave(self, transport: asyncio.Transport) -> None:
        """Remove a connection."""
        self.transports.discard(transport)
        if not self.transports:
            self._is_empty.set()

    async def empty(self) -> None:
        """Abort every connection and wait until all are closed."""
        for transport in tuple(self.transports):
            transport.abort()
        await self._is_empty.wait()


class _End(asyncio.Protocol):
    transport: asyncio.Transport
    """Set by :meth:`connection_made`."""

    def __init__(self, connections: Connections, budget: Budget, host: str) -> None:
        self._connections = connections
        self._budget = budget
        self._host = host
        self.other: _End | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is open."""
        self.transport = cast(asyncio.Transport, transport)  # uvloop's is not a subclass
        self.transport.set_write_buffer_limits(high=BUFFER_BYTES)
        self._connections.enter(self.transport)

    def connection_lost(self, _: Exception | None) -> None:
        """The connection is closed."""
        self._connections.leave(self.transport)

    def _forward(self, data: bytes, other: _End) -> None:
        """Write to the other end. If the session exceeds its budget, both connections are aborted."""
        if self._budget.take(len(data), self._host):
            other.transport.write(data)
        else:
            other.transport.abort()
            self.transport.abort()

    def pause_writing(self) -> None:
        """This end's buffer is full: stop reading from the other."""
        if self.other is not None and not self.other.transport.is_closing():
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        """This end's buffer has space: continue reading from the other."""
        if self.other is not None and not self.other.transport.is_closing():
            self.other.transport.resume_reading()


class BrowserEnd(_End):
    """The browser's end."""

    other: ServerEnd

    def data_received(self, data: bytes) -> None:
        """Forward to the server."""
        self._connections.sent += len(data)
        self._forward(data, self.other)

    def connection_lost(self, exc: Exception | None) -> None:
        """The browser has closed the connection, always in both directions: close the server's too."""
        super().connection_lost(exc)
        self._connections.open -= 1
        self._budget.leave()
        self.other.transport.close()

    def end(self, error: Exception | None) -> None:
        """The server's connection is closed. A reset is forwarded as one, unless data is still to be sent."""
        if self.transport.is_closing():
            return
        if isinstance(error, ConnectionResetError) and not self.transport.get_write_buffer_size():
            raw = self.transport.get_extra_info("socket")
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET_ON_CLOSE)
        self.transport.close()


class ServerEnd(_End):
    """The server's end. It is connected first, and may send data before it is joined."""

    other: BrowserEnd | None

    def __init__(self, connections: Connections, budget: Budget, host: str) -> None:
        super().__init__(connections, budget, host)
        self._early: list[bytes] = []
        self._is_over = False
        self._error: Exception | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is open: enable keepalive, so that a server that disappears is noticed."""
        super().connection_made(transport)
        config, raw = self._connections.config, transport.get_extra_info("socket")
        interval = max(1, (config.dead_seconds - KEEPALIVE_SECONDS) // _KEEPALIVE_PROBES)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, KEEPALIVE_SECONDS)
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, interval)
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _KEEPALIVE_PROBES)
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, config.dead_seconds * 1000)

    def join(self, browser: BrowserEnd) -> None:
        """Start forwarding between both ends."""
        self.other, browser.other = browser, self
        self._connections.open += 1
        for data in self._early:
            self.data_received(data)
        self._early.clear()
        if self._is_over:
            browser.end(self._error)

    def data_received(self, data: bytes) -> None:
        """Forward to the browser."""
        if self.other is None:
            self._early.append(data)
            return
        self._connections.received += len(data)
        self._forward(data, self.other)

    def eof_received(self) -> bool:
        """The server has finished sending, but may still receive."""
        if self.other is None or self.other.transport.is_closing():
            return False
        self.other.transport.write_eof()
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """The server's connection is closed."""
        super().connection_lost(exc)
        self._is_over, self._error = True, exc
        if self.other is not None:
            self.other.end(exc)
