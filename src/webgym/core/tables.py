"""Tables of text for a terminal, and as Markdown, LaTeX and CSV.

Cells may contain foreign text, such as the domain of a task: control characters are replaced.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final, Literal

import msgspec

from webgym.core.text import plain

if TYPE_CHECKING:
    from rich.console import Console

DASH: Final = "–"
"""The cell of an undefined value."""

_GAP: Final = 2
"""Spaces between columns, where there is room."""

_WHOLE: Final = 12
"""Longest cell that does not wrap."""

_LATEX: Final = {
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "κ": r"$\kappa$",
    "–": "--",
    "−": "$-$",
    "…": r"\dots{}",
}


class Table(msgspec.Struct, frozen=True):
    """A table of text.

    Attributes:
        title: a line above the table; empty for none.
        columns: the headers of the columns.
        rows: tuples of a cell per column.
        names: the number of leading columns with names, which are aligned left; the others contain numbers.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    names: int = 1

    def is_name(self, column: int) -> bool:
        """Whether the column at this index contains names."""
        return column < self.names

    def cells(self, row: Sequence[str]) -> tuple[str, ...]:
        """A row as it is printed: without control characters, integers with thousands separators."""
        return tuple(
            cell if self.is_name(column) or not cell.isdecimal() else f"{int(cell):,}"
            for column, cell in enumerate(map(plain, row))
        )


def show(parts: Iterable[Table | str], console: Console) -> None:
    """Print tables and lines to a terminal; an empty line follows a table with a title."""
    for part in parts:
        if isinstance(part, str):
            console.print(part, highlight=False, markup=False, soft_wrap=True)
            continue
        if part.title:  # a title of Rich would be wrapped at the table's width
            console.print(plain(part.title), style="bold", highlight=False, markup=False, soft_wrap=True)
        put(part, console)
        if part.title:
            console.print()


def printed(parts: Iterable[Table | str]) -> str:
    """Tables and lines as :func:`show` prints them into a pipe: the text of a result that has tables."""
    from rich.console import Console

    file = io.StringIO()
    show(parts, Console(file=file, force_terminal=False, color_system=None))
    return file.getvalue().rstrip("\n")


def put(table: Table, console: Console) -> None:
    """Print a table, without title and borders.

    Headings and cells wrap between words where a terminal is too narrow; no word is cut, so that a table may
    be wider. Elsewhere, such as in a pipe, nothing wraps.
    """
    from rich.cells import cell_len
    from rich.table import Table as RichTable
    from rich.text import Text

    headings, rows = [plain(column) for column in table.columns], [table.cells(row) for row in table.rows]
    columns = list(zip(headings, *rows, strict=True))
    widths = longest = [max(map(cell_len, column)) for column in columns]
    least = [
        max((cell_len(part) for cell in (*heading.split(), *cells) for part in _parts(cell)), default=0)
        for heading, *cells in columns
    ]
    gap, cap = _GAP, max(longest)
    if console.is_terminal:
        gap = _GAP if sum(least) + _GAP * (len(columns) - 1) <= console.width else 1
        while cap and sum(widths) + gap * (len(columns) - 1) > console.width:
            cap -= 1
            widths = [max(low, min(high, cap)) for low, high in zip(least, longest, strict=True)]
    whole = sum(widths) + gap * (len(columns) - 1)
    rich = RichTable(box=None, header_style="dim", pad_edge=False, padding=(0, gap, 0, 0), width=whole)
    for index, (heading, width) in enumerate(zip(headings, widths, strict=True)):
        justify: Literal["left", "right"] = "left" if table.is_name(index) else "right"
        rich.add_column(Text(heading), justify=justify, width=width)
    for row in rows:
        rich.add_row(*map(Text, row))
    console.print(rich, crop=False)


def _parts(cell: str) -> list[str]:
    """What of a cell stays on one line."""
    return [cell] if len(cell) <= _WHOLE else cell.split()


def markdown(tables: Iterable[Table]) -> str:
    """Tables as Markdown."""
    parts = []
    for table in tables:
        rules = ["---" if table.is_name(index) else "---:" for index in range(len(table.columns))]
        lines = [table.columns, rules, *map(table.cells, table.rows)]
        title = f"**{plain(table.title)}**"
        parts.append("\n".join([title, "", *(f"| {' | '.join(line)} |" for line in lines)]))
    return "\n\n".join(parts) + "\n"


def csv_text(tables: Iterable[Table]) -> str:
    """Tables as CSV: a line for the title, headers, rows; an empty line between tables.

    Integers have no thousands separators.
    """
    parts = []
    for table in tables:
        text = io.StringIO()
        rows = [[table.title], table.columns, *(map(plain, row) for row in table.rows)]
        csv.writer(text, lineterminator="\n").writerows(rows)
        parts.append(text.getvalue())
    return "\n".join(parts)


def latex(tables: Iterable[Table]) -> str:
    """Tables as LaTeX, which needs the package booktabs."""
    return "\n\n".join(map(_latex, tables)) + "\n"


def _latex(table: Table) -> str:
    def line(cells: Iterable[str]) -> str:
        return "    " + " & ".join(map(_escaped, cells)) + r" \\"

    return "\n".join(
        (
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{_escaped(table.title)}}}",
            rf"  \begin{{tabular}}{{{'l' * table.names}{'r' * (len(table.columns) - table.names)}}}",
            r"    \toprule",
            line(table.columns),
            r"    \midrule",
            *(line(table.cells(row)) for row in table.rows),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
        )
    )


def _escaped(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)
