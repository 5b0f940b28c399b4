"""What may be connected to: the operator's rules first, then the kinds of addresses. Pure: no I/O."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from webgym.browser.egress.addresses import kind_of, plain
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.hosts import Address, Host
from webgym.browser.egress.rules import Place, read_rule


class Forbidden(Exception):
    """The policy says no; the message says why."""


class Nowhere(Exception):
    """A rule says that there is no such name."""


@dataclass(frozen=True)
class Route:
    """Where a host that was asked for leads.

    Attributes:
        place: what is to be resolved and connected to.
        is_allowed: a rule says so, whatever its addresses are.
    """

    place: Place
    is_allowed: bool


@dataclass(frozen=True)
class Admitted:
    """What is left to be connected to.

    Attributes:
        addresses: in order.
        is_allowed: all of them by a rule: no limit of politeness is meant for them.
    """

    addresses: tuple[Address, ...]
    is_allowed: bool


class Policy:
    """The rules and the ports of one configuration."""

    def __init__(self, config: EgressConfig) -> None:
        self._rules = [read_rule(text) for text in config.allow]
        self._ports = frozenset(config.ports)

    def route(self, host: Host, port: int) -> Route:
        """What the rules say of a host.

        Raises:
            Nowhere: that it does not exist.
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
            own: the public addresses of this machine, which are as good as loopback.

        Raises:
            Forbidden: none may.
        """
        found = tuple(dict.fromkeys(plain(address) for address in addresses))
        if route.is_allowed:
            return Admitted(found, is_allowed=True)
        port = route.place.port
        by_rule = tuple(one for one in found if any(rule.holds(one, port) for rule in self._rules))
        if by_rule:
            return Admitted(by_rule, is_allowed=True)
        refusals = {one: self._refusal(one, own) for one in found}
        public = tuple(one for one, why in refusals.items() if why is None)
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
