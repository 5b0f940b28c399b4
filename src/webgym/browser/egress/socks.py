"""SOCKS5 (RFC 1928), as much of it as a browser speaks. Pure: bytes in, what they mean out."""

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
    """Whoever has connected speaks something else."""


@dataclass(frozen=True)
class Greeting:
    """The first message: how the client could authenticate. ``size`` in bytes."""

    methods: bytes
    size: int


@dataclass(frozen=True)
class Request:
    """The second message: what the client wants. ``size`` in bytes."""

    command: int
    host: str
    port: int
    size: int


def read_greeting(held: bytes) -> Greeting | None:
    """The greeting; ``None`` while a part of it is missing.

    Raises:
        NotSocks: it is none.
    """
    if held and held[0] != _VERSION:
        raise NotSocks
    if len(held) < 2 or len(held) < 2 + held[1]:
        return None
    return Greeting(held[2 : 2 + held[1]], 2 + held[1])


def read_request(held: bytes) -> Request | None:
    """The request; ``None`` while a part of it is missing.

    Raises:
        NotSocks: it is none.
    """
    if held and held[0] != _VERSION:
        raise NotSocks
    if len(held) < 5:
        return None
    kind = held[3]
    if kind not in (_IPV4, _NAME, _IPV6):
        raise NotSocks
    start = 5 if kind == _NAME else 4
    end = start + (held[4] if kind == _NAME else _WIDTHS[kind])
    if len(held) < end + 2:
        return None
    port = int.from_bytes(held[end : end + 2], "big")
    return Request(held[1], _host(kind, held[start:end]), port, end + 2)


def _host(kind: int, raw: bytes) -> str:
    if kind == _IPV4:
        return str(IPv4Address(raw))
    if kind == _IPV6:
        return str(IPv6Address(raw))
    try:
        return raw.decode()
    except UnicodeDecodeError:
        raise NotSocks from None


def reply(code: int) -> bytes:
    """The answer to a request. The address in it means nothing to a browser."""
    return bytes((_VERSION, code, 0, _IPV4)) + bytes(6)
