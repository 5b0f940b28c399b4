"""A reader of CSV text that accepts fields of any length and recovers from broken rows.

The standard library's reader has a process-wide limit on the length of a field, and after a quote that is
never closed it loses the rest of the file. This one reads RFC 4180 as most programs write it.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator
from typing import TypeAlias

_DELIMITERS = ",\t;|"
_QUOTED = re.compile(r'"[^"]*"')

Line: TypeAlias = tuple[int, str]


def csv_rows(lines: Iterator[Line]) -> Iterator[tuple[str, dict[str, str] | str]]:
    """The rows of a CSV text, as mappings with the names in its first row as keys.

    Args:
        lines: line numbers and texts, without line ends. A line end inside a quoted field becomes ``\\n``.

    Yields:
        A position (``"line 7"``), and the row or, for a broken row, what is wrong with it. After a quote that
        is never closed, everything up to the next complete row is one broken record (``"lines 7-12"``).
    """
    reader = _Reader(lines)
    header = reader.header()
    broken: tuple[int, int] | None = None
    while (number := reader.next_number()) is not None:
        cells = reader.row()
        if cells is not None and len(cells) == len(header):
            if broken:
                yield _broken_row(broken)
                broken = None
            yield f"line {number}", dict(zip(header, cells, strict=True))
        elif cells is None or broken:
            broken = (broken[0] if broken else number, number)
        else:
            yield f"line {number}", f"{len(cells)} columns where the header has {len(header)}"
    if broken:
        yield _broken_row(broken)


def _broken_row(lines: tuple[int, int]) -> tuple[str, str]:
    first, last = lines
    place = f"line {first}" if first == last else f"lines {first}-{last}"
    return place, "a quote is never closed, or text follows a closing one"


class _Reader:
    """Reads rows from lines; a row with line ends in its quoted fields takes several lines."""

    def __init__(self, lines: Iterator[Line]) -> None:
        self._lines = lines
        self._ahead: deque[Line] = deque()
        self._delimiter = ","
        self._cell = _cell_pattern(",")

    def header(self) -> list[str]:
        if self.next_number() is None:
            return []
        line = self._ahead[0][1]
        self._delimiter = max(_DELIMITERS, key=_QUOTED.sub("", line).count)
        self._cell = _cell_pattern(self._delimiter)
        return [cell.strip() for cell in self.row() or [line]]

    def next_number(self) -> int | None:
        """The number of the next line that is not blank."""
        while line := self._ahead[0] if self._ahead else next(self._lines, None):
            if line[1].strip():
                if not self._ahead:
                    self._ahead.append(line)
                return line[0]
            if self._ahead:
                self._ahead.popleft()
        return None

    def row(self) -> list[str] | None:
        """The cells of the row that starts at the next line; ``None`` if it is broken, of which one line is
        consumed."""
        taken = [self._ahead.popleft()]
        open_quote = taken[0][1].count('"') % 2 == 1
        while open_quote:
            line = self._ahead.popleft() if self._ahead else next(self._lines, None)
            if line is None:
                break
            taken.append(line)
            open_quote = line[1].count('"') % 2 == 0
        if not open_quote:
            cells = self._cells("\n".join(text for _, text in taken))
            if cells is not None:
                return cells
        self._ahead.extendleft(reversed(taken[1:]))
        return self._cells(taken[0][1])  # a single quote inside an unquoted field is valid

    def _cells(self, text: str) -> list[str] | None:
        cells, at = [], 0
        while match := self._cell.match(text, at):
            quoted, bare = match.groups()
            cells.append(bare if quoted is None else quoted.replace('""', '"'))
            if match.end() == len(text):
                return cells
            at = match.end() + 1
        return None


def _cell_pattern(delimiter: str) -> re.Pattern[str]:
    end = re.escape(delimiter)
    return re.compile(rf'(?:"([^"]*(?:""[^"]*)*)"|((?:[^"{end}\n][^{end}\n]*)?))(?={end}|\Z)')
