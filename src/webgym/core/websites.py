"""Which website a URL belongs to, for all code that compares websites: split, site health, judge and others.

A website is a *registrable domain*: ``shop.example.co.uk`` and ``www.example.co.uk`` are the same website,
``example.co.uk``. Comparing hosts would let a test website into training under another of its host names
(``m.``, ``en.``, ``shop.``). Under a suffix that different owners share (``github.io``, ``blogspot.com``),
the label before it is part of the website; the Public Suffix List says which suffixes these are.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from functools import cache, lru_cache
from typing import Final
from urllib.parse import unquote

import idna
from publicsuffixlist import PublicSuffixList

OFFLINE: Final = ".webgym.test"
"""Suffix of the offline web, which is not in the public list: each label before it is a website of its
own."""
_MAX_CHARACTERS: Final = 8_192
_LARGEST_PORT: Final = 65_535
_NUMBER: Final = re.compile(r"[0-9]+|0x[0-9a-f]*")
_PATH: Final = re.compile(r"[/?#\\].*", re.DOTALL)
_METADATA: Final = frozenset(
    "metadata metadata.google.internal metadata.goog instance-data instance-data.ec2.internal 100.100.100.200"
    " 168.63.129.16 192.0.0.192 fd00:ec2::254".split()
)
"""Addresses of cloud metadata services, except for link-local ones, which are recognised by their range."""


def host_of(website: str) -> str:
    """The host in a bare host or a URL: lower case, in ASCII, without ``www.``, port and trailing dot; an
    address of four bytes in decimal, however it is written.

    Raises:
        ValueError: it contains no valid host.
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
        if bracket and ":" in address and _is_address(address):
            mapped = ipaddress.IPv6Address(address).ipv4_mapped
            return str(mapped) if mapped else f"[{ipaddress.IPv6Address(address).compressed}]"
        raise ValueError(f"{website!r} does not name a website")
    host = unquote(rest.partition(":")[0]).rstrip(".").lower()
    if not host.isascii():
        try:
            host = idna.encode(host, uts46=True).decode("ascii")
        except idna.IDNAError as error:
            raise ValueError(f"{website!r} does not name a website: {error}") from error
    while host.startswith("www.") and host.count(".") >= 2:
        host = host[4:]
    if not _is_name(host):
        raise ValueError(f"{website!r} does not name a website")
    if not _NUMBER.fullmatch(host.rpartition(".")[2]):
        return host
    try:  # as browsers read it: also 2130706433, 127.1 and 0x7f.0.0.1
        return socket.inet_ntoa(socket.inet_aton(host))
    except OSError as error:
        raise ValueError(f"{website!r} does not name a website") from error


_CACHE_SIZE: Final = 2**19
"""Number of cached websites: enough for the paper's task set, in about 100 MB."""


@lru_cache(_CACHE_SIZE)
def site_of(website: str) -> str:
    """The website that a bare host or a URL belongs to, by its canonical name. Cached.

    Returns:
        The registrable domain; the host itself if it is an IP address, a public suffix or has no dot.

    Raises:
        ValueError: it contains no valid host.
    """
    host = host_of(website)
    if host.endswith(OFFLINE):
        return host.rsplit(".", 3)[-3] + OFFLINE
    if _is_address(host.strip("[]")):
        return host
    return _suffixes().privatesuffix(host) or host


def site_or_text(website: str) -> str:
    """As :func:`site_of`, but returns a text that does not name a website unchanged."""
    try:
        return site_of(website)
    except ValueError:
        return website


def host_or_text(website: str) -> str:
    """As :func:`host_of`, but returns a text that does not name a website unchanged."""
    try:
        return host_of(website)
    except ValueError:
        return website


_SCHEME: Final = re.compile(r"https?:|[a-z][a-z0-9+.-]*:(?!\d)")
"""The scheme of a URL, rather than a host and its port. Browsers need no slashes after "https:"."""


def start_url_problem(website: str) -> str:
    """Why no attempt may start at this URL or bare host; empty if it may.

    A name without a dot, such as ``__SHOP__`` or ``N/A``, is a placeholder, unless it is ``localhost`` or
    comes with a scheme and a port, as a service in the own network does (``http://shop:7770/``).

    Addresses of cloud metadata services are refused because they give away the machine's credentials. (The
    browser refuses them as well, in any spelling, including after redirects and links.)
    """
    if len(website) > _MAX_CHARACTERS:
        return f"its address has {len(website):,} characters, more than {_MAX_CHARACTERS:,}"
    address = website.strip().lower()
    if _SCHEME.match(address) and not address.startswith(("http://", "https://")):
        return f"{website[:80]!r} is not an http or https address"
    try:
        host = host_of(website).strip("[]")
    except ValueError:
        return f"{website[:80]!r} does not name a website"
    if host in _METADATA or (_is_address(host) and ipaddress.ip_address(host).is_link_local):
        return f"{website[:80]!r} is the address of a cloud metadata service"
    scheme, _, rest = address.partition("://") if _SCHEME.match(address) else ("", "", address)
    port = _PATH.sub("", rest).rpartition("@")[2].rpartition("]")[2].partition(":")[2]
    is_local = host == "localhost" or (scheme and port)
    is_port = not port or (port.isdecimal() and int(port) <= _LARGEST_PORT)
    if not ("." in host or ":" in host or is_local) or not is_port:
        return f"{website[:80]!r} does not name a website"
    return ""


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


def is_loopback(host: str | None) -> bool:
    """Whether a URL's host is this machine."""
    try:
        return ipaddress.ip_address(host or "").is_loopback
    except ValueError:
        return host == "localhost"
