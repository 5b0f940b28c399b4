"""Which website a URL belongs to. Whoever compares websites asks here: split, blocklist, judge, and others.

A website is a *registrable domain*: ``shop.example.co.uk`` and ``www.example.co.uk`` are the same one,
``example.co.uk``. The host alone would let a test website into training under another name of its own
(``m.``, ``en.``, ``shop.``). Where a suffix is shared by strangers (``github.io``, ``blogspot.com``), the
label before it decides; the Public Suffix List says which these are.
"""

from __future__ import annotations

import ipaddress
import socket
from functools import cache, lru_cache
from typing import Final

import idna
from publicsuffixlist import PublicSuffixList

OFFLINE: Final = ".webgym.test"
"""Each host under it is an offline website of its own; no public list knows it."""
_LONGEST: Final = 8_192
_METADATA: Final = frozenset(
    "metadata metadata.google.internal metadata.goog instance-data instance-data.ec2.internal 100.100.100.200"
    " 168.63.129.16 192.0.0.192 fd00:ec2::254".split()
)
"""Clouds' metadata services, but for the link-local ones, which most have."""


def host_of(website: str) -> str:
    """The host in a bare host or a URL: lower case, in ASCII, without ``www.``, port and trailing dot.

    Raises:
        ValueError: there is none.
    """
    rest = website.strip()
    scheme, separator, after = rest.partition("://")
    if separator and scheme.replace("+", "").replace("-", "").replace(".", "").isalnum():
        rest = after
    for mark in "/?#\\":
        rest = rest.partition(mark)[0]
    rest = rest.rpartition("@")[2]
    if rest.startswith("["):
        address, bracket, _ = rest[1:].partition("]")
        if bracket and _is_address(address):
            return f"[{ipaddress.ip_address(address).compressed}]"
        raise ValueError(f"{website!r} does not name a website")
    host = rest.partition(":")[0].rstrip(".").lower()
    if not host.isascii():
        try:
            host = idna.encode(host, uts46=True).decode("ascii")
        except idna.IDNAError as error:
            raise ValueError(f"{website!r} does not name a website: {error}") from error
    while host.startswith("www.") and host.count(".") >= 2:
        host = host[4:]
    if not _is_name(host):
        raise ValueError(f"{website!r} does not name a website")
    return host


_REMEMBERED: Final = 2**19
"""Websites whose site is remembered: all of the paper's set, which every stage asks about, in 100 MB."""


@lru_cache(_REMEMBERED)
def site_of(website: str) -> str:
    """The website that a bare host or a URL belongs to, as one name to compare by. Remembered.

    Returns:
        The registrable domain; the host itself where that is an address, a public suffix or has no dot.

    Raises:
        ValueError: there is no host.
    """
    host = host_of(website)
    if host.endswith(OFFLINE):
        return host.rsplit(".", 3)[-3] + OFFLINE
    if _is_address(host.strip("[]")):
        return host
    return _suffixes().privatesuffix(host) or host


def site_or_text(website: str) -> str:
    """As :func:`site_of`, for counting and comparing: what does not name a website stands for itself."""
    try:
        return site_of(website)
    except ValueError:
        return website


def host_or_text(website: str) -> str:
    """As :func:`host_of`, for counting and comparing: what does not name a website stands for itself."""
    try:
        return host_of(website)
    except ValueError:
        return website


def why_no_start(website: str) -> str:
    """Why no attempt may start at this address, or bare host; empty if one may.

    What an address of a cloud's metadata service would give away is the keys of the machine. (The browser
    refuses these as well, in whatever spelling, and wherever a page would lead to them.)
    """
    if len(website) > _LONGEST:
        return f"its address has {len(website):,} characters, and at most {_LONGEST:,} are taken"
    scheme, colon, rest = website.strip().partition(":")
    if colon and scheme.isalpha() and scheme.lower() not in ("http", "https") and not rest[:1].isdigit():
        return f"{website[:80]!r} is no http or https address"
    try:
        host = host_of(website).strip("[]")
    except ValueError:
        return f"{website[:80]!r} does not name a website"
    if host in _METADATA or _is_link_local(host):
        return f"{website[:80]!r} is the address of a cloud's metadata service"
    return ""


def _is_link_local(host: str) -> bool:
    if ":" in host:
        return ipaddress.ip_address(host).is_link_local
    try:  # as browsers read it: also 2852039166, and 0xa9.0xfe.0xa9.0xfe
        return ipaddress.ip_address(socket.inet_aton(host)).is_link_local
    except OSError:
        return False


@cache
def _suffixes() -> PublicSuffixList:
    return PublicSuffixList()


def _is_address(host: str) -> bool:
    if not (host[-1:].isdigit() or ":" in host):
        return False
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _is_name(host: str) -> bool:
    labels = host.split(".")
    return len(host) <= 253 and all(
        0 < len(label) <= 63 and label.replace("-", "").replace("_", "").isalnum() for label in labels
    )
