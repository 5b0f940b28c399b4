"""Parses hosts in any spelling, as a URL parser does (WHATWG URL, "host parsing").

Chromium has parsed a host before it asks the proxy. It is parsed again because the check must not rely on
well-formed requests, and because the operator's rules are written by hand.
"""

from __future__ import annotations

import re
import unicodedata
from ipaddress import IPv4Address, IPv6Address
from typing import TypeAlias

Address: TypeAlias = IPv4Address | IPv6Address
Host: TypeAlias = str | IPv4Address | IPv6Address
"""A name in lower case without its last dot, or an address."""

_NAME = re.compile(r"(?!.*\.\.)[a-z0-9_-][a-z0-9_.-]*")
_NUMBER = re.compile(r"[0-9]+|0x[0-9a-f]*")
_LONGEST_NAME = 253
_LONGEST_LABEL = 63
_DOTS = str.maketrans("。｡", "..")


def read_host(text: str) -> Host:
    """Parse a host.

    Raises:
        ValueError: the text is not a valid host.
    """
    if text.startswith("[") and text.endswith("]"):
        return _ipv6(text[1:-1])
    if ":" in text:
        return _ipv6(text)
    name = unicodedata.normalize("NFKC", text.translate(_DOTS)).lower().removesuffix(".")
    if len(name) > _LONGEST_NAME or not _NAME.fullmatch(name):
        raise ValueError("not a host name")
    labels = name.split(".")
    if any(len(label) > _LONGEST_LABEL for label in labels):
        raise ValueError("not a host name")
    return _ipv4(labels) if _NUMBER.fullmatch(labels[-1]) else name


def _ipv6(text: str) -> IPv6Address:
    if "%" in text:
        raise ValueError("an address with a zone")
    return IPv6Address(text)


def _ipv4(labels: list[str]) -> IPv4Address:
    """One to four numbers, each decimal, octal or hexadecimal; the last one fills the remaining bytes."""
    if len(labels) > 4:
        raise ValueError("not an address")
    numbers = [_number(label) for label in labels]
    *first, last = numbers
    if any(number > 255 for number in first) or last >= 256 ** (5 - len(numbers)):
        raise ValueError("not an address")
    return IPv4Address(last + sum(number * 256 ** (3 - nth) for nth, number in enumerate(first)))


def _number(text: str) -> int:
    if not _NUMBER.fullmatch(text):
        raise ValueError("not an address")
    if text.startswith("0x"):
        return int(text[2:] or "0", 16)
    if len(text) > 1 and text.startswith("0"):
        return int(text, 8)
    return int(text)
