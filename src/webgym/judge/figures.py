"""The figure of the agreement study: judges and human labels, by metric and difficulty (paper §3.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.lines import Line2D

from webgym.core.plotting import CATEGORIES, MUTED, PAGE, new_figure, save, styled
from webgym.judge.agreement import GROUPS, METRICS, Agreement, Estimate, Metric
from webgym.judge.without_rubric import PREFIX

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
"""Short names of the metrics, for the narrow panels."""
_MARKERS: Final = "osD^vP"
_BAND: Final = 0.72
"""Fraction of a metric's width that the judges' markers are spread over."""


def draw_agreement(result: Agreement, path: Path) -> None:
    """Draw each judge's metrics with their intervals: a panel for all trajectories, and one for every level.

    A judge and the same judge without rubric (a name that begins with
    :data:`webgym.judge.without_rubric.PREFIX`) share a colour; without rubric the marker is hollow.

    Args:
        result: the result of :func:`webgym.judge.agreement.agreement`.
        path: the file to write, ``.png``, ``.svg`` or ``.pdf``.

    Raises:
        UsageError: the path has another suffix, or cannot be written.
    """
    groups = [group for group in GROUPS if result.cases.get(group)]
    styles = _styles(list(result.judges))
    columns = 3 if len(styles) <= 3 else 2
    legend_rows = -(-len(styles) // columns)
    with styled():
        figure = new_figure(PAGE, 1.8 + 0.16 * legend_rows + 1.6 * (len(groups) > 1))
        panels = _panels(figure, len(groups) - 1)
        lowest = _lowest(result)
        for axes, group in zip(panels, groups, strict=True):
            name = "All" if group == "overall" else group.capitalize()
            counts = f"{result.cases[group]} trajectories, {result.successes[group]} successful"
            axes.set_title(f"{name}: {counts}")
            metrics = [result.judges[judge][group].metrics for judge in result.judges]
            _panel(axes, metrics, list(styles.values()), lowest)
            axes.set_xticks(range(len(METRICS)), _METRICS.values() if group == "overall" else _SHORT)
        figure.legend(
            handles=[_handle(name, style) for name, style in styles.items()],
            loc="outside lower center",
            ncols=min(columns, len(styles)),
            frameon=False,
        )
        save(figure, path)


def _panels(figure: Figure, levels: int) -> list[Axes]:
    """Axes of the whole width, and below them one per level."""
    grid = figure.add_gridspec(1 + (levels > 0), max(1, levels))
    return [figure.add_subplot(grid[0, :]), *(figure.add_subplot(grid[1, at]) for at in range(levels))]


class _Style:
    """Colour and marker of a judge."""

    def __init__(self, colour: str, marker: str, *, is_hollow: bool) -> None:
        self.colour = colour
        self.marker = marker
        self.face = "white" if is_hollow else colour


def _styles(judges: Sequence[str]) -> dict[str, _Style]:
    families = list(dict.fromkeys(judge.removeprefix(PREFIX) for judge in judges))
    styles = {}
    for judge in judges:
        family = families.index(judge.removeprefix(PREFIX))
        styles[judge] = _Style(
            CATEGORIES[family % len(CATEGORIES)],
            _MARKERS[family % len(_MARKERS)],
            is_hollow=judge.startswith(PREFIX),
        )
    return styles


def _panel(
    axes: Axes, metrics: Sequence[Mapping[Metric, Estimate]], styles: Sequence[_Style], lowest: float
) -> None:
    """Draw one group: metrics side by side, judges side by side within each."""
    offsets = (np.arange(len(styles)) - (len(styles) - 1) / 2) * (_BAND / max(len(styles), 3))
    for position, name in enumerate(METRICS):
        if position % 2:
            axes.axvspan(position - 0.5, position + 0.5, color="#f5f5f5", linewidth=0)
        for offset, style, estimates in zip(offsets, styles, metrics, strict=True):
            _mark(axes, position + float(offset), estimates[name], style)
    axes.tick_params(axis="x", length=0)
    axes.set_xlim(-0.5, len(METRICS) - 0.5)
    axes.set_ylim(lowest, 1.05)
    axes.set_yticks(np.arange(np.ceil(lowest * 5) / 5, 1.01, 0.2))
    axes.grid(visible=True, axis="y")
    if lowest < 0:
        axes.axhline(0, color=MUTED, linewidth=0.6)


def _mark(axes: Axes, position: float, estimate: Estimate, style: _Style) -> None:
    if estimate.value is None:  # an undefined value is labelled, not drawn as 0
        axes.text(
            position, 0.02, "n/a", rotation=90, ha="center", va="bottom", fontsize=5, color=style.colour
        )
        return
    if estimate.low is not None and estimate.high is not None:
        axes.vlines(position, estimate.low, estimate.high, color=style.colour, linewidth=1.1)
    axes.plot(
        position,
        estimate.value,
        marker=style.marker,
        markersize=4.2,
        color=style.colour,
        markerfacecolor=style.face,
        markeredgewidth=1.0,
    )


def _lowest(result: Agreement) -> float:
    """Lower limit of the y axis: 0 unless kappa is negative."""
    values = [
        estimate.value if estimate.low is None else estimate.low
        for by_group in result.judges.values()
        for figures in by_group.values()
        for estimate in figures.metrics.values()
    ]
    lowest = min((value for value in values if value is not None), default=0.0)
    return 0.0 if lowest >= 0 else float(np.floor(lowest * 10) / 10)


def _handle(name: str, style: _Style) -> Line2D:
    label = name
    if name.startswith(PREFIX):
        label = f"{name.removeprefix(PREFIX)}, without rubric"
    return Line2D(
        [],
        [],
        color=style.colour,
        marker=style.marker,
        markersize=4.2,
        markerfacecolor=style.face,
        label=label,
    )
