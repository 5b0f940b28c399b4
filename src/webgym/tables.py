"""Tables of text for the terminal, Markdown, LaTeX and CSV.

Cells may hold untrusted text, such as a task's domain: control characters never reach a terminal.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

import msgspec

from webgym.core.text import plain

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

DASH: Final = "–"
"""Stands for a figure that is undefined."""

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
        columns: the headers.
        rows: the cells, one per column.
        names: number of leading columns with names, aligned left; the others hold figures.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    names: int = 1

    def is_name(self, column: int) -> bool:
        """Whether this column holds names."""
        return column < self.names

    def cells(self, row: Sequence[str]) -> tuple[str, ...]:
        """A row for display: without control characters, integers with thousands separators."""
        return tuple(
            cell if self.is_name(column) or not cell.isdecimal() else f"{int(cell):,}"
            for column, cell in enumerate(map(plain, row))
        )


def show(tables: Iterable[Table], console: Console) -> None:
    """Print tables to a terminal, with an empty line after each."""
    for table in tables:
        if table.title:  # Rich would fold a title at the table's width
            console.print(plain(table.title), style="bold", highlight=False, markup=False)
        console.print(grid(table), "")


def grid(table: Table) -> RichTable:
    """A table without its title and without lines, for a terminal."""
    from rich.table import Table as RichTable
    from rich.text import Text

    rich = RichTable(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
    for index, column in enumerate(table.columns):
        rich.add_column(Text(plain(column)), justify="left" if table.is_name(index) else "right")
    for row in table.rows:
        rich.add_row(*map(Text, table.cells(row)))
    return rich


def markdown(tables: Iterable[Table]) -> str:
    """Tables for a Markdown document."""
    parts = []
    for table in tables:
        rules = ["---" if table.is_name(index) else "---:" for index in range(len(table.columns))]
        lines = [table.columns, rules, *map(table.cells, table.rows)]
        title = f"**{plain(table.title)}**"
        parts.append("\n".join([title, "", *(f"| {' | '.join(line)} |" for line in lines)]))
    return "\n\n".join(parts) + "\n"


def csv_text(tables: Iterable[Table]) -> str:
    """Tables as CSV: a line for each title, figures unformatted, and an empty line between tables."""
    parts = []
    for table in tables:
        text = io.StringIO()
        rows = [[table.title], table.columns, *(map(plain, row) for row in table.rows)]
        csv.writer(text, lineterminator="\n").writerows(rows)
        parts.append(text.getvalue())
    return "\n".join(parts)


def latex(tables: Iterable[Table]) -> str:
    """Tables as LaTeX; the document needs the package booktabs."""
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
