"""Tables in four forms. The names in them may be others', such as a domain of a task."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

from webgym.core.text import plain

if TYPE_CHECKING:
    from webgym.tasks.statistics import Table

Form: TypeAlias = Literal["terminal", "markdown", "csv", "json"]
FORMS: tuple[Form, ...] = get_args(Form)


def shown(tables: Sequence[Table]) -> None:
    """Print to the terminal."""
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    console = Console()
    for table in tables:
        console.print(table.title, style="bold", highlight=False)  # a title of the table's would be folded
        rich = RichTable(box=None, header_style="dim")
        for place, column in enumerate(table.columns):
            rich.add_column(column, justify="left" if place < table.names else "right")
        for row in table.rows:
            rich.add_row(*map(Text, _cells(table, row)))
        console.print(rich, "")


def as_markdown(tables: Sequence[Table]) -> str:
    """For a document."""
    parts = []
    for table in tables:
        rules = ["---" if place < table.names else "---:" for place in range(len(table.columns))]
        lines = [table.columns, rules, *(_cells(table, row) for row in table.rows)]
        parts.append("\n".join([f"**{table.title}**", "", *(f"| {' | '.join(line)} |" for line in lines)]))
    return "\n\n".join(parts) + "\n"


def as_csv(tables: Sequence[Table]) -> str:
    """One after the other, with a line for the title and an empty line between."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for place, table in enumerate(tables):
        if place:
            text.write("\n")
        writer.writerows([[table.title], table.columns, *(map(plain, row) for row in table.rows)])
    return text.getvalue()


def _cells(table: Table, row: Sequence[str]) -> tuple[str, ...]:
    return *map(plain, row[: table.names]), *map(_grouped, row[table.names :])


def _grouped(cell: str) -> str:
    return f"{int(cell):,}" if cell.isdecimal() else cell
