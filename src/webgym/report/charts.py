"""Charts as inline SVG. Horizontal lengths are percentages, so a chart fits any width and its text keeps its
size.

Colours are variables of the style sheet: ``var(--<outcome>)`` is the colour of an outcome.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from markupsafe import Markup

from webgym.core.outcome import Outcome
from webgym.report.formatting import milliseconds, outcome_name, percent
from webgym.results.rates import Interval
from webgym.results.summary import Quantiles

_DECADES = (1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0)


def _svg(height: int, label: str, body: Markup, css: str = "") -> Markup:
    frame = Markup('<svg class="chart {}" width="100%" height="{}" role="img" aria-label="{}">{}</svg>')
    return frame.format(css, height, label, body)


def outcome_bar(outcomes: Mapping[str, int]) -> Markup:
    """A stacked horizontal bar of the outcomes."""
    total = sum(outcomes.values())
    left, parts = 0.0, Markup()
    part = Markup(
        '<rect x="{:.3f}%" width="{:.3f}%" height="28" style="fill:var(--{})">'
        "<title>{}: {} ({})</title></rect>"
    )
    for name, count in outcomes.items():
        if count:
            share = 100 * count / total
            title = (outcome_name(name), count, percent(count / total))
            parts += part.format(left, share, name, *title)
            left += share
    counts = ", ".join(f"{outcome_name(name)} {count}" for name, count in outcomes.items())
    return _svg(28, f"Outcomes: {counts}", parts, "outcome-bar")


def rate_bar(rate: float | None, interval: Interval | None) -> Markup:
    """A rate as a bar from 0 to 100 %, with its interval as an error bar."""
    parts = Markup('<rect class="track" y="5" width="100%" height="10" rx="3"/>')
    if rate is None or interval is None:
        return _svg(20, "nothing rewarded", parts)
    low, high = interval
    bar = Markup('<rect class="rate" y="5" width="{:.2f}%" height="10" rx="3"/>')
    whisker = Markup(
        '<line class="whisker" x1="{0:.2f}%" x2="{1:.2f}%" y1="10" y2="10"/>'
        '<line class="whisker" x1="{0:.2f}%" x2="{0:.2f}%" y1="6" y2="14"/>'
        '<line class="whisker" x1="{1:.2f}%" x2="{1:.2f}%" y1="6" y2="14"/>'
    )
    parts += bar.format(rate * 100) + whisker.format(low * 100, high * 100)
    return _svg(20, f"{percent(rate)}, 95% interval {percent(low)} to {percent(high)}", parts)


def _decades(values: Sequence[float]) -> tuple[float, float]:
    """The smallest range of whole decades that contains the values."""
    low = max((d for d in _DECADES if d <= min(values)), default=_DECADES[0])
    high = min((d for d in _DECADES if d >= max(values)), default=_DECADES[-1])
    return (low, high) if high > low else (low, low * 10)


class LogAxis:
    """A logarithmic axis of milliseconds over whole decades.

    Args:
        shown: all quantiles that will be drawn on it.
    """

    def __init__(self, shown: Sequence[Quantiles]) -> None:
        values = [
            value
            for quantiles in shown
            for value in (quantiles["p50"], quantiles["p95"])
            if value is not None and value > 0
        ]
        self.low, self.high = _decades(values or [1.0])

    def place(self, value: float) -> float:
        """Position of a value, percent of the width."""
        share = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        return 100 * min(1.0, share)

    def ticks(self) -> list[tuple[float, str]]:
        """Positions of the decades, percent of the width, and their labels."""
        return [(self.place(d), milliseconds(d)) for d in _DECADES if self.low <= d <= self.high]

    def span(self, quantiles: Quantiles) -> Markup:
        """A line from the median (dot) to the 95th percentile (ring)."""
        grid = Markup('<line class="grid" x1="{0:.2f}%" x2="{0:.2f}%" y1="0" y2="20"/>')
        parts = Markup().join(grid.format(place) for place, _ in self.ticks())
        p50, p95 = quantiles["p50"], quantiles["p95"]
        if p50 is None or p95 is None:
            return _svg(20, "nothing measured", parts)
        span = Markup(
            '<line class="span" x1="{0:.2f}%" x2="{1:.2f}%" y1="10" y2="10"/>'
            '<circle class="p95" cx="{1:.2f}%" cy="10" r="4"/>'
            '<circle class="p50" cx="{0:.2f}%" cy="10" r="5"/>'
        )
        parts += span.format(self.place(p50), self.place(p95))
        return _svg(20, f"median {milliseconds(p50)}, 95th percentile {milliseconds(p95)}", parts)


_COLUMNS = 48
"""Most columns of a histogram; with more lengths, a column covers several."""
_HEIGHT = 64


class Histogram:
    """Histograms of the number of steps of attempts, stacked by outcome, with a common axis.

    Args:
        counts: for each histogram, by name, number of attempts by (steps, outcome).
    """

    def __init__(self, counts: Mapping[str, Mapping[tuple[int, str], int]]) -> None:
        self._counts = counts
        self.longest = max((steps for row in counts.values() for steps, _ in row), default=0)
        self._bin = max(1, math.ceil((self.longest + 1) / _COLUMNS))
        self._columns = self.longest // self._bin + 1

    def ticks(self) -> list[tuple[float, str]]:
        """About five positions, percent of the width, and their labels (numbers of steps)."""
        raw = max(1, self.longest) / 5
        scale = 10 ** math.floor(math.log10(raw))
        every = max(1, int(next(m * scale for m in (1, 2, 5, 10) if m * scale >= raw)))
        return [
            (100 * (number // self._bin + 0.5) / self._columns, str(number))
            for number in range(0, self.longest + 1, every)
        ]

    def row(self, name: str) -> Markup:
        """The histogram with this name."""
        columns: dict[int, dict[str, int]] = {}
        for (steps, outcome), count in self._counts[name].items():
            column = columns.setdefault(steps // self._bin, {})
            column[outcome] = column.get(outcome, 0) + count
        tallest = max((sum(column.values()) for column in columns.values()), default=1)
        width = 100 / self._columns
        part = Markup(
            '<rect x="{:.3f}%" y="{:.2f}" width="{:.3f}%" height="{:.2f}" style="fill:var(--{})">'
            "<title>{} steps, {}: {}</title></rect>"
        )
        parts = Markup('<line class="base" x1="0" x2="100%" y1="{0}" y2="{0}"/>').format(_HEIGHT - 0.5)
        for number, column in sorted(columns.items()):
            top = _HEIGHT - 1.0
            lengths = (
                str(number) if self._bin == 1 else f"{number * self._bin}–{(number + 1) * self._bin - 1}"
            )
            for outcome in Outcome:
                count = column.get(outcome.value, 0)
                if count:
                    height = count / tallest * (_HEIGHT - 4)
                    top -= height
                    place = (number * width + width * 0.08, top, width * 0.84, height)
                    parts += part.format(*place, outcome.value, lengths, outcome_name(outcome), count)
        return _svg(_HEIGHT, f"Steps per attempt, {name}", parts)


def count_bar(count: int, most: int, name: str) -> Markup:
    """A number as a bar, relative to the largest number in the same table (``most``)."""
    bar = Markup('<rect class="track" y="5" width="100%" height="10" rx="3"/>')
    bar += Markup('<rect class="count" y="5" width="{:.2f}%" height="10" rx="3"/>').format(
        100 * count / max(1, most)
    )
    return _svg(20, f"{name}: {count}", bar)


def fact_columns(columns: Sequence[tuple[str, str, int]]) -> Markup:
    """A column chart of tasks by number of facts.

    Args:
        columns: label, level and number of tasks of each column.
    """
    most = max((count for _, _, count in columns), default=0) or 1
    width = 100 / max(1, len(columns))
    parts = Markup('<line class="base" x1="0" x2="100%" y1="{0}" y2="{0}"/>').format(_HEIGHT - 0.5)
    part = Markup(
        '<rect class="column {}" x="{:.3f}%" y="{:.2f}" width="{:.3f}%" height="{:.2f}">'
        "<title>{} facts: {}</title></rect>"
        '<text x="{:.3f}%" y="{}">{}</text>'
    )
    for index, (facts, level, count) in enumerate(columns):
        height = max(1.0, count / most * (_HEIGHT - 4)) if count else 0.0
        left = index * width
        box = (level, left + width * 0.1, _HEIGHT - 1 - height, width * 0.8, height)
        parts += part.format(*box, facts, count, left + width / 2, _HEIGHT + 15, facts)
    return _svg(_HEIGHT + 20, "Tasks by number of facts", parts)
