"""Tables and notes of ``webgym eval``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from webgym.agent.policy import ORACLES
from webgym.core.tables import DASH, Table
from webgym.results.evaluation import GROUPS, Evaluation, Row
from webgym.results.manifest import Manifest
from webgym.results.rates import Interval


def tables(results: Sequence[Evaluation]) -> Iterator[Table]:
    """Tables for a paper: success of one run by difficulty, or of several runs; samples without a reward."""
    if len(results) == 1:
        (result,) = results
        is_repeated = result.samples > 1
        columns, rows = _rows({group: result.rows[group] for group in GROUPS}, is_repeated=is_repeated)
        yield Table(f"Success of {_policy(result)} by difficulty, judged by {result.judge}", columns, rows)
        if result.websites:
            columns, rows = _rows(result.websites, is_repeated=is_repeated)
            yield Table("Success by website", columns, rows)
    else:
        yield from _side_by_side(results)
    lost = _outcomes(results)
    if lost:
        rows = [
            (result.run, *(str(result.rows["overall"].no_reward.get(name, 0)) for name in lost))
            for result in results
        ]
        yield Table("Samples without a reward, not in the rates", ("run", *lost), rows)


def _policy(result: Evaluation) -> str:
    is_oracle = not ORACLES.isdisjoint(result.policy.split(", "))
    return f"{result.policy} (oracle)" if is_oracle else result.policy


def conditions(results: Sequence[Evaluation]) -> Table:
    """A table for a paper: the conditions under which runs were made, with a column per run."""
    columns = [dict(_conditions(result.manifest)) for result in results]
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return Table("Conditions", ("", *(result.run for result in results)), rows, names=1 + len(results))


def _conditions(manifest: Manifest) -> Iterator[tuple[str, str]]:
    """The fields of a manifest by their names, which it documents."""
    for field in manifest.__struct_fields__:
        value = getattr(manifest, field)
        if field == "invalid":
            value = {
                f"{outcome} {code}".strip(): n
                for outcome, codes in value.items()
                for code, n in codes.items()
            }
        if field != "run":
            yield field.replace("_", " "), _recorded(value)


def _recorded(value: Any) -> str:
    if value is None:
        return "not recorded"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        items = (f"{name}: {_recorded(item)}" for name, item in value.items() if item is not None)
        return "; ".join(items) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or "none"
    return str(value)


def notes(result: Evaluation, *, alone: bool = True) -> Iterator[str]:
    """Notes below the table: policy, judge, budget, method of the intervals, samples without a reward.

    Args:
        result: the evaluation.
        alone: whether the table is of this run alone; that of several has no column ``ever``.
    """
    overall = result.rows["overall"]
    yield from result.notes
    yield f"policy {result.policy}, judged by {result.judge}, seed {result.seed}"
    budget = "" if result.budget is None else f"at most {' / '.join(map(str, result.budget))} steps"
    per_task = "1 sample" if result.samples == 1 else f"{result.samples} samples"
    yield f"{per_task} per task{', ' if budget else ''}{budget}"
    if result.samples > 1 and alone:
        yield "ever: share of the tasks with at least one successful sample"
    if result.samples > 1 or any(row.method == "bootstrap" for row in result.rows.values()):
        kinds = "bootstrap, stratified by difficulty; where all tasks had the same result, Wilson's"
        yield f"95 % intervals over tasks: {kinds}"
    else:
        yield "95 % intervals: Wilson's"
    if overall.no_reward:
        lost = ", ".join(f"{count} {name}" for name, count in overall.no_reward.items())
        yield f"without a reward, left out of the rate of judged and unsuccessful in that of all: {lost}"
    if overall.missing:
        missing = "1 sample is" if overall.missing == 1 else f"{overall.missing} samples are"
        yield f"{missing} missing: the run is not finished (webgym eval --resume), or not judged"


def _rows(results: Mapping[Any, Row], *, is_repeated: bool) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns, and a row per group; the column ``ever`` only if tasks have several samples."""
    solved = ("ever, %",) if is_repeated else ()
    rates = ("success, %", "95 % interval", "of planned, %", "95 % interval")
    columns = ("", "tasks", "judged", *rates, *solved, "mean steps", "no reward")
    rows = []
    for group, row in results.items():
        won, tasks = row.solved
        ever = (f"{100 * won / tasks:.1f}" if tasks else DASH,) if is_repeated else ()
        steps = DASH if row.steps is None else f"{row.steps:.1f}"
        lost = str(sum(row.no_reward.values()))
        rows.append((group, str(row.tasks), str(row.attempts), *_rates(row), *ever, steps, lost))
    return columns, rows


def _side_by_side(results: Sequence[Evaluation]) -> Iterator[Table]:
    def row(result: Evaluation, count: int, columns: slice) -> tuple[str, ...]:
        cells = (_rates(result.rows[group])[columns] for group in GROUPS)
        return result.run, _policy(result), str(count), *(_with_interval(*cell) for cell in cells)

    head = ("run", "policy")
    judged = [row(result, result.rows["overall"].attempts, slice(0, 2)) for result in results]
    yield Table("Success over judged attempts, %, with 95 % intervals", (*head, "judged", *GROUPS), judged)
    planned = [row(result, result.rows["overall"].planned, slice(2, 4)) for result in results]
    yield Table(
        "Success over all planned samples, %, with 95 % intervals", (*head, "planned", *GROUPS), planned
    )


def _with_interval(rate: str, interval: str) -> str:
    return rate if interval == DASH else f"{rate} [{interval}]"


def _outcomes(results: Sequence[Evaluation]) -> list[str]:
    return list(dict.fromkeys(name for result in results for name in result.rows["overall"].no_reward))


def _rates(row: Row) -> tuple[str, str, str, str]:
    """Both rates with their intervals: over judged attempts, over all planned samples."""
    judged = _percent(row.rate, row.interval)
    return *judged, *_percent(row.rate_of_planned, row.interval_of_planned)


def _percent(rate: float | None, interval: Interval | None) -> tuple[str, str]:
    return (
        DASH if rate is None else f"{100 * rate:.1f}",
        DASH if interval is None else f"{100 * interval[0]:.1f}, {100 * interval[1]:.1f}",
    )
