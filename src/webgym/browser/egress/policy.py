"""Decides what may be connected to: by the operator's rules, then by the kinds of addresses. Without I/O."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from webgym.browser.egress.addresses import kind_of, plain
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.hosts import Address, Host
from webgym.browser.egress.rules import Place, read_rule


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
