"""``report.html`` of a training: success over time, training data, tasks before and after.

It reads ``metrics.jsonl`` and the run folders of the evaluations, and does not import ``webgym.train``.
"""

from __future__ import annotations

import json
import math
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import msgspec
import yaml
from markupsafe import Markup

from webgym.core.errors import RunFolderError
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS
from webgym.report import formatting
from webgym.report.config import ReportConfig
from webgym.report.content import page
from webgym.report.template import Document, Page, outcome_words
from webgym.report.thumbnails import thumbnails
from webgym.report.write import ReportProgress, write_parts
from webgym.results.rates import Interval
from webgym.store.files import CONFIG, EVALUATIONS, METRICS, REPORT, disk_errors, refuse_special_files
from webgym.store.records import Entry
from webgym.store.runs import RunReader

_SCRIPTS: Final = ("dom.js", "theme.js", "stage.js", "training.js")
_SMOOTHING: Final = 0.5
"""Weight of the newest value in the moving average (SYSTEM.md 5.1: EMA 0.5)."""
_GROUPS: Final = ("overall", *LEVELS)
_RULES: Final = {
    "unrewarded": "attempts without a reward",
    "left_out": "attempts without an advantage",
    "unreadable": "replies without an action",
    "unchanged": "steps that changed nothing",
    "used_up": "steps used up",
    "stale": "steps of stale weights",
}
"""Labels of the counts of the replay."""


def _figure(row: Mapping[str, Any], path: str) -> float | None:
    """A figure in a row of the metrics by its path; ``None`` if it has none."""
    value: Any = row
    for key in path.split("/"):
        value = value.get(key) if value else None
    return None if value is None else float(value)


class _Chart(msgspec.Struct, frozen=True):
    """A chart of figures of the metrics, over the number of trajectories collected, in
    ``training_charts.toml``."""

    axis: str
    lines: dict[str, str]
    write: Literal["number", "percent"] | None = None
    whole: bool = False


_CHARTS: Final = msgspec.toml.decode(
    files("webgym.report").joinpath("training_charts.toml").read_bytes(), type=dict[str, _Chart]
)


class Pair(NamedTuple):
    """The same sample of a task in two evaluations."""

    before: Entry
    after: Entry

    @property
    def rank(self) -> int:
        """Order of display: newly solved, no longer solved, solved both times, solved neither time."""
        won = (self.before.outcome is Outcome.SUCCESS, self.after.outcome is Outcome.SUCCESS)
        return [(False, True), (True, False), (True, True), (False, False)].index(won)


