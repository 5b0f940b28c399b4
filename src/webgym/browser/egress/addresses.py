"""Classifies IP addresses.

According to the IANA registries of special-purpose IPv4 and IPv6 addresses (RFC 6890 and its successors), and
the documented metadata services of cloud providers. Defined here because the classification of
:mod:`ipaddress` differs between Python releases.
"""

from __future__ import annotations

from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_network
from typing import Literal, TypeAlias, TypeVar

from webgym.browser.egress.hosts import Address

Kind: TypeAlias = Literal[
    "public", "private", "loopback", "link-local", "multicast", "unspecified", "reserved", "metadata"
]

Network = TypeVar("Network", IPv4Network, IPv6Network)


def _table(kinds: dict[Kind, str]) -> list[tuple[IPv4Network | IPv6Network, Kind]]:
    return [(ip_network(text), kind) for kind, texts in kinds.items() for text in texts.split()]


_METADATA: dict[Kind, str] = {
    # Most clouds; AWS container credentials; Azure's wire server; Alibaba; Oracle; AWS and Google on IPv6.
    "metadata": "169.254.169.254/32 169.254.170.2/32 168.63.129.16/32 100.100.100.200/32 192.0.0.192/32"
    " fd00:ec2::/32 fd20:ce::254/128"
}
_IPV4: dict[Kind, str] = {
    "unspecified": "0.0.0.0/8",
    "loopback": "127.0.0.0/8",
    "private": "10.0.0.0/8 172.16.0.0/12 192.168.0.0/16 100.64.0.0/10",
    "link-local": "169.254.0.0/16",
    "multicast": "224.0.0.0/4",
    # Protocol assignments, documentation, the retired 6to4 relay, benchmarks, class E and broadcast.
    "reserved": "192.0.0.0/24 192.0.2.0/24 198.51.100.0/24 203.0.113.0/24 192.88.99.0/24 198.18.0.0/15"
    " 240.0.0.0/4",
}
_IPV6: dict[Kind, str] = {
    "unspecified": "::/128",
    "loopback": "::1/128",
    "private": "fc00::/7 fec0::/10 64:ff9b:1::/48",
    "link-local": "fe80::/10",
    "multicast": "ff00::/8",
    # Protocol assignments with Teredo and ORCHID, documentation, 6to4: no website has such an address, and
    # the tunnels among them end at an arbitrary IPv4 address.
    "reserved": "2001::/23 2001:db8::/32 3fff::/20 2002::/16",
}
_TABLE = _table(_METADATA) + _table(_IPV4) + _table(_IPV6)
_UNICAST = IPv6Network("2000::/3")
"""The range that IANA assigns for the internet. All other addresses are reserved."""

_NAT64 = IPv6Network("64:ff9b::/96")
_LOW_32 = 0xFFFF_FFFF


def plain(address: Address) -> Address:
    """The IPv4 address of an IPv4-mapped one; any other address unchanged."""
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        return address.ipv4_mapped
    return address


def kind_of(address: Address) -> Kind:
    """The kind of an address; ``public`` is the only kind that may be connected to without a rule.

    An address that contains an IPv4 address (mapped, NAT64) has the kind of that address.
    """
    address = plain(address)
    for network, kind in _TABLE:
        if address.version == network.version and address in network:
            return kind
    if isinstance(address, IPv4Address):
        return "public"
    if address in _NAT64:
        return kind_of(IPv4Address(int(address) & _LOW_32))
    return "public" if address in _UNICAST else "reserved"
