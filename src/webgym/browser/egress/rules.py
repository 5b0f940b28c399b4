"""Parses the operator's rules, ``PATTERN[:PORT][=TARGET]``, and lists of hosts that are blocked."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Network, ip_network
from pathlib import Path

from webgym.browser.egress.addresses import plain
from webgym.browser.egress.hosts import Address, Host, read_host
from webgym.core.errors import ConfigError

NOWHERE = "nowhere"
_ANY = "*"
_HIGHEST_PORT = 65535


@dataclass(frozen=True)
class Place:
    """A host and a port."""

    host: Host
    port: int


@dataclass(frozen=True)
class Rule:
    """One rule.

    Attributes:
        name: the name that it applies to; with a leading dot, the names below it; empty for a network.
        network: the network of addresses that it applies to; ``None`` for a name.
        port: the port that it applies to; ``None`` for any.
        target: where to connect instead; ``None`` for the host itself.
        is_nowhere: whether it says that the name does not exist.
    """

    name: str = ""
    network: IPv4Network | IPv6Network | None = None
    port: int | None = None
    target: Place | None = None
    is_nowhere: bool = False

    def matches(self, host: Host, port: int) -> bool:
        """Whether it applies to this host, as requested."""
        if self.port not in (None, port):
            return False
        if self.name == _ANY:
            return True
        if not isinstance(host, str):
            return self.contains(host, port)
        return host.endswith(self.name) if self.name.startswith(".") else host == self.name

    def contains(self, address: Address, port: int) -> bool:
        """Whether it applies to a network that contains this address."""
        if self.network is None or self.port not in (None, port):
            return False
        address = plain(address)
        return address.version == self.network.version and address in self.network


def read_rule(text: str) -> Rule:
    """Parse a rule.

    Raises:
        ValueError: the text is not a valid rule.
    """
    pattern, equals, target = text.strip().partition("=")
    try:
        rule = _pattern(pattern)
        if not equals:
            return rule
        if rule.network is not None:
            raise ValueError("an address cannot be redirected")
        if target == NOWHERE:
            return Rule(rule.name, port=rule.port, is_nowhere=True)
        host, port = _split_port(target)
        if port is None:
            raise ValueError("a target needs a port")
        return Rule(rule.name, port=rule.port, target=Place(read_host(host), port))
    except ValueError as error:
        raise ValueError(f"{text!r} is not a rule PATTERN[:PORT][=HOST:PORT]: {error}") from None


def blocked_names(files: Iterable[Path]) -> frozenset[str]:
    """The names in files of the hosts format: an address and names, or a name alone, per line.

    Names without a dot, such as ``localhost``, are left out; names below a listed one are not blocked.

    Raises:
        ConfigError: a file cannot be read.
    """
    names = set[str]()
    for file in files:
        try:
            lines = file.read_text().lower().splitlines()
        except (OSError, ValueError) as error:
            raise ConfigError(f"cannot read the block list {file}: {error}") from error
        for line in lines:
            first, *others = line.partition("#")[0].split() or [""]
            names.update(name for name in others or [first] if "." in name)
    return frozenset(names)


def _pattern(text: str) -> Rule:
    name, port = _split_port(text)
    if name == _ANY:
        return Rule(_ANY, port=port)
    if "/" in name:
        return Rule(network=ip_network(name.strip("[]")), port=port)
    if name.startswith("*."):
        below = read_host(name[2:])
        if not isinstance(below, str):
            raise ValueError("an address has no subdomains")
        return Rule(f".{below}", port=port)
    host = read_host(name)
    return (
        Rule(host, port=port) if isinstance(host, str) else Rule(network=ip_network(plain(host)), port=port)
    )


def _split_port(text: str) -> tuple[str, int | None]:
    """``host:port``, ``[v6]:port``, or either alone; a bare IPv6 address has no port."""
    head, colon, tail = text.rpartition(":")
    if not colon or (":" in head and not head.endswith("]")):
        return text, None
    if not tail.isascii() or not tail.isdigit() or not 0 < int(tail) <= _HIGHEST_PORT:
        raise ValueError(f"{tail!r} is not a port")
    return head, int(tail)
