"""Decides what may be connected to, by the operator's rules, then by the kinds of addresses; and opens the
connection that a browser requests, or says why that is not possible.

The rate of connections to one host is limited for all sessions of this process together.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Literal, TypeAlias, TypeVar

from publicsuffixlist import PublicSuffixList

from webgym.browser.egress.addresses import kind_of, plain
from webgym.browser.egress.budget import Budget, BudgetExceeded, Politeness
from webgym.browser.egress.config import DIRECT, EgressConfig
from webgym.browser.egress.hosts import Address, Host, read_host
from webgym.browser.egress.resolver import CACHE_SECONDS, Machine, Resolver
from webgym.browser.egress.rules import Place, read_rule
from webgym.browser.egress.upstream import SessionRoute, Talk, Upstream, UpstreamFailed, Upstreams
from webgym.core.errors import EgressRefused, NavigationFailed, RouteFailed


class Forbidden(Exception):
    """The policy refuses the connection; the message says why."""


class Nowhere(Exception):
    """A rule says that the name does not exist."""


@dataclass(frozen=True)
class Route:
    """Where to connect for a requested host.

    Attributes:
        place: the host and port to resolve and connect to.
        is_allowed: whether a rule allows it, whatever its addresses are.
        is_elsewhere: whether that rule leads somewhere else.
    """

    place: Place
    is_allowed: bool
    is_elsewhere: bool = False


@dataclass(frozen=True)
class Admitted:
    """The addresses that may be connected to.

    Attributes:
        addresses: in order of preference.
        is_allowed: whether a rule allows them, so that the rate limit does not apply.
    """

    addresses: tuple[Address, ...]
    is_allowed: bool


class Policy:
    """The rules and the ports of one configuration."""

    def __init__(self, config: EgressConfig) -> None:
        self._rules = [read_rule(text) for text in config.allow]
        self._ports = frozenset(config.ports)

    def route(self, host: Host, port: int) -> Route:
        """Apply the rules to a requested host.

        Raises:
            Nowhere: a rule says that it does not exist.
        """
        for rule in self._rules:
            if rule.matches(host, port):
                if rule.is_nowhere:
                    raise Nowhere
                place = rule.target or Place(host, port)
                return Route(place, is_allowed=True, is_elsewhere=rule.target is not None)
        return Route(Place(host, port), is_allowed=False)

    def admit(self, route: Route, addresses: Iterable[Address], own: frozenset[Address]) -> Admitted:
        """The addresses that may be connected to.

        Args:
            route: the result of :meth:`route`.
            addresses: the addresses of its host.
            own: the addresses of this machine, of which public ones are refused like loopback.

        Raises:
            Forbidden: none of them may be connected to.
        """
        unique = tuple(dict.fromkeys(plain(address) for address in addresses))
        if route.is_allowed:
            return Admitted(unique, is_allowed=True)
        port = route.place.port
        by_rule = tuple(it for it in unique if any(rule.contains(it, port) for rule in self._rules))
        if by_rule:
            return Admitted(by_rule, is_allowed=True)
        refusals = {address: self._refusal(address, own) for address in unique}
        public = tuple(address for address, why in refusals.items() if why is None)
        if not public:
            raise Forbidden(next(why for why in refusals.values() if why))
        self._check_port(port)
        return Admitted(public, is_allowed=False)

    def admit_name(self, name: str, route: Route) -> Admitted:
        """The same for a name that an upstream proxy looks up: without addresses.

        Raises:
            Forbidden: it is no name of the public internet.
        """
        if not route.is_allowed:
            if not _is_public(name):
                raise Forbidden(f"{name} is not a name of the public internet")
            self._check_port(route.place.port)
        return Admitted((), route.is_allowed)

    def _check_port(self, port: int) -> None:
        if self._ports and port not in self._ports:
            raise Forbidden(f"port {port} is not among those that websites use")

    @staticmethod
    def _refusal(address: Address, own: frozenset[Address]) -> str | None:
        kind = kind_of(address)
        if kind == "public":
            return f"{address} is this machine itself" if address in own else None
        article = "an" if kind == "unspecified" else "a"
        return f"{address} is {article} {kind} address"


@cache
def _suffixes() -> PublicSuffixList:
    return PublicSuffixList(accept_unknown=False)


_TESTING = frozenset({"test", "example"})
"""Top-level domains that nobody can have (RFC 2606), so that they lead into no private network either."""


def _is_public(name: str) -> bool:
    top = name.rpartition(".")[2]
    return "." in name and top != "arpa" and (top in _TESTING or _suffixes().publicsuffix(name) is not None)


P = TypeVar("P", bound=asyncio.Protocol)

Reason: TypeAlias = Literal[
    "no_such_name",
    "dns_failed",
    "dns_timed_out",
    "refused",
    "timed_out",
    "reset",
    "unreachable",
    "offline",
    "no_resources",
    "malformed",
    "forbidden",
    "too_many",
    "unreached",
    "upstream",
]

_CHROMIUM_ERRORS: dict[Reason, str] = {
    "no_such_name": "net::ERR_NAME_NOT_RESOLVED",
    "dns_failed": "net::ERR_NAME_RESOLUTION_FAILED",
    "dns_timed_out": "net::ERR_DNS_TIMED_OUT",
    "refused": "net::ERR_CONNECTION_REFUSED",
    "timed_out": "net::ERR_CONNECTION_TIMED_OUT",
    "reset": "net::ERR_CONNECTION_RESET",
    "unreachable": "net::ERR_ADDRESS_UNREACHABLE",
    "offline": "net::ERR_INTERNET_DISCONNECTED",
    "no_resources": "net::ERR_INSUFFICIENT_RESOURCES",
}
"""Chromium's errors for these reasons when it connects directly."""

