"""The values of a JSON text, of which some may be broken."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import NamedTuple

_BLANK = re.compile(r"[\s,]*")
_KEY = re.compile(r'\{\s*("(?:[^"\\\n]|\\.)*")\s*:')
_DECODER = json.JSONDecoder()


class Value(NamedTuple):
    """A value, where it starts, and whether it is an element of an array."""

    place: str
    value: object
    in_array: bool


class Broken(NamedTuple):
    """A value that cannot be read, where it starts, and why."""

    place: str
    reason: str


def json_values(text: str, *, first_line: int = 1) -> Iterator[Value | Broken]:
    """The elements of the arrays in a text, and the values that stand outside of any.

    After a broken element the next one is looked for: an object that starts with the same key as this one or
    the one before does. Where there is none, the rest of the text is one broken value. Missing and
    superfluous commas between elements do not matter.

    Args:
        first_line: number of the first line, for places.
    """
    walk = _Walk(text, first_line)
    while walk.more():
        if text[walk.at] == "[":
            walk.at += 1
            index = 0
            while walk.more() and text[walk.at] != "]":
                index += 1
                yield walk.step(index)
            walk.at += 1
        else:
            yield walk.step(None)


class _Walk:
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

    def step(self, index: int | None) -> Value | Broken:
        """Read the value at ``at``; go to the end of it, or to where the next one may start."""
        start, place = self.at, self._place(index)
        key = _KEY.match(self.text, start)
        self._key = key[1] if key else self._key
        try:
            value, self.at = _DECODER.raw_decode(self.text, start)
        except RecursionError:
            reason = "it is nested too deeply"
        except json.JSONDecodeError as error:
            reason = f"{error.msg} (line {self._line + self.text.count(chr(10), self._counted, error.pos)})"
        except ValueError as error:
            reason = str(error)
        else:
            return Value(place, value, index is not None)
        self.at = self._next_start(start + 1)
        return Broken(place, reason)

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
