"""Decides what may be connected to, by the operator's rules, then by the kinds of addresses; and opens the
connection that a browser requests, or says why that is not possible.

The rate of connections to one host is limited for all sessions of this process together.
"""

from __future__ import annotations

import asyncio
import errno
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

from webgym.browser.egress.addresses import kind_of, plain
from webgym.browser.egress.budget import Budget, BudgetExceeded
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.hosts import Address, Host, read_host
from webgym.browser.egress.resolver import CACHE_SECONDS, Machine, Resolver
from webgym.browser.egress.rules import Place, read_rule
from webgym.core.errors import EgressRefused, NavigationFailed


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
    """

    place: Place
    is_allowed: bool


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
                return Route(rule.target or Place(host, port), is_allowed=True)
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
        if self._ports and port not in self._ports:
            raise Forbidden(f"port {port} is not among those that websites use")
        return Admitted(public, is_allowed=False)

    @staticmethod
    def _refusal(address: Address, own: frozenset[Address]) -> str | None:
        kind = kind_of(address)
        if kind == "public":
            return f"{address} is this machine itself" if address in own else None
        article = "an" if kind == "unspecified" else "a"
        return f"{address} is {article} {kind} address"


P = TypeVar("P", bound=asyncio.BaseProtocol)

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


class NotConnected(NavigationFailed):
    """No connection could be opened.

    Attributes:
        reason: the reason, as a code.
    """

    code = "not_connected"

    def __init__(self, reason: Reason, why: str = "") -> None:
        super().__init__(_CHROMIUM_ERRORS.get(reason) or why)
        self.reason = reason

    @property
    def is_refusal(self) -> bool:
        """Whether the connection was refused without being tried."""
        return self.reason in ("forbidden", "too_many", "malformed")


class Dialer:
    """Opens the connections of one proxy."""

    def __init__(self, config: EgressConfig, machine: Machine) -> None:
        self._config = config
        self._machine = machine
        self._policy = Policy(config)
        self._resolver = Resolver(machine)
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
            addresses = await self._resolve(route.place.host, budget)
            admitted = self._policy.admit(route, addresses, self._own_addresses())
        except Nowhere:
            raise NotConnected("no_such_name") from None
        except Forbidden as error:
            raise NotConnected("forbidden", f"{EgressRefused.by_policy}: {error}") from None
        except BudgetExceeded as error:
            raise NotConnected("too_many", f"refused: {error}") from None
        self._refuse_own_ports(admitted, route)
        if not admitted.is_allowed:
            await self._wait_for_rate(str(host), budget)
        return await self._connect(admitted.addresses, route.place.port, protocol)

    # --- names --------------------------------------------------------------------------------------

    async def _resolve(self, host: Host, budget: Budget) -> tuple[Address, ...]:
        if not isinstance(host, str):
            return (host,)
        with budget.lookup(host):
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
        delay = self._politeness.delay(budget.bucket(host), asyncio.get_running_loop().time())
        if delay is None:
            raise NotConnected("too_many", f"too many new connections to {host} at the moment; try later")
        if delay:
            await asyncio.sleep(delay)

    async def _connect(self, addresses: tuple[Address, ...], port: int, protocol: Callable[[], P]) -> P:
        """Connect to the first address that accepts. One that does not answer delays the next only
        briefly."""
        failures: list[NotConnected] = []
        deadline = asyncio.get_running_loop().time() + self._config.connect_seconds
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


class Politeness:
    """A token bucket per host, stored as the time at which the bucket is full again.

    Args:
        rate: tokens per second.
        burst: capacity of a bucket, tokens.
        wait_seconds: longest delay.
    """

    _MOST_HOSTS = 4096

    def __init__(self, rate: float, burst: int, wait_seconds: float) -> None:
        self._interval = 1 / rate
        self._depth = (burst - 1) / rate
        self._wait_seconds = wait_seconds
        self._full_at: OrderedDict[str, float] = OrderedDict()

    def delay(self, host: str, now: float) -> float | None:
        """Take a token: seconds until it may be used; ``None`` if that is too long, and none was taken."""
        full_at = max(self._full_at.get(host, now), now)
        delay = max(0.0, full_at - self._depth - now)
        if delay > self._wait_seconds:
            return None
        self._full_at[host] = full_at + self._interval
        self._full_at.move_to_end(host)
        if len(self._full_at) > self._MOST_HOSTS:
            self._full_at.popitem(last=False)  # the least recently used
        return delay
