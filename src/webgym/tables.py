"""Figures as tables: in a terminal, and in Markdown for a document."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from webgym.core.text import plain


class Table(msgspec.Struct, frozen=True):
    """A table of text; the first column is a name, the others are figures."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


def show(tables: Iterable[Table], console: Console) -> None:
    """Print tables to a terminal."""
    for table in tables:
        rich = RichTable(title=Text(plain(table.title)), title_justify="left", title_style="bold")
        for index, column in enumerate(table.columns):
            rich.add_column(column, justify="right" if index else "left")
        for row in table.rows:
            rich.add_row(*(Text(plain(cell)) for cell in row))
        console.print(rich)


def markdown(tables: Iterable[Table]) -> str:
    """The same for a document."""
    parts = []
    for table in tables:
        rules = ["---", *("---:" for _ in table.columns[1:])]
        lines = [table.columns, tuple(rules), *(tuple(map(plain, row)) for row in table.rows)]
        title = f"**{plain(table.title)}**"
        parts.append("\n".join([title, "", *(f"| {' | '.join(line)} |" for line in lines)]))
    return "\n\n".join(parts) + "\n"
