"""Whether a record that somebody else's code made can be stored and read again."""

from __future__ import annotations

import msgspec


def refuse_untyped(record: object, kind: type[msgspec.Struct]) -> None:
    """Refuse a record that would not be read again: structs take values of any type.

    Raises:
        TypeError: it is of another kind, or holds what no record can.
        ValueError: a value is of another type; the message says which.
        OverflowError: a number is too large.
    """
    if not isinstance(record, kind):
        raise TypeError(f"this is a {type(record).__name__}, not a {kind.__name__}")
    try:
        body = msgspec.json.encode(record)
    except UnicodeEncodeError:  # lone surrogates are replaced where it is stored
        msgspec.convert(msgspec.to_builtins(record), kind)
    else:
        msgspec.json.decode(body, type=kind)
