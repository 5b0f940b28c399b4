"""Upstream proxies (HTTP CONNECT and SOCKS5): one of them for each session, in turn.

A session keeps its proxy, because websites tie log-ins and baskets to an address; it takes another one only
while none of its connections has come through. A proxy that fails is left out of the turns for a while. What
it says about a host that it could not reach is neither its own failure nor known to be the website's.
"""

from __future__ import annotations

import asyncio
import base64
import os
import secrets
from collections.abc import Callable
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from typing import cast
from urllib.parse import urlsplit

from webgym.browser.egress.config import EgressConfig, UpstreamConfig
from webgym.browser.egress.hosts import Host, read_host
from webgym.browser.egress.rules import read_rule
from webgym.core.errors import ConfigError

REST_SECONDS = (15.0, 600.0)
"""How long a proxy that failed is left out: at first, and at most, as the time doubles with every failure."""

_DOUBTED_HOSTS = 3
"""Different hosts in a row that a proxy could not reach, after which it counts as failed itself."""

_HEAD_BYTES = 16_384
_SESSION = "{session}"
_LONGEST = 240
"""Bytes of a user name or a password: SOCKS5 has one byte for the length."""
_PROXY_AUTHENTICATION, _TOO_MANY_REQUESTS = 407, 429
_SOCKS_REPLIES = {
    1: "general failure",
    2: "not allowed by its rules",
    3: "network unreachable",
    4: "host unreachable",
    5: "connection refused",
    6: "no answer in time",
}


class UpstreamFailed(Exception):
    """The proxy opened no tunnel; the message says why, and never contains credentials.

    Attributes:
        is_own: whether the proxy itself failed; else it could not reach the host, for whatever reason.
    """

    def __init__(self, why: str, *, is_own: bool) -> None:
        super().__init__(why)
        self.is_own = is_own


class SessionRoute:
    """The route that a session's connections take, unless a rule names another for their host.

    Attributes:
        name: of the upstream proxy; empty before the first connection, and where there is none.
        is_settled: whether a connection has come through it.
        word: replaces ``{session}`` in a user's name: proxies give each such name an address of its own.
    """

    def __init__(self) -> None:
        self.name = ""
        self.is_settled = False
        self.word = secrets.token_hex(4)


class Upstream:
    """One upstream proxy, and how it has done lately."""

    def __init__(self, name: str, config: UpstreamConfig) -> None:
        self.name = name
        parts = urlsplit(config.address)
        self.is_socks = parts.scheme == "socks5"
        self.host = read_host(parts.hostname or "")
        self.port = parts.port or 0
        self.resolves = config.resolve == "there"
        self.rests_until = 0.0
        self._rest = REST_SECONDS[0]
        self._unreached: set[str] = set()
        self._credentials = _read_credentials(name, config.credentials)

    def credentials(self, route: SessionRoute) -> tuple[bytes, bytes] | None:
        """User name and password for a session; ``None`` if the proxy needs none."""
        user, colon, password = self._credentials.partition(":")
        return (user.replace(_SESSION, route.word).encode(), password.encode()) if colon else None

    def note_success(self) -> None:
        """A tunnel was opened."""
        self.rests_until, self._rest = 0.0, REST_SECONDS[0]
        self._unreached.clear()

    def note(self, failure: UpstreamFailed, host: str) -> None:
        """No tunnel to this host was opened: leave the proxy out for a while, if that is its own failure."""
        self._unreached.add(host)
        now = asyncio.get_running_loop().time()
        if (failure.is_own or len(self._unreached) >= _DOUBTED_HOSTS) and now >= self.rests_until:
            self.rests_until = now + self._rest
            self._rest = min(2 * self._rest, REST_SECONDS[1])
            self._unreached.clear()


def _read_credentials(name: str, given: str) -> str:
    """``NAME:PASSWORD`` from the environment variable or the file that the setting names."""
    if not given:
        return ""
    try:
        found = os.environ.get(given[1:], "") if given.startswith("$") else Path(given).read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"the credentials of the upstream proxy {name} cannot be read: {given}") from error
    user, colon, password = found.partition(":")
    if not colon or "\n" in found or max(len(user.encode()), len(password.encode())) > _LONGEST:
        raise ConfigError(f"{given} holds no NAME:PASSWORD for the upstream proxy {name}")
    return found


