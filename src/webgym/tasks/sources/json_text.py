"""A reader of JSON text that recovers from broken values."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import NamedTuple

_BLANK = re.compile(r"[\s,]*")
_KEY = re.compile(r'\{\s*("(?:[^"\\\n]|\\.)*")\s*:')
_ENTRY = re.compile(r'("(?:[^"\\\n]|\\.)*")\s*:\s*')
_NEXT_ENTRY = re.compile(r'[}\n]\s*,?\s*("(?:[^"\\\n]|\\.)*"\s*:\s*\{)')
_HOLDS_OBJECTS = re.compile(r'\{\s*"(?:[^"\\\n]|\\.)*"\s*:\s*\{')
_HOLDS_ARRAY = re.compile(r'"\s*:\s*\[(?=\s*\{)')
_DECODER = json.JSONDecoder()


class Value(NamedTuple):
    """A value, its position, whether it is inside of an array or object, and its key."""

    place: str
    value: object
    inside: bool
    key: str | None = None


class BrokenValue(NamedTuple):
    """A value that cannot be read: its position, and why."""

    place: str
    reason: str


def json_values(text: str, *, first_line: int = 1) -> Iterator[Value | BrokenValue]:
    """The elements of the arrays in a text, and the values outside of arrays.

    After a broken element, reading continues at the next object that starts with the same key as this one or
    the one before; if there is none, the rest of the text is one broken value. Missing and superfluous commas
    between elements are ignored. A broken object that contains objects, or an array of them, is read in the
    same way.

    Args:
        text: the JSON text.
        first_line: number of the first line, for positions.
    """
    cursor = _Cursor(text, first_line)
    while cursor.more():
        start = cursor.at
        if text[start] == "[":
            yield from _elements(cursor)
            continue
        result = cursor.step(None)
        if isinstance(result, Value) or cursor.more():
            yield result
        elif _HOLDS_OBJECTS.match(text, start):
            cursor.at = start
            yield from _entries(cursor)
        elif (array := _HOLDS_ARRAY.search(text, start)) is not None:
            while array is not None:
                cursor.at = array.end() - 1
                yield from _elements(cursor)
                array = _HOLDS_ARRAY.search(text, cursor.at)
            return  # other values next to the arrays describe them
        else:
            yield result


def _elements(cursor: _Cursor) -> Iterator[Value | BrokenValue]:
    cursor.at += 1
    index = 0
    while cursor.more() and cursor.text[cursor.at] != "]":
        index += 1
        yield cursor.step(index)
    cursor.at += 1


def _entries(cursor: _Cursor) -> Iterator[Value | BrokenValue]:
    cursor.at += 1
    while cursor.more() and cursor.text[cursor.at] != "}":
        yield cursor.entry()
    cursor.at += 1


class _Cursor:
    def __init__(self, text: str, first_line: int) -> None:
        self.text = text
        self.at = 0
        self._line = first_line
        self._counted = 0
        self._key: str | None = None

    def more(self) -> bool:
        blank = _BLANK.match(self.text, self.at)
        self.at = blank.end() if blank else self.at
        return self.at < len(self.text)

    def step(self, index: int | None) -> Value | BrokenValue:
        """Read the value at ``at``, and move to its end, or to where the next one may start."""
        start, place = self.at, self._place(index)
        key = _KEY.match(self.text, start)
        self._key = key[1] if key else self._key
        try:
            value, self.at = self._decode(start)
        except ValueError as error:
            self.at = self._next_start(start + 1)
            return BrokenValue(place, str(error))
        return Value(place, value, index is not None)

    def entry(self) -> Value | BrokenValue:
        """Read the key and value at ``at``, and move to their end, or to where the next may start."""
        start, place = self.at, self._place(None)
        try:
            if not (key := _ENTRY.match(self.text, start)):
                raise ValueError("no key")
            name, _ = self._decode(start)
            value, self.at = self._decode(key.end())
        except ValueError as error:
            following = _NEXT_ENTRY.search(self.text, start + 1)
            self.at = following.start(1) if following else len(self.text)
            return BrokenValue(place, str(error))
        return Value(f"key {name!r}", value, inside=True, key=str(name))

    def _decode(self, start: int) -> tuple[object, int]:
        """The value at an index, and the index after it.

        Raises:
            ValueError: there is no valid value.
        """
        try:
            return _DECODER.raw_decode(self.text, start)
        except json.JSONDecodeError as error:
            line = self._line + self.text.count("\n", self._counted, error.pos)
            raise ValueError(f"{error.msg} (line {line})") from error
        except RecursionError as error:
            raise ValueError("it is nested too deeply") from error

    def _next_start(self, after: int) -> int:
        if self._key is not None:
            # Not after a colon: that one is inside a record.
            starts = re.compile(r"[,\[\]}\n]\s*(\{\s*" + re.escape(self._key) + r"\s*:)")
            if found := starts.search(self.text, after):
                return found.start(1)
        return len(self.text)

    def _place(self, index: int | None) -> str:
        self._line += self.text.count("\n", self._counted, self.at)
        self._counted = self.at
        return f"line {self._line}" if index is None else f"line {self._line} (record {index})"
