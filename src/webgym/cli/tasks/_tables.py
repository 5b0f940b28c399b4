"""Tables in four forms."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

if TYPE_CHECKING:
    from webgym.tasks.statistics import Table

Form: TypeAlias = Literal["terminal", "markdown", "csv", "json"]
FORMS: tuple[Form, ...] = get_args(Form)


def shown(tables: Sequence[Table]) -> None:
    """Print to the terminal."""
    from rich.console import Console
    from rich.table import Table as RichTable

    console = Console()
    for table in tables:
        console.print(table.title, style="bold", highlight=False)  # a title of the table's would be folded
        rich = RichTable(box=None, header_style="dim")
        for place, column in enumerate(table.columns):
            rich.add_column(column, justify="left" if place < table.names else "right")
        for row in table.rows:
            rich.add_row(*row[: table.names], *map(_grouped, row[table.names :]))
        console.print(rich, "")


def as_markdown(tables: Sequence[Table]) -> str:
    """For a document."""
    parts = []
    for table in tables:
        rules = ["---" if place < table.names else "---:" for place in range(len(table.columns))]
        rows = [(*row[: table.names], *map(_grouped, row[table.names :])) for row in table.rows]
        lines = [table.columns, rules, *rows]
        parts.append("\n".join([f"**{table.title}**", "", *(f"| {' | '.join(line)} |" for line in lines)]))
    return "\n\n".join(parts) + "\n"


def as_csv(tables: Sequence[Table]) -> str:
    """One after the other, with a line for the title and an empty line between."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for place, table in enumerate(tables):
        if place:
            text.write("\n")
        writer.writerows([[table.title], table.columns, *table.rows])
    return text.getvalue()


def _grouped(cell: str) -> str:
    return f"{int(cell):,}" if cell.isdecimal() else cell
