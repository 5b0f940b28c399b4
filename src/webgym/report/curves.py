"""Curves of a training, as inline SVG and HTML.

Lines are drawn in a coordinate system of 100 by 100 that is stretched to the available width, without
stretching strokes and text. Colours are variables of the style sheet, ``--line-<name>``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from markupsafe import Markup

from webgym.results.rates import Interval

_TICKS = 5

_GRID = Markup('<line class="grid" x1="0" x2="100%" y1="{0:.2f}%" y2="{0:.2f}%"/>')
_LINE = Markup('<polyline class="curve-line" points="{}" style="stroke:{}"/>')
_STRETCHED = Markup(
    '<svg viewBox="0 0 100 100" preserveAspectRatio="none" width="100%" height="100%">{}</svg>'
)
_PLOT = Markup('<svg class="chart curve-plot" width="100%" height="180" role="img" aria-label="{}">{}</svg>')
_WHISKER = Markup(
    '<line class="curve-whisker" x1="{0:.2f}%" x2="{0:.2f}%" y1="{1:.2f}%" y2="{2:.2f}%" style="stroke:{3}"/>'
)
_DOT = Markup(
    '<circle class="curve-dot{}" cx="{:.2f}%" cy="{:.2f}%" r="{}" style="fill:{}"><title>{}</title></circle>'
)
_SHIFTED = Markup('<g transform="translate({:.1f} 0)">{}</g>')
_PHASE = Markup(
    '<rect x="{:.3f}%" width="{:.3f}%" height="14" style="fill:var(--phase-{})">'
    "<title>{}: {}, {}</title></rect>"
)
_PHASES = Markup(
    '<tr><th scope="row">{}</th><td class="plot"><svg class="chart" width="100%" height="14">{}</svg></td>'
    '<td class="number muted">{}</td></tr>'
)


class Point(NamedTuple):
    """A measurement.

    Attributes:
        x: number of trajectories collected, or an iteration.
        y: the value.
        interval: its 95 % interval, if it is a rate.
    """

    x: float
    y: float
    interval: Interval | None = None


class Line(NamedTuple):
    """A curve.

    Attributes:
        name: in the legend; in lower case, with dashes for spaces, also the name of the colour.
        points: the measurements.
        smoothing: weight of the newest point in the moving average that is drawn; 1 means no smoothing.
    """

    name: str
    points: Sequence[Point]
    smoothing: float = 1.0

    @property
    def smooth(self) -> list[Point]:
        """The exponential moving average: ``e[0] = y[0]``, ``e[n] = s y[n] + (1 - s) e[n - 1]``."""
        averages: list[Point] = []
        for point in self.points:
            before = averages[-1].y if averages else point.y
            y = self.smoothing * point.y + (1 - self.smoothing) * before
            averages.append(Point(point.x, y))
        return averages

    @property
    def colour(self) -> str:
        """Its colour, as a CSS value."""
        return f"var(--line-{self.name.lower().replace(' ', '-')}, var(--accent))"


def nice_ticks(low: float, high: float) -> list[float]:
    """About five evenly spaced round numbers that cover the range from ``low`` to ``high``."""
    if high <= low:
        high = low + 1
    raw = (high - low) / _TICKS
    scale = 10 ** math.floor(math.log10(raw))
    step = next(m * scale for m in (1, 2, 2.5, 5, 10) if m * scale >= raw * (1 - 1e-9))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [round(number * step, 10) for number in range(first, last + 1)]


class Curves:
    """A line chart.

    Args:
        label: text alternative of the chart.
        lines: in the order of the legend; those without points are left out.
        write: formats a value.
        whole: limit the ticks to at most 1, for rates.
    """

    def __init__(
        self, label: str, lines: Sequence[Line], write: Callable[[float], str], *, whole: bool = False
    ) -> None:
        self.label = label
        self.lines = [line for line in lines if line.points]
        self.write = write
        points = [point for line in self.lines for point in line.points]
        tops = [point.interval[1] if point.interval else point.y for point in points]
        self._y = nice_ticks(0.0, max(tops, default=1.0))
        if whole:
            self._y = [tick for tick in self._y if tick <= 1.0]
        self._x = [point.x for point in points]

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to show."""
        return not self.lines

    @property
    def x_ticks(self) -> list[tuple[float, str]]:
        """Positions of the ticks from the left, percent of the width, and their labels."""
        low, high = self._span
        inside = [tick for tick in nice_ticks(low, high) if low <= tick <= high]
        return [(self._place_x(tick), f"{tick:,.0f}") for tick in inside if tick == int(tick)]

    @property
    def y_ticks(self) -> list[tuple[float, str]]:
        """Positions of the ticks from the top, percent of the height, and their labels."""
        return [(self._place_y(tick), self.write(tick)) for tick in self._y]

    @property
    def _span(self) -> tuple[float, float]:
        low, high = min(self._x), max(self._x)
        return (low, high) if high > low else (low - 1, high + 1)

    def _place_x(self, x: float) -> float:
        low, high = self._span
        return 100 * (x - low) / (high - low)

    def _place_y(self, y: float) -> float:
        return 100 - 100 * (y - self._y[0]) / (self._y[-1] - self._y[0])

    def svg(self) -> Markup:
        """The chart as SVG."""
        parts = Markup().join(_GRID.format(place) for place, _ in self.y_ticks)
        lines = Markup()
        for line in self.lines:
            path = " ".join(f"{self._place_x(p.x):.3f},{self._place_y(p.y):.3f}" for p in line.smooth)
            lines += _LINE.format(path, line.colour)
        parts += _STRETCHED.format(lines)
        for number, line in enumerate(self.lines):
            shift = 4.0 * (number - (len(self.lines) - 1) / 2)  # so that intervals do not overlap
            for point in line.points:
                parts += self._dot(line, point, shift if point.interval else 0.0)
        last = "; ".join(f"{line.name} {self.write(line.smooth[-1].y)}" for line in self.lines)
        return _PLOT.format(f"{self.label}, last: {last}", parts)

    def _dot(self, line: Line, point: Point, shift: float) -> Markup:
        x, y, parts, interval_text = self._place_x(point.x), self._place_y(point.y), Markup(), ""
        if point.interval is not None:
            low, high = point.interval
            interval_text = f" ({self.write(low)} to {self.write(high)})"
            parts += _WHISKER.format(x, self._place_y(high), self._place_y(low), line.colour)
        title = f"{line.name}, {point.x:,.0f}: {self.write(point.y)}{interval_text}"
        is_drawn = line.smoothing == 1.0  # otherwise its moving average is drawn
        parts += _DOT.format("" if is_drawn else " faint", x, y, 3.5 if is_drawn else 2.5, line.colour, title)
        return _SHIFTED.format(shift, parts)


def phase_bars(rows: Sequence[tuple[str, dict[str, float]]], write: Callable[[float], str]) -> Markup:
    """Rows of a table with a stacked bar each, all in the scale of the longest.

    Args:
        rows: name, and values by name of the part.
        write: formats a value.
    """
    longest = max((sum(parts.values()) for _, parts in rows), default=0.0) or 1.0
    table_rows = Markup()
    for name, parts in rows:
        left, bar = 0.0, Markup()
        for phase, value in parts.items():
            width = 100 * value / longest
            bar += _PHASE.format(left, width, phase, name, phase, write(value))
            left += width
        table_rows += _PHASES.format(name, bar, write(sum(parts.values())))
    return table_rows