class Upstreams:
    """The upstream proxies of one process, and which connection takes which.

    Raises:
        ConfigError: credentials cannot be read.
    """

    def __init__(self, config: EgressConfig) -> None:
        self._by_name = {name: Upstream(name, each) for name, each in config.upstream.items()}
        self._turns = list(self._by_name.values())
        parted = (rule.rpartition("=") for rule in config.routes)
        self._rules = [(read_rule(pattern), name) for pattern, _, name in parted]

    def __len__(self) -> int:
        return len(self._by_name)

    def by_rule(self, host: Host, port: int) -> str:
        """The name of the route that a rule gives a host; empty without one."""
        return next((name for rule, name in self._rules if rule.matches(host, port)), "")

    def of(self, name: str, route: SessionRoute) -> Upstream | None:
        """The proxy of a connection; ``None`` for a direct one.

        Args:
            name: by rule; empty for the session's own.
            route: of the session, which gets a proxy if it has none, or if its proxy rests and it is not
                settled.
        """
        if name or not self._by_name:
            return self._by_name.get(name)
        chosen = self._by_name.get(route.name)
        now = asyncio.get_running_loop().time()
        if chosen is None or (chosen.rests_until > now and not route.is_settled):
            # The first in turn of those that do not rest, else the one that rests for the shortest time.
            chosen = min(self._turns, key=lambda each: max(each.rests_until, now))
            self._turns.remove(chosen)
            self._turns.append(chosen)
            route.name = chosen.name
        return chosen


class Talk(asyncio.Protocol):
    """A connection to a proxy until its tunnel is open."""

    transport: asyncio.Transport
    """Set by :meth:`connection_made`."""

    def __init__(self) -> None:
        self.data = b""
        """Received and not yet read: at the end, what already came through the tunnel."""
        self._more = asyncio.Event()
        self._is_over = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is open."""
        self.transport = cast(asyncio.Transport, transport)  # uvloop's is not a subclass

    def data_received(self, data: bytes) -> None:
        """Keep what was received."""
        self.data += data
        self._more.set()

    def eof_received(self) -> None:
        """The proxy has hung up."""
        self._is_over = True
        self._more.set()

    def connection_lost(self, _: Exception | None) -> None:
        """The connection is closed."""
        self.eof_received()

    async def open(self, upstream: Upstream, route: SessionRoute, host: str, port: int) -> None:
        """Ask for a tunnel to a host, a name or an address.

        Raises:
            UpstreamFailed: there is none.
        """
        login = upstream.credentials(route)
        await (self._ask_socks if upstream.is_socks else self._ask_http)(login, host, port)

    async def _ask_http(self, login: tuple[bytes, bytes] | None, host: str, port: int) -> None:
        place = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        head = f"CONNECT {place} HTTP/1.1\r\nHost: {place}\r\n".encode()
        if login:
            head += b"Proxy-Authorization: Basic " + base64.b64encode(b":".join(login)) + b"\r\n"
        self.transport.write(head + b"\r\n")
        reply = await self._read(lambda data: data.find(b"\r\n\r\n") + 4 if b"\r\n\r\n" in data else 0)
        version, _, rest = reply.partition(b" ")
        if not version.startswith(b"HTTP/") or not rest[:3].isdigit():
            raise UpstreamFailed("does not speak HTTP", is_own=True)
        status = int(rest[:3])
        if status == _PROXY_AUTHENTICATION:
            raise UpstreamFailed("refuses the user name and password, or wants some", is_own=True)
        if not 200 <= status < 300:
            is_own = status == _TOO_MANY_REQUESTS
            raise UpstreamFailed(f"did not connect: HTTP status {status}", is_own=is_own)

    async def _ask_socks(self, login: tuple[bytes, bytes] | None, host: str, port: int) -> None:
        """RFC 1928, and RFC 1929 for the password."""
        self.transport.write(b"\5\2\0\2" if login else b"\5\1\0")
        version, method = await self._read_exactly(2)
        if version != 5:
            raise UpstreamFailed("does not speak SOCKS5", is_own=True)
        if method == 2 and login:
            self.transport.write(b"\1" + b"".join(bytes((len(part),)) + part for part in login))
            if (await self._read_exactly(2))[1]:
                raise UpstreamFailed("refuses the user name and password", is_own=True)
        elif method:
            raise UpstreamFailed("wants a user name and a password", is_own=True)
        self.transport.write(b"\5\1\0" + _socks_address(host) + port.to_bytes(2, "big"))
        _, code, _, kind = await self._read_exactly(4)
        if code:
            why = _SOCKS_REPLIES.get(code, f"SOCKS reply {code}")
            raise UpstreamFailed(f"did not connect: {why}", is_own=False)
        size = {1: 4, 4: 16}.get(kind) or (await self._read_exactly(1))[0]
        await self._read_exactly(size + 2)

    async def _read_exactly(self, size: int) -> bytes:
        return await self._read(lambda data: size if len(data) >= size else 0)

    async def _read(self, size_of: Callable[[bytes], int]) -> bytes:
        """Take as many bytes as ``size_of`` says about those that have come; 0 waits for more."""
        while not (size := size_of(self.data)):
            if self._is_over or len(self.data) > _HEAD_BYTES:
                raise UpstreamFailed("hung up" if self._is_over else "gave an endless answer", is_own=True)
            self._more.clear()
            await self._more.wait()
        taken, self.data = self.data[:size], self.data[size:]
        return taken


def _socks_address(host: str) -> bytes:
    if ":" in host:
        return b"\4" + IPv6Address(host).packed
    if host.rpartition(".")[2].isdigit():  # the only names that end in a number are addresses
        return b"\1" + IPv4Address(host).packed
    name = host.encode()
    return b"\3" + bytes((len(name),)) + name
