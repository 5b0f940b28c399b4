"""A grid of attempts in progress for the terminal: their state as color and letter, their steps as a number.

If the numbers do not fit, a cell is one character whose height shows the steps; if not even that fits, the
last line says how many attempts are left out.
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
"""Letter and color of a state; ``None`` is between two states."""

_WIDE: Final = 4
"""Width of a cell with a letter and a number, including the gap, characters."""
_HEIGHTS: Final = "▁▂▃▄▅▆▇█"
_STEPS_PER_HEIGHT: Final = 4
"""Steps per level of a cell's height: the longest budget in training, 30 steps, fills a cell."""


def style_of(state: State | None) -> tuple[str, str]:
    """Letter and color of a state."""
    return STYLES.get(state, STYLES[None])


def grid(cells: Iterable[Cell], width: int, height: int) -> Text:
    """The grid of attempts in progress, each at its place.

    Args:
        cells: the attempts.
        width: width of a line, characters.
        height: most lines.

    Returns:
        At most ``height`` lines; empty if there is no attempt or no space.
    """
    by_place = {cell.place: cell for cell in cells}
    places = max(by_place, default=-1) + 1
    if not places or height < 1 or width < 1:
        return Text()
    columns = max(1, (width + 1) // _WIDE)
    is_wide = width >= _WIDE and -(-places // columns) <= height
    columns = columns if is_wide else width
    fitting = columns * height
    if places > fitting:  # the last line is for the number of the others
        fitting -= columns
    lines = [
        _line([by_place.get(place) for place in range(first, min(first + columns, places))], is_wide)
        for first in range(0, min(places, fitting), columns)
    ]
    if others := sum(place >= fitting for place in by_place) if places > fitting else 0:
        lines.append(Text(f"and {others} more"[:width], style="dim"))
    return Text("\n").join(lines)


def _line(cells: list[Cell | None], is_wide: bool) -> Text:
    line = Text(no_wrap=True)
    draw = _wide if is_wide else _narrow
    for style, group in groupby(cells, lambda cell: style_of(cell.state)[1] if cell else ""):
        line.append("".join(map(draw, group)), style=style)
    line.rstrip()
    return line


def _wide(cell: Cell | None) -> str:
    return f"{style_of(cell.state)[0]}{min(cell.steps, 99):02d} " if cell else " " * _WIDE


def _narrow(cell: Cell | None) -> str:
    if cell is None:
        return " "
    return _HEIGHTS[min(cell.steps // _STEPS_PER_HEIGHT, len(_HEIGHTS) - 1)]
