"""This machine's network configuration. A module of its own, so that tests can replace it."""

from __future__ import annotations

import contextlib
import socket
from ipaddress import ip_address

import psutil
from aiodns import DNSResolver

from webgym.browser.egress.hosts import Address

_ELSEWHERE = ((socket.AF_INET, "198.51.100.1"), (socket.AF_INET6, "2001:db8::1"))
"""Addresses for documentation: nobody is there, but the way leads through the default route."""

_ANY_PORT = 9


_DNS_SECONDS = 1.5
"""For a name server to answer, before it or the next one is asked again."""

_DNS_TRIES = 3


class Machine:
    """This machine, as the system tells: its hosts file and its name servers (c-ares).

    Args:
        resolver: other name servers to ask.
    """

    def __init__(self, resolver: DNSResolver | None = None) -> None:
        self._resolver = resolver

    async def lookup(self, name: str) -> list[Address]:
        """The addresses of a name, those that this machine reaches best first (RFC 6724).

        Raises:
            aiodns.error.DNSError: there are none, and why.
        """
        if self._resolver is None:  # now, as it belongs to the loop that runs
            self._resolver = DNSResolver(timeout=_DNS_SECONDS, tries=_DNS_TRIES)
        found = await self._resolver.getaddrinfo(name, type=socket.SOCK_STREAM)
        return [ip_address(node.addr[0].decode().partition("%")[0]) for node in found.nodes]

    async def close(self) -> None:
        """Ask no more."""
        resolver, self._resolver = self._resolver, None
        if resolver is not None:
            await resolver.close()

    def own_addresses(self) -> frozenset[Address]:
        """Of all its interfaces."""
        families = (socket.AF_INET, socket.AF_INET6)
        return frozenset(
            ip_address(one.address.partition("%")[0])
            for addresses in psutil.net_if_addrs().values()
            for one in addresses
            if one.family in families
        )

    def is_online(self) -> bool:
        """Whether any way leads out. Sends nothing."""
        for family, address in _ELSEWHERE:
            with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect((address, _ANY_PORT))
                return True
        return False
