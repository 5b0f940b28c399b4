"""The figure of the agreement study: judges and human labels, by metric and difficulty (paper §3.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.lines import Line2D

from webgym.judge.agreement import GROUPS, METRICS, Agreement, Estimate, Metric
from webgym.judge.without_rubric import PREFIX
from webgym.plotting import CATEGORIES, MUTED, PAGE, new_figure, save, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_METRICS: Final[dict[Metric, str]] = {
    "accuracy": "Accuracy",
    "precision": "Precision",
    "recall": "Recall",
    "f1": "F1",
    "kappa": "Cohen's κ",
}
_SHORT: Final = ("Acc.", "Prec.", "Recall", "F1", "κ")
"""The same for the narrow panels."""
_MARKERS: Final = "osD^vP"
_BAND: Final = 0.72
"""Share of a metric's width that the judges take."""


def draw_agreement(found: Agreement, path: Path) -> None:
    """Draw judges by metric with their intervals, a panel for all trajectories and one for every level.

    A judge and the same judge without rubric (a name that begins with
    :data:`webgym.judge.without_rubric.PREFIX`) share a colour; without rubric the mark is hollow.

    Args:
        found: as :func:`webgym.judge.agreement.agreement` gives it.
        path: ``.png``, ``.svg`` or ``.pdf``.

    Raises:
        UsageError: the path ends in something else, or cannot be written.
    """
    groups = [group for group in GROUPS if found.cases.get(group)]
    looks = _looks(list(found.judges))
    columns = 3 if len(looks) <= 3 else 2
    legend_rows = -(-len(looks) // columns)
    with styled():
        figure = new_figure(PAGE, 1.8 + 0.16 * legend_rows + 1.6 * (len(groups) > 1))
        panels = _panels(figure, len(groups) - 1)
        lowest = _lowest(found)
        for axes, group in zip(panels, groups, strict=True):
            told = f"{found.cases[group]} trajectories, {found.successes[group]} successful"
            axes.set_title(f"{'All' if group == 'overall' else group.capitalize()}: {told}")
            metrics = [found.judges[judge][group].metrics for judge in found.judges]
            _panel(axes, metrics, list(looks.values()), lowest)
            axes.set_xticks(range(len(METRICS)), _METRICS.values() if group == "overall" else _SHORT)
        figure.legend(
            handles=[_handle(name, look) for name, look in looks.items()],
            loc="outside lower center",
            ncols=min(columns, len(looks)),
            frameon=False,
        )
        save(figure, path)


def _panels(figure: Figure, levels: int) -> list[Axes]:
    """One over the whole width; below it, one per level."""
    grid = figure.add_gridspec(1 + (levels > 0), max(1, levels))
    return [figure.add_subplot(grid[0, :]), *(figure.add_subplot(grid[1, at]) for at in range(levels))]


class _Look:
    """How a judge is drawn."""

    def __init__(self, colour: str, marker: str, *, is_hollow: bool) -> None:
        self.colour = colour
        self.marker = marker
        self.face = "white" if is_hollow else colour


def _looks(judges: Sequence[str]) -> dict[str, _Look]:
    families = list(dict.fromkeys(judge.removeprefix(PREFIX) for judge in judges))
    looks = {}
    for judge in judges:
        family = families.index(judge.removeprefix(PREFIX))
        looks[judge] = _Look(
            CATEGORIES[family % len(CATEGORIES)],
            _MARKERS[family % len(_MARKERS)],
            is_hollow=judge.startswith(PREFIX),
        )
    return looks


def _panel(
    axes: Axes, metrics: Sequence[Mapping[Metric, Estimate]], looks: Sequence[_Look], lowest: float
) -> None:
    """One group: metrics side by side, judges side by side within each."""
    offsets = (np.arange(len(looks)) - (len(looks) - 1) / 2) * (_BAND / max(len(looks), 3))
    for place, name in enumerate(METRICS):
        if place % 2:
            axes.axvspan(place - 0.5, place + 0.5, color="#f5f5f5", linewidth=0)
        for offset, look, found in zip(offsets, looks, metrics, strict=True):
            _mark(axes, place + float(offset), found[name], look)
    axes.tick_params(axis="x", length=0)
    axes.set_xlim(-0.5, len(METRICS) - 0.5)
    axes.set_ylim(lowest, 1.05)
    axes.set_yticks(np.arange(np.ceil(lowest * 5) / 5, 1.01, 0.2))
    axes.grid(visible=True, axis="y")
    if lowest < 0:
        axes.axhline(0, color=MUTED, linewidth=0.6)


def _mark(axes: Axes, place: float, estimate: Estimate, look: _Look) -> None:
    if estimate.value is None:  # undefined is said, not drawn as 0
        axes.text(place, 0.02, "n/a", rotation=90, ha="center", va="bottom", fontsize=5, color=look.colour)
        return
    if estimate.low is not None and estimate.high is not None:
        axes.vlines(place, estimate.low, estimate.high, color=look.colour, linewidth=1.1)
    axes.plot(
        place,
        estimate.value,
        marker=look.marker,
        markersize=4.2,
        color=look.colour,
        markerfacecolor=look.face,
        markeredgewidth=1.0,
    )


def _lowest(found: Agreement) -> float:
    """Where the axis begins: 0 unless kappa reaches below."""
    shown = [
        estimate.value if estimate.low is None else estimate.low
        for by_group in found.judges.values()
        for figures in by_group.values()
        for estimate in figures.metrics.values()
    ]
    lowest = min((value for value in shown if value is not None), default=0.0)
    return 0.0 if lowest >= 0 else float(np.floor(lowest * 10) / 10)


def _handle(name: str, look: _Look) -> Line2D:
    label = name
    if name.startswith(PREFIX):
        label = f"{name.removeprefix(PREFIX)}, without rubric"
    return Line2D(
        [], [], color=look.colour, marker=look.marker, markersize=4.2, markerfacecolor=look.face, label=label
    )
