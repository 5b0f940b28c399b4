"""The proxy: SOCKS5 on loopback, one per worker process.

A browser asks for a name; whether and where that may be connected to is decided here, and the connection
is made to the very address that was checked. What another lookup would say a moment later never matters.
After that bytes are passed on as they are.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Coroutine
from typing import Any, cast
from urllib.parse import urlsplit

import msgspec

from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.dial import Dialer, NotConnected, Reason
from webgym.browser.egress.hosts import read_host
from webgym.browser.egress.machine import Machine
from webgym.browser.egress.socks import (
    CONNECT,
    FAILED,
    FORBIDDEN,
    LONGEST_HANDSHAKE,
    NO_AUTHENTICATION,
    NO_COMMAND,
    NO_HOST,
    NO_METHOD,
    SUCCEEDED,
    WELCOME,
    NotSocks,
    Request,
    read_greeting,
    read_request,
    reply,
)
from webgym.browser.egress.splice import Books, BrowserEnd, ServerEnd

_LOOPBACK = "127.0.0.1"
_BACKLOG = 1024
_DEFAULT_PORTS = {"http": 80, "https": 443, "ws": 80, "wss": 443}
_REPLIES: dict[Reason, int] = {"forbidden": FORBIDDEN, "too_many": FORBIDDEN, "no_such_name": NO_HOST}


class EgressLoad(msgspec.Struct, frozen=True):
    """What goes through, and has gone through so far.

    Attributes:
        open: connections at this moment.
        results: connections asked for, by how that ended: ``connected``, ``abandoned`` by the browser,
            ``not_socks``, or a :data:`Reason`.
        sent, received: bytes, as the browsers see it.
    """

    open: int
    results: dict[str, int]
    sent: int
    received: int


class Egress:
    """The way out of one process's browsers. An async context manager, for the loop it is entered in.

    Args:
        config: what pages may connect to, and the limits.
        machine: what is asked for addresses; another one in tests.
    """

    def __init__(self, config: EgressConfig | None = None, machine: Machine | None = None) -> None:
        self.config = config or EgressConfig()
        self._dialer = Dialer(self.config, machine or Machine())
        self._books = Books(self.config)
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._failures: OrderedDict[tuple[str, int], NotConnected] = OrderedDict()

    # --- life ---------------------------------------------------------------------------------------

    async def __aenter__(self) -> Egress:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    async def start(self) -> None:
        """Listen."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Handshake(self), _LOOPBACK, 0, backlog=_BACKLOG)
        self._dialer.own_port = self.port

    async def stop(self) -> None:
        """End every connection. Safe to call twice, and before :meth:`start`."""
        server, self._server = self._server, None
        if server is None:
            return
        server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._books.empty()
        await self._dialer.close()
        await server.wait_closed()

    @property
    def port(self) -> int:
        """Where it listens, on 127.0.0.1."""
        assert self._server is not None, "the proxy was not started"
        return cast(int, self._server.sockets[0].getsockname()[1])

    @property
    def browser_flags(self) -> tuple[str, ...]:
        """What makes a Chromium go this way, and no other."""
        return (
            f"--proxy-server=socks5://{_LOOPBACK}:{self.port}",
            "--proxy-bypass-list=<-loopback>",  # which Chromium would otherwise connect to by itself
            # Names are sent to the proxy. Nothing else is to be looked up, such as for dns-prefetch.
            f"--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE {_LOOPBACK}",
            "--disable-quic",
            # WebRTC: no packet but through the proxy, which takes none.
            "--force-webrtc-ip-handling-policy=disable_non_proxied_udp",
        )

    # --- what is seen -------------------------------------------------------------------------------

    @property
    def load(self) -> EgressLoad:
        """At this moment."""
        books = self._books
        return EgressLoad(books.open, dict(books.results), books.sent, books.received)

    def failure(self, url: str) -> NotConnected | None:
        """Why the last connection to a URL's host and port that failed did so, if it is still known."""
        try:
            parts = urlsplit(url)
            port = parts.port or _DEFAULT_PORTS.get(parts.scheme, 0)
        except ValueError:
            return None
        return self._failures.get((_spelt(parts.hostname or ""), port))

    # --- connections --------------------------------------------------------------------------------

    async def connect(self, host: str, port: int) -> ServerEnd:
        """A connection to a host, if it may and can be had. The books say how it went.

        Raises:
            NotConnected: and why.
        """
        result = "abandoned"
        try:
            server = await self._dialer.dial(host, port, lambda: ServerEnd(self._books))
            result = "connected"
            return server
        except NotConnected as failure:
            result = failure.reason
            key = (_spelt(host), port)
            self._failures[key] = failure
            self._failures.move_to_end(key)
            if len(self._failures) > self.config.cache_names:
                self._failures.popitem(last=False)
            raise
        finally:
            self._books.results[result] += 1

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task


def _spelt(host: str) -> str:
    """One spelling for all that mean the same host."""
    try:
        return str(read_host(host))
    except ValueError:
        return host


class _Handshake(asyncio.Protocol):
    """A browser that is not yet connected to where it wants to go."""

    _transport: asyncio.Transport
    _deadline: asyncio.TimerHandle

    def __init__(self, egress: Egress) -> None:
        self._egress = egress
        self._books = egress._books
        self._held = b""
        self._is_greeted = False
        self._task: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A browser has come."""
        self._transport = cast(asyncio.Transport, transport)  # uvloop's is none by name
        self._books.enter(self._transport)
        seconds = self._egress.config.handshake_seconds
        self._deadline = asyncio.get_running_loop().call_later(seconds, self._transport.abort)

    def connection_lost(self, _: Exception | None) -> None:
        """It has gone before it was connected."""
        self._deadline.cancel()
        self._books.leave(self._transport)
        if self._task is not None:
            self._task.cancel()

    def data_received(self, data: bytes) -> None:
        """A part of the handshake, or what follows it too soon."""
        self._held += data
        if len(self._held) > LONGEST_HANDSHAKE:
            self._give_up()
        elif self._task is None and not self._transport.is_closing():
            try:
                self._go_on()
            except NotSocks:
                self._give_up()

    def _give_up(self) -> None:
        self._books.results["not_socks"] += 1
        self._transport.abort()

    def _go_on(self) -> None:
        if not self._is_greeted:
            greeting = read_greeting(self._held)
            if greeting is None:
                return
            self._held = self._held[greeting.size :]
            if NO_AUTHENTICATION not in greeting.methods:
                self._answer(NO_METHOD)
                return
            self._is_greeted = True
            self._transport.write(WELCOME)
        request = read_request(self._held)
        if request is None:
            return
        self._held = self._held[request.size :]
        if request.command != CONNECT:  # UDP and listening are not for web pages
            self._answer(reply(NO_COMMAND))
            return
        self._task = self._egress._spawn(self._connect(request))

    def _answer(self, last_words: bytes) -> None:
        self._transport.write(last_words)
        self._transport.close()

    async def _connect(self, request: Request) -> None:
        try:
            server = await self._egress.connect(request.host, request.port)
        except NotConnected as failure:
            self._answer(reply(_REPLIES.get(failure.reason, FAILED)))
            return
        if self._transport.is_closing():
            server.transport.abort()
            return
        self._deadline.cancel()
        browser = BrowserEnd(self._books)
        browser.connection_made(self._transport)
        self._transport.set_protocol(browser)
        self._transport.write(reply(SUCCEEDED))
        server.join(browser)
        if self._held:
            browser.data_received(self._held)
