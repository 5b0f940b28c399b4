"""This machine's network configuration. A module of its own, so that tests can replace it."""

from __future__ import annotations

import contextlib
import socket
from ipaddress import ip_address

import psutil
from aiodns import DNSResolver

from webgym.browser.egress.hosts import Address

_REMOTE_ADDRESSES = ((socket.AF_INET, "198.51.100.1"), (socket.AF_INET6, "2001:db8::1"))
"""Addresses reserved for documentation: no host has them, but they are reached by the default route."""

_ANY_PORT = 9


_DNS_SECONDS = 1.5
"""Deadline of a name server's answer, before it or the next one is queried again."""

_DNS_TRIES = 3


class Machine:
    """This machine's network configuration: its hosts file and its name servers (c-ares).

    Args:
        resolver: resolver to use instead of the system's name servers.
    """

    def __init__(self, resolver: DNSResolver | None = None) -> None:
        self._resolver = resolver

    async def lookup(self, name: str) -> list[Address]:
        """The addresses of a name, in order of preference (RFC 6724).

        Raises:
            aiodns.error.DNSError: there are none; with the reason.
        """
        if self._resolver is None:  # created here, because it belongs to the running event loop
            self._resolver = DNSResolver(timeout=_DNS_SECONDS, tries=_DNS_TRIES)
        answer = await self._resolver.getaddrinfo(name, type=socket.SOCK_STREAM)
        return [ip_address(node.addr[0].decode().partition("%")[0]) for node in answer.nodes]

    async def close(self) -> None:
        """Close the resolver."""
        resolver, self._resolver = self._resolver, None
        if resolver is not None:
            await resolver.close()

    def own_addresses(self) -> frozenset[Address]:
        """The addresses of all its network interfaces."""
        families = (socket.AF_INET, socket.AF_INET6)
        return frozenset(
            ip_address(interface.address.partition("%")[0])
            for addresses in psutil.net_if_addrs().values()
            for interface in addresses
            if interface.family in families
        )

    def is_online(self) -> bool:
        """Whether there is a default route. Sends nothing."""
        for family, address in _REMOTE_ADDRESSES:
            with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect((address, _ANY_PORT))
                return True
        return False