_REASON_BY_ERRNO: dict[int, Reason] = {
    errno.ECONNREFUSED: "refused",
    errno.ETIMEDOUT: "timed_out",
    errno.ECONNRESET: "reset",
    errno.EMFILE: "no_resources",
    errno.ENFILE: "no_resources",
    errno.ENOBUFS: "no_resources",
    errno.ENOMEM: "no_resources",
}
_NO_ROUTE = frozenset({errno.ENETUNREACH, errno.ENETDOWN, errno.EADDRNOTAVAIL})

ATTEMPT_SECONDS = 2.5
"""Connecting to one address out of several; the last one has the remaining time."""


UPSTREAM_SECONDS = 3.0
"""Connecting to an upstream proxy, which then has the whole time for its own connection: both together, and a
second try, take less than a navigation may."""


class NotConnected(NavigationFailed):
    """No connection could be opened.

    Attributes:
        reason: the reason, as a code. ``upstream``: an upstream proxy failed; ``unreached``: it did not reach
            the host.
    """

    code = "not_connected"

    def __init__(self, reason: Reason, why: str = "") -> None:
        super().__init__(_CHROMIUM_ERRORS.get(reason) or why)
        self.reason = reason

    @property
    def kind(self) -> type[NavigationFailed]:
        """The error of a page that needed the connection."""
        if self.reason in ("forbidden", "too_many", "malformed"):  # without being tried
            return EgressRefused
        return RouteFailed if self.reason == "upstream" else NavigationFailed


