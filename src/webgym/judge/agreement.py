"""Agreement of judges with human labels: rates with bootstrap intervals, and differences between judges.

The paper's study (§3.4) compares judges, with and without rubric, with human labels of 80 trajectories that
were sampled evenly over difficulty. Everything here is a pure function of (human label, verdicts) pairs;
labels are read by :mod:`webgym.judge.labels`.

**Intervals** are percentiles of a stratified cluster bootstrap. A resample draws with replacement, as many
from each level of difficulty as the sample has (their numbers were chosen by the study's design), and whole
tasks rather than trajectories, because attempts at one task tend to succeed or fail together. All judges are
measured on the same resamples, so the interval of a difference is that of a paired comparison.

**What cannot be computed is ``None``, never 0**: the precision of a judge that passed nothing, the recall
where people passed nothing. An interval is ``None`` if the rate is undefined in more resamples than the
interval leaves out, or if it is the same in all resamples.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

import msgspec
import numpy as np
from matplotlib.lines import Line2D
from pydantic import Field

from webgym.core.plotting import CATEGORIES, MUTED, PAGE, new_figure, save, styled
from webgym.core.settings import Settings
from webgym.core.stats import Counts, Values, percentiles, resampled
from webgym.core.tables import DASH, Table, printed
from webgym.core.task import LEVELS, Level
from webgym.judge.panel import PREFIX

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Metric: TypeAlias = Literal["accuracy", "precision", "recall", "f1", "kappa"]
METRICS: Final[tuple[Metric, ...]] = ("accuracy", "precision", "recall", "f1", "kappa")
_HEADINGS: Final = ("accuracy", "precision", "recall", "F1", "κ")
_RATE, _SIGNED = ".3f", "+.3f"

Group: TypeAlias = Literal["overall", "easy", "medium", "hard"]
GROUPS: Final[tuple[Group, ...]] = ("overall", *LEVELS)

_TP, _FP, _FN, _TN = range(4)

CONFIDENCE = 0.95
"""Confidence level of the intervals, between 0 and 1."""


class AgreementConfig(Settings):
    """How agreement is measured."""

    no_verdict: Literal["left_out", "failure"] = "left_out"
    """A trajectory without a verdict is left out of the rates (``left_out``) or counts as judged a
    failure."""

    resamples: Annotated[int, Field(ge=100)] = 10_000
    """Number of bootstrap resamples."""

    seed: int = 0
    """Seed of the bootstrap: the same cases and seed give the same intervals."""


class Case(msgspec.Struct, frozen=True):
    """A trajectory with a human label and the verdicts of judges.

    Attributes:
        human: the human label; true is success.
        verdicts: of each judge, in the same order for all cases; ``None`` for no verdict.
        level: difficulty of its task; ``None`` if unknown.
        task: id of its task; cases of one task are resampled together. Empty resamples the case alone.
    """

    human: bool
    verdicts: tuple[bool | None, ...]
    level: Level | None = None
    task: str = ""


class Confusion(msgspec.Struct, frozen=True):
    """Counts of (human, judge) pairs; positive is success.

    Attributes:
        both: true positives: both say success.
        judge_only: false positives: only the judge says success.
        human_only: false negatives: only the human label says success.
        neither: true negatives: both say failure.
    """

    both: int
    judge_only: int
    human_only: int
    neither: int

    @property
    def total(self) -> int:
        """Number of pairs."""
        return self.both + self.judge_only + self.human_only + self.neither

    def __str__(self) -> str:
        return (
            f"judged a success by both {self.both}, by the judge only {self.judge_only}, "
            f"by people only {self.human_only}, by neither {self.neither}"
        )


class Estimate(msgspec.Struct, frozen=True):
    """A value and the bounds of its confidence interval; ``None`` for what is undefined."""

    value: float | None
    low: float | None = None
    high: float | None = None

    def texts(self, form: str) -> tuple[str, str]:
        """The value and its interval in this format; a dash if the value is undefined."""
        value, low, high = (
            "" if number is None else f"{number:{form}}".replace("-", "−" if "+" in form else "-")
            for number in (self.value, self.low, self.high)
        )
        # .467 for 0.467, so that five intervals fit on a line
        interval = f"{low.replace('0.', '.', 1)}, {high.replace('0.', '.', 1)}" if low and high else ""
        return value or DASH, interval if value else ""


class Figures(msgspec.Struct, frozen=True):
    """Agreement of one judge with the human labels of one group of cases.

    Attributes:
        confusion: counts of the pairs.
        no_verdict: number of cases without a verdict of the judge, whether they were left out or not.
        metrics: accuracy, precision, recall, f1 and kappa (Cohen's), by name.
    """

    confusion: Confusion
    no_verdict: int
    metrics: dict[Metric, Estimate]


class Difference(msgspec.Struct, frozen=True):
    """Difference between two judges on the cases that both have a verdict on.

    Attributes:
        judge: name of the judge.
        baseline: name of the judge whose metrics are subtracted.
        cases: number of cases that both have a verdict on, by group.
        metrics: judge minus baseline with its paired interval, by group and name.
    """

    judge: str
    baseline: str
    cases: dict[Group, int]
    metrics: dict[Group, dict[Metric, Estimate]]


class Agreement(msgspec.Struct, frozen=True):
    """Agreement of judges with human labels.

    Attributes:
        cases: number of cases, by group. Those of unknown difficulty are in ``overall`` only.
        successes: number of them whose human label is success, by group.
        judges: metrics by judge and group; a group without cases is left out.
        differences: of every other judge from the first.
    """

    cases: dict[Group, int]
    successes: dict[Group, int]
    judges: dict[str, dict[Group, Figures]]
    differences: tuple[Difference, ...]

    def __str__(self) -> str:
        return printed(self.blocks())

    def tables(self) -> Iterator[Table]:
        """A table of all judges, and one of their differences, for a paper."""

        def cells(metrics: Mapping[Metric, Estimate], form: str) -> Iterator[str]:
            for name in METRICS:
                value, interval = metrics[name].texts(form)
                yield f"{value} [{interval}]" if interval else value

        columns = ("judge", "difficulty", "n", *_HEADINGS, "no verdict")
        rows = [
            (judge, group, str(each.confusion.total), *cells(each.metrics, _RATE), str(each.no_verdict))
            for judge, by_group in self.judges.items()
            for group, each in by_group.items()
        ]
        yield Table("Agreement with human labels, 95 % bootstrap intervals", columns, rows)
        if self.differences:
            rows = [
                (f"{of.judge} − {of.baseline}", group, str(count), *cells(of.metrics[group], _SIGNED))
                for of in self.differences
                for group, count in of.cases.items()
            ]
            yield Table("Paired differences, 95 % bootstrap intervals", columns[:-1], rows)

    def blocks(self) -> Iterator[Table]:
        """A table for each judge and each difference, for a terminal: intervals stand below values."""
        for judge, by_group in self.judges.items():
            overall = by_group["overall"]
            missing = f"  ({overall.no_verdict} without a verdict)" if overall.no_verdict else ""
            rows = [(group, each.confusion.total, each.metrics) for group, each in by_group.items()]
            yield _block(f"{judge}{missing}: {overall.confusion}", rows, _RATE)
        for of in self.differences:
            rows = [(group, count, of.metrics[group]) for group, count in of.cases.items()]
            yield _block(f"{of.judge} − {of.baseline}", rows, _SIGNED)


def _block(title: str, rows: Iterable[tuple[Group, int, Mapping[Metric, Estimate]]], form: str) -> Table:
    cells: list[tuple[str, ...]] = []
    for group, count, metrics in rows:
        values, intervals = zip(*(metrics[name].texts(form) for name in METRICS), strict=True)
        cells += [(group, str(count), *values), ("", "", *intervals)]
    return Table(title, ("", "n", *_HEADINGS), cells)


def rates(confusion: Confusion) -> dict[Metric, float | None]:
    """The metrics of a confusion matrix; ``None`` where one is undefined."""
    counts = [confusion.both, confusion.judge_only, confusion.human_only, confusion.neither]
    values = zip(METRICS, _rates(np.array(counts)), strict=True)
    return {name: None if np.isnan(value) else float(value) for name, value in values}


def agreement(
    judges: Sequence[str], cases: Iterable[Case], config: AgreementConfig | None = None
) -> Agreement:
    """Compare judges with human labels.

    Args:
        judges: unique names, in the order of the cases' verdicts.
        cases: in any order.
        config: treatment of missing verdicts, and the bootstrap's settings.

    Raises:
        ValueError: a case does not have as many verdicts as there are judges, or a name occurs twice.
    """
    config = config or AgreementConfig()
    labelled = list(cases)
    if len(set(judges)) != len(judges):
        raise ValueError("two judges have the same name")
    if any(len(case.verdicts) != len(judges) for case in labelled):
        raise ValueError(f"every case needs {len(judges)} verdicts")
    tables = _tables(labelled, len(judges), config)
    groups = [group for group in GROUPS if group == "overall" or _in_group(labelled, group)]
    return Agreement(
        cases={group: len(_in_group(labelled, group)) for group in groups},
        successes={group: sum(case.human for case in _in_group(labelled, group)) for group in groups},
        judges={
            judge: {group: _figures(tables[group], labelled, group, index) for group in groups}
            for index, judge in enumerate(judges)
        },
        differences=tuple(_difference(tables, judges, index, groups) for index in range(1, len(judges))),
    )


def _in_group(cases: Sequence[Case], group: Group) -> list[Case]:
    return [case for case in cases if group in ("overall", case.level)]


class _Table(msgspec.Struct, frozen=True):
    """Counts of a group of cases: observed, and in every resample.

    A row has four counts (TP, FP, FN, TN) per view. View ``j`` is judge j on all its cases. After these come
    two views for each judge but the first: the first judge, and that judge, on the cases that both have a
    verdict on.

    Attributes:
        observed: one row, shape (4 * views,).
        resampled: shape (resamples, 4 * views).
    """

    observed: Counts
    resampled: Counts


def _tables(cases: Sequence[Case], judges: int, config: AgreementConfig) -> dict[Group, _Table]:
    """The tables of all groups. ``overall`` is the sum of the levels, so its resamples are stratified."""
    generator = np.random.default_rng(config.seed)
    width = 4 * (judges + 2 * max(0, judges - 1))
    tables: dict[Group, _Table] = {}
    strata = []
    for level in (*LEVELS, None):
        clusters = _clusters([case for case in cases if case.level == level], judges, config)
        observed = np.sum(np.array(clusters, np.int64).reshape(-1, width), axis=0)
        table = _Table(observed, resampled(clusters, width, config.resamples, generator))
        strata.append(table)
        if level is not None:
            tables[level] = table
    tables["overall"] = _Table(
        np.sum([table.observed for table in strata], axis=0),
        np.sum([table.resampled for table in strata], axis=0),
    )
    return tables


def _clusters(cases: Iterable[Case], judges: int, config: AgreementConfig) -> list[list[int]]:
    """The counts of every task of a stratum, as rows of :class:`_Table`."""
    width = 4 * (judges + 2 * max(0, judges - 1))
    rows: dict[object, list[int]] = defaultdict(lambda: [0] * width)
    for number, case in enumerate(cases):
        row = rows[case.task or number]
        missing = False if config.no_verdict == "failure" else None
        verdicts = [missing if verdict is None else verdict for verdict in case.verdicts]
        for judge, verdict in enumerate(verdicts):
            if verdict is None:
                continue
            row[4 * judge + _cell(case.human, verdict)] += 1
            if judge and verdicts[0] is not None:
                pair = 4 * (judges + 2 * (judge - 1))
                row[pair + _cell(case.human, verdicts[0])] += 1
                row[pair + 4 + _cell(case.human, verdict)] += 1
    return list(rows.values())


def _cell(human: bool, verdict: bool) -> int:
    return (_TP if verdict else _FN) if human else (_FP if verdict else _TN)


def _rates(counts: Counts) -> Values:
    """Metrics of counts, shape (..., 4) to (..., 5), in the order of :data:`METRICS`; NaN where undefined."""
    tp, fp, fn, tn = np.moveaxis(counts.astype(np.float64), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        metrics = (
            (tp + tn) / (tp + fp + fn + tn),
            tp / (tp + fp),
            tp / (tp + fn),
            2 * tp / (2 * tp + fp + fn),
            # Cohen's kappa with both fractions multiplied out: exact zeros stay zeros.
            2 * (tp * tn - fp * fn) / ((tp + fp) * (fp + tn) + (tp + fn) * (fn + tn)),
        )
    return np.stack(metrics, axis=-1)


def _view(table: _Table, view: int) -> tuple[Counts, Counts]:
    return table.observed[4 * view : 4 * view + 4], table.resampled[:, 4 * view : 4 * view + 4]


def _figures(table: _Table, cases: Sequence[Case], group: Group, judge: int) -> Figures:
    observed, resamples = _view(table, judge)
    return Figures(
        Confusion(*map(int, observed)),
        sum(case.verdicts[judge] is None for case in _in_group(cases, group)),
        _estimates(_rates(observed), _rates(resamples)),
    )


def _difference(
    tables: Mapping[Group, _Table],
    judges: Sequence[str],
    judge: int,
    groups: Sequence[Group],
) -> Difference:
    view = len(judges) + 2 * (judge - 1)
    cases, metrics = {}, {}
    for group in groups:
        (base, base_resamples), (observed, resamples) = (
            _view(tables[group], view),
            _view(tables[group], view + 1),
        )
        cases[group] = int(observed.sum())
        metrics[group] = _estimates(
            _rates(observed) - _rates(base), _rates(resamples) - _rates(base_resamples)
        )
    return Difference(judges[judge], judges[0], cases, metrics)


def _estimates(observed: Values, resamples: Values) -> dict[Metric, Estimate]:
    return {
        name: _estimate(float(observed[column]), resamples[:, column]) for column, name in enumerate(METRICS)
    }


def _estimate(value: float, resamples: Values) -> Estimate:
    if np.isnan(value):
        return Estimate(None)
    return Estimate(value, *(percentiles(resamples, CONFIDENCE) or ()))


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
    :data:`webgym.judge.panel.PREFIX`) share a colour; without rubric the marker is hollow.

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
