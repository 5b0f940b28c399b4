"""Tables for a paper: LaTeX with booktabs beside the Markdown of :mod:`webgym.tables`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from webgym.tables import Table

DASH: Final = "–"
"""What stands for a figure that is undefined."""

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


def latex(tables: Iterable[Table]) -> str:
    """The tables as LaTeX; they need the package booktabs."""
    return "\n\n".join(map(_latex, tables)) + "\n"


def _latex(table: Table) -> str:
    def line(cells: Iterable[str]) -> str:
        return "    " + " & ".join(map(_escaped, cells)) + r" \\"

    return "\n".join(
        (
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{_escaped(table.title)}}}",
            rf"  \begin{{tabular}}{{l{'r' * (len(table.columns) - 1)}}}",
            r"    \toprule",
            line(table.columns),
            r"    \midrule",
            *map(line, table.rows),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
        )
    )


def _escaped(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)
