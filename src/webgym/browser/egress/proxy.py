"""The proxy: SOCKS5 on loopback, one per worker process, with a listener of its own for every browser.

A browser requests a connection by name; the proxy decides whether it is allowed, and connects to exactly the
address that was checked, so that a second lookup with another result has no effect. Then bytes are forwarded
unchanged. A page can also be asked for from outside all browsers, by the way that their connections take.
"""

from __future__ import annotations

import asyncio
import ssl
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Callable
from typing import cast
from urllib.parse import urlsplit
from weakref import WeakSet

import msgspec

from webgym.browser.egress.budget import Budget, BudgetExceeded
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.dial import Dialer, NotConnected, Reason
from webgym.browser.egress.hosts import read_host
from webgym.browser.egress.resolver import CACHE_NAMES, Machine
from webgym.browser.egress.rules import blocked_names
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
from webgym.browser.egress.splice import BrowserEnd, Connections, ServerEnd
from webgym.browser.shared_parts import SharedParts
from webgym.core.background import BackgroundTasks
from webgym.core.errors import BrowserLaunchFailed, EgressRefused
from webgym.core.observation import Probed

_LOOPBACK = "127.0.0.1"
_BACKLOG = 1024
_REPEATED_SECONDS = 0.5
"""After a cut, until the browser has opened the connection of a repeated request."""
_DEFAULT_PORTS = {"http": 80, "https": 443, "ws": 80, "wss": 443}
_REPLIES: dict[Reason, int] = {"forbidden": FORBIDDEN, "too_many": FORBIDDEN, "no_such_name": NO_HOST}

HANDSHAKE_SECONDS = 3600.0
"""SOCKS handshake of a browser. Long, because the browser may be frozen in the middle of it."""


class EgressLoad(msgspec.Struct, frozen=True):
    """Statistics of the proxy.

    Attributes:
        open: connections at this moment.
        results: number of requested connections by result: ``connected``, ``abandoned`` by the browser,
            ``not_socks``, or a :data:`Reason`.
        sent, received: bytes, from the browsers' point of view.
        routes: the results by route; empty without upstream proxies.
    """

    open: int
    results: dict[str, int]
    sent: int
    received: int
    routes: dict[str, dict[str, int]] = {}


class Egress:
    """The proxy for all connections of one process's browsers.

    An async context manager, bound to the event loop in which it is entered.

    Args:
        config: what pages may connect to, and the limits.
        machine: resolves names; replaced in tests.
    """

    def __init__(self, config: EgressConfig | None = None, machine: Machine | None = None) -> None:
        self.config = config or EgressConfig()
        self._blocked = blocked_names(self.config.block_lists)
        self._dialer = Dialer(self.config, machine or Machine())
        self._connections = Connections(self.config)
        self.parts = SharedParts()
        self._main: ProxyListener | None = None
        self._listeners: set[ProxyListener] = set()
        self._failures: OrderedDict[tuple[str, int], NotConnected] = OrderedDict()
        self._routes: defaultdict[str, Counter[str]] = defaultdict(Counter)

    # --- life ---------------------------------------------------------------------------------------

    async def __aenter__(self) -> Egress:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    async def start(self) -> None:
        """Open the main listener, for browsers without one of their own."""
        self._main = await self.open_listener()

    async def stop(self) -> None:
        """Close every connection. Safe to call twice, and before :meth:`start`."""
        main, self._main = self._main, None
        if main is None:
            return
        await asyncio.gather(*(listener.close() for listener in tuple(self._listeners)))
        await self._connections.empty()
        await self._dialer.close()

    async def open_listener(self) -> ProxyListener:
        """Open a listener with a budget of its own.

        Raises:
            BrowserLaunchFailed: no socket is left for it.
        """
        listener = ProxyListener(self)
        await listener._open()
        self._listeners.add(listener)
        self._dialer.own_ports.add(listener.port)
        return listener

    @property
    def main(self) -> ProxyListener:
        """The listener for browsers without one of their own."""
        assert self._main is not None, "the proxy was not started"
        return self._main

    @property
    def port(self) -> int:
        """Port of the main listener, on 127.0.0.1."""
        return self.main.port

    # --- statistics ---------------------------------------------------------------------------------

    @property
    def load(self) -> EgressLoad:
        """The statistics at this moment."""
        connections = self._connections
        routes = {name: dict(results) for name, results in self._routes.items()}
        results = dict(connections.results)
        return EgressLoad(connections.open, results, connections.sent, connections.received, routes)

    @property
    def waiting(self) -> int:
        """Number of connections that are being opened."""
        return sum(len(listener._tasks) for listener in self._listeners)

    def failure(self, url: str) -> NotConnected | None:
        """The last failure to connect to a URL's host and port, if there was one and it is still stored."""
        host, port = _place(url)
        return self._failures.get((_normalised(host), port))

    # --- connections --------------------------------------------------------------------------------

    async def connect(self, host: str, port: int, budget: Budget) -> ServerEnd:
        """Connect to a host, if that is allowed. The statistics record the result.

        The connection counts in the budget; the caller must call :meth:`Budget.leave` when it is closed.

        Raises:
            NotConnected: with the reason.
        """
        result = "abandoned"
        is_counted = False
        try:
            try:
                if self._blocked and _normalised(host) in self._blocked:
                    raise NotConnected("forbidden", f"{EgressRefused.by_policy}: {host} is on a block list")
                budget.enter()
            except BudgetExceeded as error:
                raise NotConnected("too_many", f"refused: {error}") from None
            is_counted = True
            server = await self._dialer.dial(
                host, port, budget, lambda: ServerEnd(self._connections, budget, host)
            )
            result = "connected"
            return server
        except NotConnected as failure:
            result = failure.reason
            if result == "too_many":
                budget.limit(host)
            key = (_normalised(host), port)
            self._failures[key] = failure
            self._failures.move_to_end(key)
            if len(self._failures) > CACHE_NAMES:
                self._failures.popitem(last=False)
            raise
        finally:
            self._connections.results[result] += 1
            if route := self.route_name(host, port, budget):
                self._routes[route][result] += 1
            if is_counted and result != "connected":
                budget.leave()

    def route_name(self, host: str, port: int, budget: Budget) -> str:
        """The name of a session's route to a host; empty without upstream proxies."""
        if not self._dialer.upstreams:
            return ""
        try:
            return self._dialer.route_name(read_host(host), port, budget.route)
        except ValueError:
            return ""


