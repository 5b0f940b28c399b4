"""How servers listen and clients connect: requests of bounded size, detection of dead peers."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import resource
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any, ClassVar

import aiohttp
import msgspec
import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from webgym.core.errors import ConfigError, ProtocolError
from webgym.server.config import ServerConfig
from webgym.server.messages import ErrorBody, ErrorReply

log = logging.getLogger(__name__)

_BACKLOG = 2048
_BUFFER_BYTES = 256 * 1024
"""Reading an answer pauses when about this much of it is buffered."""
_PROBES = 3
_NOT_HTTP = "this is not an HTTP/1.1 request"
_DISCARDED_BODIES = 8
"""After a body that is too large was refused, the rest of it is read and discarded, so that the caller can
receive the answer, up to this many times the largest body."""

SHUTDOWN_SECONDS = 5
"""Time for calls in flight to end when the server is stopped."""


def keep_alive_options(seconds: float) -> list[tuple[int, int, int]]:
    """Socket options that detect within ``seconds`` a peer that vanished without closing the connection.

    Without them, connections to a machine that lost power stay open for hours.
    """
    pause = max(1, round(seconds / (_PROBES + 1)))
    return [
        (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
        (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, pause),
        (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, pause),
        (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _PROBES),
        (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(seconds * 1000)),
    ]


def connections(
    connect_seconds: float, idle_seconds: float, dead_peer_seconds: float
) -> aiohttp.ClientSession:
    """An HTTP session that keeps connections open between calls, to any number of servers.

    Args:
        connect_seconds: deadline for opening a connection.
        idle_seconds: how long an idle connection is kept.
        dead_peer_seconds: time after which a peer counts as dead that does not answer TCP keepalive probes.
    """

    def open_socket(address: aiohttp.AddrInfoType) -> socket.socket:
        family, kind, protocol, _, _ = address
        sock = socket.socket(family, kind, protocol)
        for option in keep_alive_options(dead_peer_seconds):
            sock.setsockopt(*option)
        return sock

    return aiohttp.ClientSession(
        connector=aiohttp.TCPConnector(limit=0, keepalive_timeout=idle_seconds, socket_factory=open_socket),
        timeout=aiohttp.ClientTimeout(total=None, sock_connect=connect_seconds),
        cookie_jar=aiohttp.DummyCookieJar(),
        read_bufsize=_BUFFER_BYTES,
    )


def raise_open_files_limit() -> None:
    """Raise the limit of open files to the maximum: a session needs about ten; the usual limit is 1024."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def listen(config: ServerConfig, option: str = "--port") -> socket.socket:
    """Open the server's socket. From now on, clients wait instead of being refused.

    Args:
        config: where to listen.
        option: what sets the port, for the error.

    Raises:
        ConfigError: the address cannot be listened on.
    """
    if config.ports is None:
        try:
            return _listening(config, config.port)
        except OSError as error:
            raise ConfigError(
                f"{config.host}:{config.port} cannot be listened on: {error.strerror}",
                hint=f"choose another {option}, or 0 for a free one",
            ) from error
    first, last = config.ports
    why = f"{first} is above {last}"
    for port in range(first, last + 1):
        try:
            return _listening(config, port)
        except OSError as error:
            why = error.strerror or str(error)
    raise ConfigError(
        f"none of the ports {first} to {last} of {config.host} can be listened on: {why}",
        hint="give --worker-ports more of them than there are workers",
    )