class Training:
    """The contents of a training folder; the training may still be going on.

    Raises:
        RunFolderError: it is not a training, or its figures cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        refuse_special_files(path, path / EVALUATIONS)
        try:
            with disk_errors(f"reading {path}"):
                self.config: dict[str, Any] = yaml.safe_load((path / CONFIG).read_text())
                lines = (path / METRICS).read_bytes().splitlines() if (path / METRICS).exists() else []
                self.rows: list[dict[str, Any]] = [json.loads(line) for line in lines]
                self.evaluations: dict[int, dict[str, Any]] = {
                    int(file.stem): json.loads(file.read_bytes())
                    for file in sorted(path.glob(f"{EVALUATIONS}/*.json"))
                }
        except (ValueError, yaml.YAMLError) as error:
            raise RunFolderError(f"{path} cannot be read: {' '.join(str(error).split())}") from error

    # --- curves ---------------------------------------------------------------------------------------------

    def _line(self, name: str, path: str, smoothing: float = 1.0, number: int = 0) -> Line:
        """A figure of every iteration, over the number of trajectories collected until its end."""
        pairs = ((row["trajectories"], _figure(row, path)) for row in self.rows)
        return Line(name, [Point(x, y) for x, y in pairs if y is not None], smoothing, number)

    def _tested(self) -> list[Line]:
        """Success rates of the evaluations, over the number of trajectories collected before each."""
        collected = {0: 0} | {row["iteration"]: row["trajectories"] for row in self.rows}
        points: dict[str, list[Point]] = {group: [] for group in _GROUPS}
        for number, metrics in self.evaluations.items():
            for group in _GROUPS:
                rate, interval = metrics["success_rate"][group], metrics["success_interval"][group]
                if rate is not None and number in collected:
                    points[group].append(Point(collected[number], rate, interval))
        return [Line(group.capitalize(), series) for group, series in points.items()]

    def curves(self) -> dict[str, Curves]:
        """All line charts, by title."""
        share = formatting.percent
        # Not every policy reports tokens.
        other = "characters" if any(row["collect"]["reply_tokens"] for row in self.rows) else "tokens"
        collected = [
            self._line(group.capitalize(), f"collect/success_rate/{group}", _SMOOTHING) for group in _GROUPS
        ]
        charts = {
            "Success on unseen test tasks": Curves(
                "Success on test tasks", self._tested(), share, whole=True
            ),
            "Success while collecting": Curves(
                "Success on training tasks, moving average", collected, share, whole=True
            ),
        }
        charts |= {
            title: Curves(
                chart.axis,
                [self._line(*line, number=number) for number, line in enumerate(chart.lines.items())],
                getattr(formatting, chart.write) if chart.write else "{:.3g}".format,
                whole=chart.whole,
            )
            for title, chart in _CHARTS.items()
            if title != f"Reply length, {other}"
        }
        return {title: curves for title, curves in charts.items() if not curves.is_empty}

    def dropped(self) -> list[tuple[int, int, dict[str, int]]]:
        """For each iteration, the number of steps trained on, and the numbers left out by each rule."""
        rows = []
        for row in self.rows:
            replay, update = row["replay"], row["update"]
            counts = {**replay["counts"], **replay}
            left_out = {label: int(counts.get(name, 0)) for name, label in _RULES.items()}
            rows.append((row["iteration"], update.get("samples", 0), left_out | update.get("dropped", {})))
        return rows

    # --- before and after -----------------------------------------------------------------------------------

    @cached_property
    def compared(self) -> tuple[int, int] | None:
        """The numbers of the first and the last evaluation; ``None`` if there are fewer than two."""
        numbers = sorted(self.evaluations)
        return (numbers[0], numbers[-1]) if len(numbers) > 1 else None

    def evaluation(self, number: int) -> RunReader:
        """The run of an evaluation."""
        return RunReader(self.path / EVALUATIONS / f"{number:04d}", skip_corrupt=True)

    def pairs(self) -> list[Pair]:
        """The samples of tasks that were judged in both evaluations, in the order of :attr:`Pair.rank`."""
        if self.compared is None:
            return []
        before, after = (self._judged(number) for number in self.compared)
        pairs = [Pair(entry, after[key]) for key, entry in before.items() if key in after]
        return sorted(pairs, key=lambda pair: (pair.rank, pair.before.task_id, pair.before.sample))

    def _judged(self, number: int) -> dict[tuple[str, int], Entry]:
        entries = self.evaluation(number).attempts.values()
        return {(entry.task_id, entry.sample): entry for entry in entries if entry.outcome.is_rewarded}


def write_training_report(
    path: Path, *, config: ReportConfig | None = None, progress: ReportProgress = lambda *_: None
) -> Path:
    """Write the report of a training, which may still be going on. Blocks.

    Args:
        path: the training folder.
        config: settings of the report.
        progress: called with the progress.

    Returns:
        Path of ``report.html`` in the folder.

    Raises:
        RunFolderError: the folder is not a training.
        StoreFull: there is no space.
    """
    training = Training(path)
    return write_parts(path / REPORT, _parts(training, config or ReportConfig(), progress))


def _parts(training: Training, config: ReportConfig, progress: ReportProgress) -> Iterator[str]:
    title = training.path.resolve().name
    pairs = training.pairs()
    shown = pairs[: config.pairs]
    homes = [f"{EVALUATIONS}/{number:04d}" for number in training.compared or ()]
    document = Document(title, _SCRIPTS, {"outcomes": outcome_words(), "homes": homes}, live=False)
    yield document.render("training.html.j2", **_context(training, title, pairs), pairs_shown=len(shown))
    names: list[dict[str, None]] = [{}, {}]
    if training.compared:
        readers = [training.evaluation(number) for number in training.compared]
        for number, pair in enumerate(shown):
            sides = []
            for side, reader, entry in zip(names, readers, pair, strict=True):
                trajectory = reader.trajectory(entry.attempt_id)
                side |= dict.fromkeys(
                    observation.screenshot for observation in trajectory.episode.observations
                )
                sides.append(page(trajectory, reader.tasks.get(entry.task_id)))
            yield Page.data(f"pair-{number}", sides)
        for number, (reader, side) in enumerate(zip(readers, names, strict=True)):
            half = config.model_copy(update={"image_budget_bytes": config.image_budget_bytes // 2})
            wanted = side if number == 0 else {name: None for name in side if name not in names[0]}
            for count, small in enumerate(thumbnails(reader.path, wanted, half)):
                yield Page.picture(small.name, small.data)
                progress("pictures", count + 1, len(wanted))
    yield document.tail()


def _context(training: Training, title: str, pairs: Sequence[Pair]) -> dict[str, Any]:
    """The variables of the template."""
    rows, config = training.rows, training.config
    first, last = (training.evaluations[n] for n in training.compared) if training.compared else (None, None)
    phases = [(str(row["iteration"]), row["seconds"]) for row in rows]
    changes = Counter(pair.rank for pair in pairs)
    loop = config.get("loop") or {}
    return {
        "name": title,
        "folder": shlex.quote(str(training.path)),
        "model": (config.get("learn") or {}).get("model", "–"),
        "objective": ((config.get("learn") or {}).get("objective") or {}).get("name", "–"),
        "seed": config.get("seed", "–"),
        "wanted": loop.get("iterations"),
        "rows": rows,
        "first": first,
        "last": last,
        "compared": training.compared,
        "rise": _rise(first, last),
        "apart": _do_not_overlap(first, last),
        "samples": sum(row["update"].get("samples", 0) for row in rows),
        "seconds": sum(sum(row["seconds"].values()) for row in rows),
        "curves": training.curves(),
        "dropped": training.dropped(),
        "rules": list(
            dict.fromkeys(
                label for _, _, left_out in training.dropped() for label, n in left_out.items() if n
            )
        ),
        "phases": list(dict.fromkeys(phase for _, parts in phases for phase in parts)),
        "phase_bars": phase_bars(phases, formatting.duration),
        "pairs": pairs,
        "changes": [changes[rank] for rank in range(4)],
    }


def _rise(first: Mapping[str, Any] | None, last: Mapping[str, Any] | None) -> float | None:
    if first is None or last is None:
        return None
    before, after = first["success_rate"]["overall"], last["success_rate"]["overall"]
    return None if before is None or after is None else after - before


def _do_not_overlap(first: Mapping[str, Any] | None, last: Mapping[str, Any] | None) -> bool:
    """Whether the two success intervals do not overlap."""
    ends: list[Interval | None] = [
        evaluation["success_interval"]["overall"] if evaluation else None for evaluation in (first, last)
    ]
    before, after = ends
    return before is not None and after is not None and (before[1] < after[0] or after[1] < before[0])


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
        number: in its chart, for its colour if its name has none.
    """

    name: str
    points: Sequence[Point]
    smoothing: float = 1.0
    number: int = 0

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
        other = _GROUPS[self.number % len(_GROUPS)]
        return f"var(--line-{self.name.lower().replace(' ', '-')}, var(--line-{other}))"


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