class Dialer:
    """Opens the connections of one proxy."""

    def __init__(self, config: EgressConfig, machine: Machine) -> None:
        self._config = config
        self._machine = machine
        self._policy = Policy(config)
        self._resolver = Resolver(machine)
        self.upstreams = Upstreams(config)
        self._politeness = Politeness(config.rate, config.burst, config.wait_seconds)
        self._own_addresses_cache: frozenset[Address] = frozenset()
        self._own_until = 0.0
        self.own_ports: set[int] = set()
        """The proxy's ports, to which it must not connect itself."""

    async def close(self) -> None:
        """Cancel lookups."""
        await self._resolver.close()

    async def dial(self, text: str, port: int, budget: Budget, protocol: Callable[[], P]) -> P:
        """Connect to a host, at an address that was checked.

        Args:
            text: the host, in any spelling.
            port: the port.
            budget: budget of the requesting session.
            protocol: creates the protocol of the connection.

        Raises:
            NotConnected: with the reason.
        """
        try:
            host = read_host(text)
        except ValueError as error:
            raise NotConnected("malformed", f"{text[:80]!r} cannot be connected to: {error}") from None
        try:
            route = self._policy.route(host, port)
            upstream = self._upstream_of(route, host, port, budget.route)
            admitted = await self._admit(route, upstream, budget)
        except Nowhere:
            raise NotConnected("no_such_name") from None
        except Forbidden as error:
            raise NotConnected("forbidden", f"{EgressRefused.by_policy}: {error}") from None
        except BudgetExceeded as error:
            raise NotConnected("too_many", f"refused: {error}") from None
        if not admitted.is_allowed:
            await self._wait_for_rate(str(host), budget)
        if upstream is not None:
            return await self._tunnel(upstream, admitted, route.place, budget.route, protocol)
        self._refuse_own_ports(admitted, route)
        seconds = self._config.connect_seconds
        return await self._connect(admitted.addresses, route.place.port, protocol, seconds)

    async def _admit(self, route: Route, upstream: Upstream | None, budget: Budget) -> Admitted:
        name = route.place.host
        if upstream is not None and upstream.resolves and isinstance(name, str):
            return self._policy.admit_name(name, route)
        return self._policy.admit(route, await self._resolve(name, budget), self._own_addresses())

    # --- upstream proxies ---------------------------------------------------------------------------

    def _upstream_of(self, route: Route, host: Host, port: int, session: SessionRoute) -> Upstream | None:
        name = self.upstreams.by_rule(host, port)
        return None if route.is_elsewhere and not name else self.upstreams.of(name, session)

    def route_name(self, host: Host, port: int, session: SessionRoute) -> str:
        """The name of the route to a host, for records; empty where there are no upstream proxies."""
        if not self.upstreams:
            return ""
        name = self.upstreams.by_rule(host, port)
        if not name:
            with contextlib.suppress(Nowhere):
                name = DIRECT if self._policy.route(host, port).is_elsewhere else session.name
        return name

    async def _tunnel(
        self,
        upstream: Upstream,
        admitted: Admitted,
        place: Place,
        session: SessionRoute,
        protocol: Callable[[], P],
    ) -> P:
        """A connection through an upstream proxy, tried again if the proxy itself failed: by the next one in
        turn, unless the session is settled."""
        host = str(admitted.addresses[0] if admitted.addresses else place.host)
        tries = 2 if session.is_settled else max(2, len(self.upstreams))
        deadline = asyncio.get_running_loop().time() + self._config.connect_seconds
        while True:
            tries -= 1
            try:
                talk = await self._open_tunnel(upstream, session, host, place.port)
            except UpstreamFailed as failure:
                upstream.note(failure, host)
                why = f"the upstream proxy {upstream.name} {failure}"
                if not failure.is_own:
                    raise NotConnected("unreached", why) from None
                if not tries or asyncio.get_running_loop().time() > deadline:
                    raise NotConnected("upstream", why) from None
                if upstream.name == session.name:
                    upstream = self.upstreams.of("", session) or upstream
            else:
                break
        upstream.note_success()
        session.is_settled |= upstream.name == session.name
        end = protocol()
        talk.transport.set_protocol(end)
        end.connection_made(talk.transport)
        if talk.data:
            end.data_received(talk.data)
        return end

    async def _open_tunnel(self, upstream: Upstream, session: SessionRoute, host: str, port: int) -> Talk:
        talk: Talk | None = None
        try:
            addresses = await self._look_up(upstream.host)
            talk = await self._connect(addresses, upstream.port, Talk, UPSTREAM_SECONDS)
            async with asyncio.timeout(self._config.connect_seconds):
                await talk.open(upstream, session, host, port)
            return talk
        except BaseException as error:
            if talk is not None:
                talk.transport.abort()
            if isinstance(error, NotConnected):
                raise UpstreamFailed(f"cannot be connected to: {error.reason}", is_own=True) from None
            if isinstance(error, TimeoutError):
                raise UpstreamFailed("gave no answer", is_own=False) from None
            raise

    # --- names --------------------------------------------------------------------------------------

    async def _resolve(self, host: Host, budget: Budget) -> tuple[Address, ...]:
        with budget.lookup(host) if isinstance(host, str) else contextlib.nullcontext():
            return await self._look_up(host)

    async def _look_up(self, host: Host) -> tuple[Address, ...]:
        if not isinstance(host, str):
            return (host,)
        answer = await self._resolver.resolve(host)
        if isinstance(answer, tuple):
            return answer
        if answer != "no_such_name" and not self._machine.is_online():
            raise NotConnected("offline")
        raise NotConnected(answer)

    def _own_addresses(self) -> frozenset[Address]:
        now = asyncio.get_running_loop().time()
        if now >= self._own_until:
            self._own_addresses_cache = self._machine.own_addresses()
            self._own_until = now + CACHE_SECONDS
        return self._own_addresses_cache

    def _refuse_own_ports(self, admitted: Admitted, route: Route) -> None:
        if route.place.port not in self.own_ports:
            return
        for address in admitted.addresses:
            plain_address = plain(address)
            is_local = plain_address.is_loopback or plain_address.is_unspecified
            if is_local or plain_address in self._own_addresses_cache:
                raise NotConnected("forbidden", f"{EgressRefused.by_policy}: this is the proxy itself")

    # --- connections --------------------------------------------------------------------------------

    async def _wait_for_rate(self, host: str, budget: Budget) -> None:
        now, bucket = asyncio.get_running_loop().time(), budget.bucket(host)
        is_own_doing = not budget.may_connect(bucket, now)
        delay = self._politeness.delay(bucket, now)
        if delay is None:
            if not is_own_doing:
                budget.crowd(host)
            raise NotConnected("too_many", f"too many new connections to {host} at the moment; try later")
        if delay:
            await asyncio.sleep(delay)

    async def _connect(
        self, addresses: tuple[Address, ...], port: int, protocol: Callable[[], P], seconds: float
    ) -> P:
        """Connect to the first address that accepts. One that does not answer delays the next only
        briefly."""
        failures: list[NotConnected] = []
        deadline = asyncio.get_running_loop().time() + seconds
        for nth, address in enumerate(addresses, 1):
            until = deadline
            if nth < len(addresses):
                until = min(deadline, asyncio.get_running_loop().time() + ATTEMPT_SECONDS)
            try:
                return await self._attempt(address, port, protocol, until)
            except NotConnected as failure:
                failures.append(failure)
        # On a machine without IPv6, IPv6 addresses are unreachable; other reasons say more.
        raise next((failure for failure in failures if failure.reason != "unreachable"), failures[-1])

    async def _attempt(self, address: Address, port: int, protocol: Callable[[], P], until: float) -> P:
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout_at(until):
                return (await loop.create_connection(protocol, str(address), port))[1]
        except TimeoutError:
            raise NotConnected("timed_out") from None
        except OSError as error:
            number = error.errno or 0
            if number in _NO_ROUTE and not self._machine.is_online():
                raise NotConnected("offline") from None
            raise NotConnected(_REASON_BY_ERRNO.get(number, "unreachable")) from None