def _listening(config: ServerConfig, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        for option in keep_alive_options(config.dead_peer_seconds):
            listener.setsockopt(*option)  # accepted connections inherit them
        listener.bind((config.host, port))
        listener.listen(_BACKLOG)
    except OSError:
        listener.close()
        raise
    return listener


def url_of(listener: socket.socket) -> str:
    """The base URL of the server that listens on this socket."""
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def is_wildcard(host: str) -> bool:
    """Whether a host to listen on means every address of the machine, so that others cannot connect to it."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return not host


class QuietServer(uvicorn.Server):
    """A uvicorn server that leaves the process's signal handlers to its owner."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave the process's signal handlers alone."""
        yield


class _BoundedProtocol(HttpToolsProtocol):
    """An HTTP protocol with limits on the sizes of heads and bodies, on the time until a request is complete,
    and on the number of connections. They apply before the application sees a request or checks its token.

    uvicorn creates one per connection, so the limits are set on a subclass (:func:`_bounded_protocol`).
    """

    limits: ClassVar[ServerConfig]

    _head_bytes = 0
    """Bytes of the request line and headers, as parsed."""
    _bytes = 0
    """Bytes of the current message received so far."""
    _in_head = True
    _completed = False
    _deadline: asyncio.TimerHandle | None = None

    @property
    def _long_head(self) -> str:
        return f"the request's line and headers are larger than {self.limits.head_bytes} bytes"

    # --- transport ----------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)  # type: ignore[arg-type]  # uvicorn narrows it
        if len(self.connections) > self.limits.connections:
            log.warning("more than %d connections: one is refused", self.limits.connections)
            self.transport.abort()
        else:
            self._start_deadline()

    def connection_lost(self, exc: Exception | None) -> None:
        self._cancel_deadline()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self._start_deadline()
        self._completed = False
        super().data_received(data)
        if self._completed or self.transport.is_closing():
            return
        self._bytes += len(data)
        if self._in_head and self._bytes > self.limits.head_bytes:
            self.send_400_response(self._long_head)
        elif self._bytes > self.limits.head_bytes + _DISCARDED_BODIES * self.limits.body_bytes:
            self.transport.abort()

    # --- parser callbacks ---------------------------------------------------------------------------

    def on_message_begin(self) -> None:
        self._start_deadline()
        self._head_bytes = 0
        super().on_message_begin()

    def on_url(self, url: bytes) -> None:
        self._count_head(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        self._count_head(len(name) + len(value))
        super().on_header(name, value)

    def on_headers_complete(self) -> None:
        self._in_head = False
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        self._cancel_deadline()
        self._in_head = self._completed = True
        self._bytes = 0
        super().on_message_complete()

    def _count_head(self, size: int) -> None:
        self._head_bytes += size
        if self._head_bytes > self.limits.head_bytes:
            # The parser turns it into a parser error, which closes the connection with status 400.
            raise ValueError(self._long_head)

    # --- errors and deadlines -----------------------------------------------------------------------

    def send_400_response(self, msg: str) -> None:
        """Reply with a typed error instead of uvicorn's text, and close the connection."""
        is_long = msg == self._long_head or self._head_bytes > self.limits.head_bytes
        message = self._long_head if is_long else _NOT_HTTP
        body = msgspec.json.encode(ErrorReply(ErrorBody(ProtocolError.code, message)))
        head = (
            "HTTP/1.1 400 Bad Request",
            "content-type: application/json",
            f"content-length: {len(body)}",
            "connection: close",
        )
        self.transport.write("\r\n".join([*head, "", ""]).encode("ascii") + body)
        self.transport.close()

    def _start_deadline(self) -> None:
        if self._deadline is None:
            self._deadline = self.loop.call_later(self.limits.receive_seconds, self._on_deadline)

    def _cancel_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _on_deadline(self) -> None:
        self._deadline = None
        self.transport.abort()  # the application sees that the caller has disconnected


def _bounded_protocol(config: ServerConfig) -> type[_BoundedProtocol]:
    """The protocol class with the limits of a configuration."""

    class Bounded(_BoundedProtocol):
        limits = config

    return Bounded


@asynccontextmanager
async def serving(app: ASGIApp, listener: socket.socket, config: ServerConfig) -> AsyncIterator[None]:
    """Serve during the block. The caller closes the socket."""
    settings: dict[str, Any] = {
        "lifespan": "off",
        "log_config": None,
        "access_log": False,
        "server_header": False,
        "ws": "none",
        "http": _bounded_protocol(config),
        "timeout_keep_alive": config.keep_alive_seconds,
        "timeout_graceful_shutdown": SHUTDOWN_SECONDS,
    }
    server = QuietServer(uvicorn.Config(app, **settings))
    task = asyncio.create_task(server.serve(sockets=[listener]))
    try:
        yield
    finally:
        server.should_exit = True
        await task
