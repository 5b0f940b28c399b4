"""One cell of a terminal per attempt in progress: its state by color and letter, its steps as a number.

Where the numbers do not fit, a cell is one character whose height tells the steps; where not even that fits,
the last line says how many are left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Final

from rich.text import Text

from webgym.rollout.progress import Cell, State

STYLES: Final[dict[State | None, tuple[str, str]]] = {
    "opening": ("o", "yellow"),
    "acting": ("a", "green"),
    "thinking": ("t", "bright_blue"),
    "judging": ("j", "magenta"),
    None: ("·", "bright_black"),
}
"""Letter and color of a state; ``None`` is between two."""

_WIDE: Final = 4
"""Characters of a cell with a letter and a number, the gap included."""
_HEIGHTS: Final = "▁▂▃▄▅▆▇█"
_STEPS_PER_HEIGHT: Final = 4
"""So that the longest budget of training, 30 steps, fills a cell."""


def look(state: State | None) -> tuple[str, str]:
    """Letter and color of a state."""
    return STYLES.get(state, STYLES[None])


def grid(cells: Iterable[Cell], width: int, height: int) -> Text:
    """The attempts in progress, each at its place.

    Args:
        cells: the attempts.
        width: characters of a line.
        height: lines at most.

    Returns:
        At most ``height`` lines; none if there is no attempt or no room.
    """
    held = {cell.place: cell for cell in cells}
    places = max(held, default=-1) + 1
    if not places or height < 1 or width < 1:
        return Text()
    columns = max(1, (width + 1) // _WIDE)
    is_wide = width >= _WIDE and -(-places // columns) <= height
    columns = columns if is_wide else width
    fitting = columns * height
    if places > fitting:  # the last line tells the rest
        fitting -= columns
    lines = [
        _line([held.get(place) for place in range(first, min(first + columns, places))], is_wide)
        for first in range(0, min(places, fitting), columns)
    ]
    if rest := sum(place >= fitting for place in held) if places > fitting else 0:
        lines.append(Text(f"and {rest} more"[:width], style="dim"))
    return Text("\n").join(lines)


def _line(cells: list[Cell | None], is_wide: bool) -> Text:
    line = Text(no_wrap=True)
    draw = _wide if is_wide else _narrow
    for style, group in groupby(cells, lambda cell: look(cell.state)[1] if cell else ""):
        line.append("".join(map(draw, group)), style=style)
    line.rstrip()
    return line


def _wide(cell: Cell | None) -> str:
    return f"{look(cell.state)[0]}{min(cell.steps, 99):02d} " if cell else " " * _WIDE


def _narrow(cell: Cell | None) -> str:
    if cell is None:
        return " "
    return _HEIGHTS[min(cell.steps // _STEPS_PER_HEIGHT, len(_HEIGHTS) - 1)]