class ProxyListener:
    """The proxy's listening socket for one browser, with the budget of the session that the browser serves.

    Created by :meth:`Egress.open_listener`.
    """

    def __init__(self, egress: Egress) -> None:
        self._egress = egress
        self._tasks = BackgroundTasks()
        self._joined: WeakSet[BrowserEnd] = WeakSet()
        self._server: asyncio.Server | None = None
        self.budget = Budget(egress.config)
        self.parts = egress.parts

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            server = await loop.create_server(lambda: _Handshake(self), _LOOPBACK, 0, backlog=_BACKLOG)
            self._port = cast(int, server.sockets[0].getsockname()[1])
        except (
            OSError,
            IndexError,
        ) as error:  # if no file is left, the loop returns a server without sockets
            raise BrowserLaunchFailed(
                "no socket can be opened for the browser's connections",
                hint="is the limit of open files too low?",
            ) from error
        self._server = server

    async def close(self) -> None:
        """Accept no more connections, and cancel those being opened. Safe to call twice."""
        server, self._server = self._server, None
        if server is None:
            return
        server.close()
        self.renew()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._egress._dialer.own_ports.discard(self._port)
        self._egress._listeners.discard(self)

    def renew(self) -> None:
        """Start a new session, with a fresh budget. Connections that the last one is opening are
        cancelled."""
        for task in self._tasks:
            task.cancel()
        self.budget = Budget(self._egress.config)

    def cut(self, again: Callable[[], bool]) -> None:
        """Abort the session's connections. Unlike :meth:`renew`, the session's budget stays.

        Args:
            again: called 0.5 s later; whether to abort those of that time too. The browser repeats a request
                at once where its connection had been used before.
        """
        budget = self.budget
        self._abort()
        asyncio.get_running_loop().call_later(
            _REPEATED_SECONDS, lambda: self._abort() if self.budget is budget and again() else None
        )

    def _abort(self) -> None:
        for task in self._tasks:
            task.cancel()
        for browser in tuple(self._joined):
            browser.transport.abort()

    @property
    def port(self) -> int:
        """Its port, on 127.0.0.1."""
        return self._port

    @property
    def browser_flags(self) -> tuple[str, ...]:
        """Flags that make Chromium use this proxy and no other route."""
        return (
            f"--proxy-server=socks5://{_LOOPBACK}:{self.port}",
            "--proxy-bypass-list=<-loopback>",  # which Chromium would otherwise connect to by itself
            # The proxy resolves names. Chromium itself must look up none, such as for dns-prefetch.
            f"--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE {_LOOPBACK}",
            "--disable-quic",
            # WebRTC: only through the proxy, which does not support UDP.
            "--force-webrtc-ip-handling-policy=disable_non_proxied_udp",
        )

    def failure(self, url: str) -> NotConnected | None:
        """See :meth:`Egress.failure`."""
        return self._egress.failure(url)

    def route_to(self, url: str) -> str:
        """The name of the session's route to a URL's host; empty without upstream proxies."""
        return self._egress.route_name(*_place(url), self.budget)

    async def probe(self, url: str, seconds: float) -> Probed:
        """Ask for a page from outside all browsers, by the session's route: see :func:`probe`."""
        budget = Budget(self._egress.config)
        budget.route = self.budget.route
        return await probe(self._egress._dialer, budget, url, seconds)


def _place(url: str) -> tuple[str, int]:
    """The host and port of a URL; empty and 0 if it has none."""
    try:
        parts = urlsplit(url)
        return parts.hostname or "", parts.port or _DEFAULT_PORTS.get(parts.scheme, 0)
    except ValueError:
        return "", 0


