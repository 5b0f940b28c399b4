"""Agreement of judges with human labels: rates with bootstrap intervals, and differences between judges.

The paper's study (§3.4) holds judges, with and without rubric, against human labels of 80 trajectories that
were drawn evenly over difficulty. Everything here is a pure function of (human, judges) pairs; where labels
come from is the business of :mod:`webgym.judge.labels`.

**Intervals** are percentiles of a bootstrap. A resample draws with replacement, within each level of
difficulty as many as there are (how many of each there are was decided, not found), and whole tasks rather
than trajectories, because attempts at one task succeed or fail together. All judges are measured on the same
resamples, so that the interval of a difference is that of a paired comparison.

**What cannot be computed is ``None``, never 0**: precision of a judge that passed nothing, recall where
people passed nothing. An interval is ``None`` where the resamples say nothing either: the rate is undefined
in more of them than the interval leaves out, or it is the same in all.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Final, Literal, TypeAlias

import msgspec
import numpy as np
from pydantic import Field

from webgym.core.task import LEVELS, Level
from webgym.settings import Settings
from webgym.stats import Counts, Values, percentiles, resampled

Metric: TypeAlias = Literal["accuracy", "precision", "recall", "f1", "kappa"]
METRICS: Final[tuple[Metric, ...]] = ("accuracy", "precision", "recall", "f1", "kappa")

Group: TypeAlias = Literal["overall", "easy", "medium", "hard"]
GROUPS: Final[tuple[Group, ...]] = ("overall", *LEVELS)

_TP, _FP, _FN, _TN = range(4)


class AgreementConfig(Settings):
    """How agreement is measured."""

    no_verdict: Literal["left_out", "failure"] = "left_out"
    """A trajectory without a verdict is left out of the rates and counted, or counts as judged a failure."""

    resamples: Annotated[int, Field(ge=100)] = 10_000
    """Of the bootstrap."""

    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """Of the intervals."""

    seed: int = 0
    """Of the bootstrap: the same cases and seed give the same intervals."""


class Case(msgspec.Struct, frozen=True):
    """A trajectory that a person labelled and judges judged.

    Attributes:
        human: whether the person says it succeeded.
        verdicts: what each judge says, in one order for all cases; ``None`` for no verdict.
        level: difficulty of its task; ``None`` if unknown.
        task: cases of one task are resampled together; empty for a case that stands alone.
    """

    human: bool
    verdicts: tuple[bool | None, ...]
    level: Level | None = None
    task: str = ""


class Confusion(msgspec.Struct, frozen=True):
    """Counts of (human, judge) pairs; positive is success.

    Attributes:
        both: success to both (true positives).
        judge_only: success to the judge alone (false positives).
        human_only: success to the person alone (false negatives).
        neither: failure to both (true negatives).
    """

    both: int
    judge_only: int
    human_only: int
    neither: int

    @property
    def total(self) -> int:
        """All pairs."""
        return self.both + self.judge_only + self.human_only + self.neither


class Estimate(msgspec.Struct, frozen=True):
    """A figure and its interval; ``None`` for what is undefined."""

    value: float | None
    low: float | None = None
    high: float | None = None


class Figures(msgspec.Struct, frozen=True):
    """One judge on one group of cases.

    Attributes:
        confusion: the pairs that were counted.
        no_verdict: cases that the judge had no verdict on, whether they were left out or not.
        metrics: by name: accuracy, precision, recall, f1, kappa (Cohen's).
    """

    confusion: Confusion
    no_verdict: int
    metrics: dict[Metric, Estimate]


class Difference(msgspec.Struct, frozen=True):
    """Two judges on the cases that both have a verdict on.

    Attributes:
        judge: whose figures are counted from.
        baseline: whose figures are taken away.
        cases: how many both have a verdict on, by group.
        metrics: judge minus baseline with its paired interval, by group and name.
    """

    judge: str
    baseline: str
    cases: dict[Group, int]
    metrics: dict[Group, dict[Metric, Estimate]]


class Agreement(msgspec.Struct, frozen=True):
    """Agreement of judges with human labels.

    Attributes:
        cases: how many, by group. Those of unknown difficulty are in ``overall`` alone.
        successes: how many of them people say succeeded, by group.
        judges: figures by judge and group; a group without cases is left out.
        differences: of every later judge from the first.
    """

    cases: dict[Group, int]
    successes: dict[Group, int]
    judges: dict[str, dict[Group, Figures]]
    differences: tuple[Difference, ...]


def rates(confusion: Confusion) -> dict[Metric, float | None]:
    """The metrics of a table of counts; ``None`` where one is undefined."""
    counts = [confusion.both, confusion.judge_only, confusion.human_only, confusion.neither]
    return {name: _defined(value) for name, value in zip(METRICS, _rates(np.array(counts)), strict=True)}


def agreement(
    judges: Sequence[str], cases: Iterable[Case], config: AgreementConfig | None = None
) -> Agreement:
    """Compare judges with human labels.

    Args:
        judges: names, in the order of the cases' verdicts; none twice.
        cases: in any order.
        config: what to do about missing verdicts, and of the bootstrap.

    Raises:
        ValueError: a case does not have as many verdicts as there are judges, or a name stands twice.
    """
    config = config or AgreementConfig()
    held = list(cases)
    if len(set(judges)) != len(judges):
        raise ValueError("two judges have the same name")
    if any(len(case.verdicts) != len(judges) for case in held):
        raise ValueError(f"every case needs {len(judges)} verdicts")
    tables = _tables(held, len(judges), config)
    groups = [group for group in GROUPS if group == "overall" or _of(held, group)]
    return Agreement(
        cases={group: len(_of(held, group)) for group in groups},
        successes={group: sum(case.human for case in _of(held, group)) for group in groups},
        judges={
            judge: {group: _figures(tables[group], held, group, index, config) for group in groups}
            for index, judge in enumerate(judges)
        },
        differences=tuple(
            _difference(tables, judges, index, groups, config) for index in range(1, len(judges))
        ),
    )


def _of(cases: Sequence[Case], group: Group) -> list[Case]:
    return [case for case in cases if group in ("overall", case.level)]


class _Table(msgspec.Struct, frozen=True):
    """Counts of a group: as found, and in every resample.

    A row holds four counts per view. View ``j`` is judge j on all its cases; behind these, two views for
    each later judge: the first judge, and that judge, on the cases that both have a verdict on.
    """

    found: Counts
    drawn: Counts


def _tables(cases: Sequence[Case], judges: int, config: AgreementConfig) -> dict[Group, _Table]:
    """The tables of all groups. Overall is the sum of the levels, so its resamples are stratified."""
    generator = np.random.default_rng(config.seed)
    width = 4 * (judges + 2 * max(0, judges - 1))
    tables: dict[Group, _Table] = {}
    strata = []
    for level in (*LEVELS, None):
        clusters = _clusters([case for case in cases if case.level == level], judges, config)
        found = np.sum(np.array(clusters, np.int64).reshape(-1, width), axis=0)
        table = _Table(found, resampled(clusters, width, config.resamples, generator))
        strata.append(table)
        if level is not None:
            tables[level] = table
    tables["overall"] = _Table(
        np.sum([table.found for table in strata], axis=0), np.sum([table.drawn for table in strata], axis=0)
    )
    return tables


def _clusters(cases: Iterable[Case], judges: int, config: AgreementConfig) -> list[list[int]]:
    """The counts of every task of a stratum: rows as in :class:`_Table`."""
    width = 4 * (judges + 2 * max(0, judges - 1))
    rows: dict[object, list[int]] = defaultdict(lambda: [0] * width)
    for number, case in enumerate(cases):
        row = rows[case.task or number]
        verdicts = [_counted(verdict, config) for verdict in case.verdicts]
        for judge, verdict in enumerate(verdicts):
            if verdict is None:
                continue
            row[4 * judge + _cell(case.human, verdict)] += 1
            if judge and verdicts[0] is not None:
                pair = 4 * (judges + 2 * (judge - 1))
                row[pair + _cell(case.human, verdicts[0])] += 1
                row[pair + 4 + _cell(case.human, verdict)] += 1
    return list(rows.values())


def _counted(verdict: bool | None, config: AgreementConfig) -> bool | None:
    return False if verdict is None and config.no_verdict == "failure" else verdict


def _cell(human: bool, verdict: bool) -> int:
    return (_TP if verdict else _FN) if human else (_FP if verdict else _TN)


def _rates(counts: Counts) -> Values:
    """Metrics of counts: the last axis of four becomes one of five; NaN where one is undefined."""
    tp, fp, fn, tn = np.moveaxis(counts.astype(np.float64), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (
            (tp + tn) / (tp + fp + fn + tn),
            tp / (tp + fp),
            tp / (tp + fn),
            2 * tp / (2 * tp + fp + fn),
            # Cohen's kappa with both fractions multiplied out: exact zeros stay zeros.
            2 * (tp * tn - fp * fn) / ((tp + fp) * (fp + tn) + (tp + fn) * (fn + tn)),
        )
    return np.stack(found, axis=-1)


def _view(table: _Table, view: int) -> tuple[Counts, Counts]:
    return table.found[4 * view : 4 * view + 4], table.drawn[:, 4 * view : 4 * view + 4]


def _figures(
    table: _Table, cases: Sequence[Case], group: Group, judge: int, config: AgreementConfig
) -> Figures:
    found, drawn = _view(table, judge)
    return Figures(
        Confusion(*map(int, found)),
        sum(case.verdicts[judge] is None for case in _of(cases, group)),
        _estimates(_rates(found), _rates(drawn), config),
    )


def _difference(
    tables: Mapping[Group, _Table],
    judges: Sequence[str],
    judge: int,
    groups: Sequence[Group],
    config: AgreementConfig,
) -> Difference:
    view = len(judges) + 2 * (judge - 1)
    cases, metrics = {}, {}
    for group in groups:
        (base, base_drawn), (found, drawn) = _view(tables[group], view), _view(tables[group], view + 1)
        cases[group] = int(found.sum())
        metrics[group] = _estimates(_rates(found) - _rates(base), _rates(drawn) - _rates(base_drawn), config)
    return Difference(judges[judge], judges[0], cases, metrics)


def _estimates(found: Values, drawn: Values, config: AgreementConfig) -> dict[Metric, Estimate]:
    return {
        name: _estimate(float(found[place]), drawn[:, place], config.confidence)
        for place, name in enumerate(METRICS)
    }


def _estimate(value: float, drawn: Values, confidence: float) -> Estimate:
    if np.isnan(value):
        return Estimate(None)
    return Estimate(value, *(percentiles(drawn, confidence) or ()))


def _defined(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
