"""Parses the part of SOCKS5 (RFC 1928) that browsers use. Without I/O."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address

LONGEST_HANDSHAKE = 1024
"""Bytes: more than the longest greeting and request together."""

CONNECT = 1
NO_AUTHENTICATION = 0
SUCCEEDED, FAILED, FORBIDDEN, NO_HOST, NO_COMMAND = 0, 1, 2, 4, 7

_VERSION = 5
_IPV4, _NAME, _IPV6 = 1, 3, 4
_WIDTHS = {_IPV4: 4, _IPV6: 16}

WELCOME = bytes((_VERSION, NO_AUTHENTICATION))
NO_METHOD = bytes((_VERSION, 255))


class NotSocks(ValueError):
    """The client does not speak SOCKS5."""


@dataclass(frozen=True)
class Greeting:
    """The first message: the authentication methods that the client offers. ``size`` in bytes."""

    methods: bytes
    size: int


@dataclass(frozen=True)
class Request:
    """The second message: the requested command and address. ``size`` in bytes."""

    command: int
    host: str
    port: int
    size: int


def read_greeting(data: bytes) -> Greeting | None:
    """Parse a greeting; ``None`` while a part of it is missing.

    Raises:
        NotSocks: it is not a SOCKS5 greeting.
    """
    if data and data[0] != _VERSION:
        raise NotSocks
    if len(data) < 2 or len(data) < 2 + data[1]:
        return None
    return Greeting(data[2 : 2 + data[1]], 2 + data[1])


def read_request(data: bytes) -> Request | None:
    """Parse a request; ``None`` while a part of it is missing.

    Raises:
        NotSocks: it is not a SOCKS5 request.
    """
    if data and data[0] != _VERSION:
        raise NotSocks
    if len(data) < 5:
        return None
    kind = data[3]
    if kind not in (_IPV4, _NAME, _IPV6):
        raise NotSocks
    start = 5 if kind == _NAME else 4
    end = start + (data[4] if kind == _NAME else _WIDTHS[kind])
    if len(data) < end + 2:
        return None
    port = int.from_bytes(data[end : end + 2], "big")
    return Request(data[1], _host(kind, data[start:end]), port, end + 2)


def _host(kind: int, encoded: bytes) -> str:
    if kind == _IPV4:
        return str(IPv4Address(encoded))
    if kind == _IPV6:
        return str(IPv6Address(encoded))
    try:
        return encoded.decode()
    except UnicodeDecodeError:
        raise NotSocks from None


def reply(code: int) -> bytes:
    """The reply to a request. Browsers ignore the address in it, which is zero."""
    return bytes((_VERSION, code, 0, _IPV4)) + bytes(6)