def _normalised(host: str) -> str:
    """One spelling for all spellings of the same host."""
    try:
        return str(read_host(host))
    except ValueError:
        return host


class _Handshake(asyncio.Protocol):
    """A browser's connection during the SOCKS handshake."""

    _transport: asyncio.Transport
    _deadline: asyncio.TimerHandle

    def __init__(self, listener: ProxyListener) -> None:
        self._listener = listener
        self._egress = listener._egress
        self._connections = self._egress._connections
        self._buffer = b""
        self._is_greeted = False
        self._task: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A browser has connected."""
        self._transport = cast(asyncio.Transport, transport)  # uvloop's is not a subclass
        self._connections.enter(self._transport)
        seconds = HANDSHAKE_SECONDS
        self._deadline = asyncio.get_running_loop().call_later(seconds, self._transport.abort)

    def connection_lost(self, _: Exception | None) -> None:
        """The browser has closed the connection before the handshake ended."""
        self._deadline.cancel()
        self._connections.leave(self._transport)
        if self._task is not None:
            self._task.cancel()

    def data_received(self, data: bytes) -> None:
        """Handle a part of the handshake, or data that was sent before its end."""
        self._buffer += data
        if len(self._buffer) > LONGEST_HANDSHAKE:
            self._give_up()
        elif self._task is None and not self._transport.is_closing():
            try:
                self._continue()
            except NotSocks:
                self._give_up()

    def _give_up(self) -> None:
        self._connections.results["not_socks"] += 1
        self._transport.abort()

    def _continue(self) -> None:
        if not self._is_greeted:
            greeting = read_greeting(self._buffer)
            if greeting is None:
                return
            self._buffer = self._buffer[greeting.size :]
            if NO_AUTHENTICATION not in greeting.methods:
                self._answer(NO_METHOD)
                return
            self._is_greeted = True
            self._transport.write(WELCOME)
        request = read_request(self._buffer)
        if request is None:
            return
        self._buffer = self._buffer[request.size :]
        if request.command != CONNECT:  # UDP and listening are not supported
            self._answer(reply(NO_COMMAND))
            return
        self._task = self._listener._tasks.start(self._connect(request))

    def _answer(self, message: bytes) -> None:
        self._transport.write(message)
        self._transport.close()

    async def _connect(self, request: Request) -> None:
        budget = self._listener.budget
        try:
            server = await self._egress.connect(request.host, request.port, budget)
        except NotConnected as failure:
            self._answer(reply(_REPLIES.get(failure.reason, FAILED)))
            return
        except asyncio.CancelledError:
            self._transport.abort()
            raise
        if self._transport.is_closing():
            budget.leave()
            server.transport.abort()
            return
        self._deadline.cancel()
        browser = BrowserEnd(self._connections, budget, request.host)
        browser.connection_made(self._transport)
        self._transport.set_protocol(browser)
        self._transport.write(reply(SUCCEEDED))
        server.join(browser)
        self._listener._joined.add(browser)
        if self._buffer:
            browser.data_received(self._buffer)


_LINE_BYTES = 2**16


async def probe(dialer: Dialer, budget: Budget, url: str, seconds: float) -> Probed:
    """Ask a website for a page.

    Args:
        dialer: opens the connection, under the same policy as any other.
        budget: of the probe.
        url: address of the page.
        seconds: until the status of the answer has come.
    """
    try:
        async with asyncio.timeout(seconds):
            return await _ask(dialer, budget, url)
    except TimeoutError:
        return Probed(f"{url} gave a probe no answer within {seconds:g} s")
    except NotConnected as failure:
        if failure.reason == "too_many":
            return Probed()
        return Probed(f"{url}: {failure.message}", is_route=failure.reason == "upstream")
    except (OSError, ValueError) as error:
        return Probed(f"{url}: {type(error).__name__}")


class _Asking(asyncio.StreamReaderProtocol):
    transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is open."""
        self.transport = cast(asyncio.Transport, transport)  # uvloop's is not a subclass
        super().connection_made(transport)


async def _ask(dialer: Dialer, budget: Budget, url: str) -> Probed:
    parts = urlsplit(url)
    reader = asyncio.StreamReader(limit=_LINE_BYTES)
    protocol = _Asking(reader)
    host, port = _place(url)
    await dialer.dial(host, port, budget, lambda: protocol)
    writer = asyncio.StreamWriter(protocol.transport, protocol, reader, asyncio.get_running_loop())
    try:
        if parts.scheme == "https":
            await writer.start_tls(_context(), server_hostname=host)
        path = f"{parts.path or '/'}{f'?{parts.query}' if parts.query else ''}"
        name = parts.netloc.rpartition("@")[2]
        writer.write(f"GET {path} HTTP/1.1\r\nHost: {name}\r\nConnection: close\r\n\r\n".encode())
        version, status, *_ = (await reader.readline()).split(maxsplit=2)
        if not version.startswith(b"HTTP/"):
            raise ValueError(version)
        return Probed(status=int(status))
    finally:
        writer.transport.abort()


def _context() -> ssl.SSLContext:
    """Whether a certificate is valid is no question of a website's being there."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context
