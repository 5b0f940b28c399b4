"""What this machine's network says. Apart, so that tests can put another in its place."""

from __future__ import annotations

import contextlib
import socket
from ipaddress import ip_address

import psutil

from webgym.browser.egress.hosts import Address

_ELSEWHERE = ((socket.AF_INET, "198.51.100.1"), (socket.AF_INET6, "2001:db8::1"))
"""Addresses for documentation: nobody is there, but the way leads through the default route."""

_ANY_PORT = 9


class Machine:
    """This machine, as the system tells."""

    def lookup(self, name: str) -> list[Address]:
        """The addresses of a name, the system's preference first. Blocks.

        Raises:
            OSError: as :func:`socket.getaddrinfo` does.
        """
        found = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
        return [ip_address(str(where[0]).partition("%")[0]) for *_, where in found]

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
