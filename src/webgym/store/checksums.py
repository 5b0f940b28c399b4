"""JSON lines with their own checksums: ``{"sha256":"<hex>","<key>":<JSON>}``.

The digest covers the exact bytes of the record's JSON, so that a record is verified without decoding it, and
any program that reads JSON lines can read it.
"""

from __future__ import annotations

import hashlib
from typing import Any

import msgspec

_OPEN = b'{"sha256":"'
_CLOSE = b"}\n"
_DIGEST = slice(len(_OPEN), len(_OPEN) + 64)


def whole_text(value: Any) -> Any:
    """The same value with lone surrogates, which UTF-8 cannot encode, replaced by U+FFFD."""
    if isinstance(value, str):
        return value.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    if isinstance(value, dict):
        return {whole_text(key): whole_text(item) for key, item in value.items()}
    return [whole_text(item) for item in value] if isinstance(value, list | tuple) else value


def encode(record: msgspec.Struct) -> bytes:
    """A record as JSON; lone surrogates are replaced."""
    try:
        return msgspec.json.encode(record)
    except UnicodeEncodeError:  # page text and replies may hold halves of a surrogate pair
        return msgspec.json.encode(whole_text(msgspec.to_builtins(record)))


class SealedLines:
    """The lines of one kind of record.

    Args:
        key: names the record in a line.
    """

    def __init__(self, key: str) -> None:
        self._middle = f'","{key}":'.encode()
        self._body = slice(_DIGEST.stop + len(self._middle), -len(_CLOSE))

    def seal(self, body: bytes) -> bytes:
        """The line for the JSON of a record."""
        return b"".join((_OPEN, hashlib.sha256(body).hexdigest().encode(), self._middle, body, _CLOSE))

    def unseal(self, line: bytes) -> bytes:
        """The JSON of the record in a line.

        Raises:
            ValueError: the line is damaged; the message is the reason.
        """
        between = line[_DIGEST.stop : self._body.start]
        if not (line.startswith(_OPEN) and line.endswith(_CLOSE) and between == self._middle):
            raise ValueError("not a record")
        body = line[self._body]
        if hashlib.sha256(body).hexdigest().encode() != line[_DIGEST]:
            raise ValueError("the checksum does not match")
        return body
