"""Draws the figures of a task set (SYSTEM.md 1.6) as PNG and SVG, of a column's width; reproducible."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from webgym.core.plotting import CATEGORIES, COLUMN, INK, MUTED, new_figure, save, styled
from webgym.core.task import LEVELS, Level, level_of
from webgym.taskset.statistics import DomainRow, Part, Statistics, kernel_density

_LAST_BAR: Final = 12
"""Difficulties from this one on share a bar."""

_LEVELS: Final[dict[Level, str]] = {"easy": "#9ecae1", "medium": "#4292c6", "hard": "#08458f"}
"""One hue from light to dark, because levels are ordered; distinguishable in greyscale, too."""
_PARTS: Final[dict[Part, str]] = {
    "train": "Training",
    "test": "Test",
    "decomposed": "Decomposed",
    "unsplit": "Not split",
}

_THOUSANDS: Final = FuncFormatter(lambda value, _: f"{value:,.0f}")


def draw_figures(statistics: Statistics, folder: Path) -> list[Path]:
    """Draw all figures for which there are data, into a folder that is created if necessary.

    ``websites`` (tasks per website, sorted), ``difficulty`` (histograms by part), ``domains`` (tasks by
    subdomain) and, if the statistics have lengths, ``lengths`` (steps per trajectory by level).

    Returns:
        The files written, a ``.png`` and a ``.svg`` of each.
    """
    folder.mkdir(parents=True, exist_ok=True)
    painters: dict[str, Callable[[Statistics], Figure]] = {}
    if statistics.tasks:
        painters |= {"websites": _websites, "difficulty": _difficulty, "domains": _domains}
    if statistics.lengths:
        painters["lengths"] = _lengths
    written = []
    with styled():
        for name, paint in painters.items():
            figure = paint(statistics)
            for suffix in (".png", ".svg"):
                path = folder / f"{name}{suffix}"
                save(figure, path)
                written.append(path)
    return written


def _figure(height: float) -> Figure:
    return new_figure(COLUMN, height)


def _tasks(count: int) -> str:
    return "1 task" if count == 1 else f"{count:,} tasks"


def _websites(statistics: Statistics) -> Figure:
    sizes = [size for size, _ in statistics.sizes]
    edges = 1 + np.cumsum(
        [0, *(count for _, count in statistics.sizes)]
    )  # the website of rank r is from r to r + 1
    top, most = len(statistics.top), sizes[0]
    figure = _figure(2.1)
    axes = figure.add_subplot()
    axes.fill_between(
        np.arange(1, top + 2),
        [*(count for _, count in statistics.top), statistics.top[-1][1]],
        0.7,
        step="post",
        color=CATEGORIES[1],
        alpha=0.35,
        linewidth=0,
    )
    axes.stairs(sizes, edges, baseline=None, color=CATEGORIES[0], linewidth=1.4)
    axes.set(xscale="log", yscale="log", xlabel="Websites, by number of tasks", ylabel="Tasks")
    axes.set(xlim=(1, edges[-1]), ylim=(0.7, most * 3.0))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(_THOUSANDS)
        axis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, axis="y")
    if statistics.websites > top:
        axes.axvline(top + 1, color=MUTED, linewidth=0.6, linestyle=(0, (3, 2)))
    axes.annotate(
        f"top {top}: {statistics.top_share:.0%} of {_tasks(statistics.tasks)}",
        (top + 1, most),
        xytext=(5, 4),
        textcoords="offset points",
        va="bottom",
    )
    return figure


def _difficulty(statistics: Statistics) -> Figure:
    parts = list(statistics.difficulties)
    figure = _figure(0.75 + 0.95 * len(parts))
    figure.legend(
        handles=[Patch(color=colour, label=level) for level, colour in _LEVELS.items()],
        loc="outside upper right",
        ncols=len(_LEVELS),
        frameon=False,
        handlelength=0.8,
        handleheight=0.8,
        handletextpad=0.4,
        columnspacing=1.2,
    )
    rows = figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
    largest = max(max(counts) for counts in statistics.difficulties.values())
    last = min(largest, _LAST_BAR)
    for axes, part in zip(rows, parts, strict=True):
        counts = statistics.difficulties[part]
        total = sum(counts.values())
        shares = [
            100
            * sum(n for facts, n in counts.items() if facts == bar or (bar == last and facts > last))
            / total
            for bar in range(1, last + 1)
        ]
        colours = [_LEVELS[level_of(bar)] for bar in range(1, last + 1)]
        axes.bar(range(1, last + 1), shares, width=0.82, color=colours)
        axes.set_title(f"{_PARTS[part]}: {_tasks(total)}")
        axes.set_ylabel("Tasks, %")
        axes.set_ylim(0, max(shares) * 1.12)
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        axes.grid(visible=True, axis="y")
        shares_of_levels = (f"{count / total:.0%}" for count in statistics.levels(part).values())
        axes.set_title(" / ".join(shares_of_levels), loc="right")
    labels = [str(bar) for bar in range(1, last + 1)]
    labels[-1] += "+" if largest > last else ""
    rows[-1].set_xticks(range(1, last + 1), labels)
    rows[-1].set_xlabel("Difficulty: number of facts")
    return figure


def _domains(statistics: Statistics) -> Figure:
    by_domain: dict[str, list[DomainRow]] = {}
    for row in statistics.domains:
        if row.tasks:
            by_domain.setdefault(row.domain, []).append(row)
    order = sorted(by_domain, key=lambda domain: (-sum(row.tasks for row in by_domain[domain]), domain))
    bars = sum(len(rows) for rows in by_domain.values())
    figure = _figure(0.5 + 0.145 * bars + 0.2 * len(order))
    axes = figure.add_subplot()
    y, ticks, labels = 0.0, [], []
    most = max(row.tasks for rows in by_domain.values() for row in rows)
    for number, domain in enumerate(order):
        rows = sorted(by_domain[domain], key=lambda row: (-row.tasks, row.subdomain))
        share = sum(row.tasks for row in rows) / statistics.tasks
        axes.text(0, y, f" {domain or 'No domain'}, {share:.1%}", va="center", weight="bold", fontsize=6.5)
        colour = CATEGORIES[number % len(CATEGORIES)]
        for row in rows:
            y += 1
            axes.barh(y, row.tasks, height=0.78, color=colour)
            axes.text(row.tasks + most * 0.012, y, f"{row.tasks:,}", va="center", fontsize=6)
            ticks.append(y)
            labels.append(row.subdomain or "no subdomain")
        y += 1.35
    axes.set_yticks(ticks, labels)
    axes.tick_params(axis="y", length=0)
    axes.set(ylim=(y - 0.5, -0.8), xlim=(0, most * 1.17), xlabel="Tasks")
    axes.xaxis.set_major_formatter(_THOUSANDS)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.grid(visible=True, axis="x")
    axes.spines["left"].set_visible(False)
    return figure


def _lengths(statistics: Statistics) -> Figure:
    figure = _figure(2.3)
    axes = figure.add_subplot()
    levels = [level for level in LEVELS if level in statistics.lengths]
    for x, level in enumerate(levels):
        lengths = statistics.lengths[level]
        grid, density = kernel_density(lengths.counts)
        half = 0.4 * density / density.max()
        axes.fill_betweenx(grid, x - half, x + half, color=_LEVELS[level], linewidth=0)
        first = x == 0
        axes.scatter(
            x, lengths.mean, marker="D", s=18, color="white", edgecolor=INK, linewidth=0.8, zorder=3,
            label="mean" if first else None,
        )  # fmt: skip
        axes.scatter(x, lengths.mode, marker="o", s=16, color=INK, zorder=3, label="mode" if first else None)
        marks = [lengths.mean, lengths.mode]
        if abs(lengths.mean - lengths.mode) < 0.05 * grid.max():
            marks.pop()  # the two numbers would overlap
        for mark in marks:
            axes.annotate(
                f"{mark:.1f}",
                (x, mark),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                fontsize=6,
                bbox={"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
            )
    axes.set_xticks(
        range(len(levels)),
        [f"{level}\n{statistics.lengths[level].trajectories:,} trajectories" for level in levels],
    )
    axes.set(xlim=(-0.6, len(levels) - 0.4), ylabel="Steps per trajectory")
    axes.set_ylim(bottom=0)
    axes.tick_params(axis="x", length=0)
    axes.grid(visible=True, axis="y")
    axes.legend(loc="upper left", frameon=False, handletextpad=0.1)
    return figure
