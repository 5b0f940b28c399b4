"""Results of evaluations as tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from rich.console import Console
from rich.table import Table as RichTable

from webgym.core.text import plain
from webgym.rollout.evaluation import GROUPS, Evaluation, Row
from webgym.rollout.manifest import Manifest
from webgym.rollout.rates import Interval
from webgym.tables import DASH, Table

_SHORT: Final = {
    "difficulty": "",
    "success, %": "success %",
    "of planned, %": "of all %",
    "95 % interval": "95 %",
}
"""Columns in a terminal, which may be 80 characters wide."""


def tables(found: Sequence[Evaluation]) -> Iterator[Table]:
    """For a paper: of one run by difficulty; of several, a row each. Then what carries no reward."""
    if len(found) == 1:
        (one,) = found
        columns, rows = _by_difficulty(one)
        yield Table(f"Success of {one.policy} by difficulty, judged by {one.judge}", columns, rows)
    else:
        yield from _side_by_side(found)
    lost = _outcomes(found)
    if lost:
        rows = [
            (one.run, *(str(one.rows["overall"].no_reward.get(name, 0)) for name in lost)) for one in found
        ]
        yield Table("Samples without a reward, not in the rates", ("run", *lost), rows)


def conditions(found: Sequence[Evaluation]) -> Table:
    """For a paper: under which conditions each run was made, a column each."""
    columns = [dict(_conditions(one.manifest)) for one in found]
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return Table("Conditions", ("", *(one.run for one in found)), rows, names=1 + len(found))


def _conditions(of: Manifest) -> Iterator[tuple[str, str]]:
    yield "WebGym", _recorded(of.webgym)
    yield "first and last attempt, UTC", _recorded(of.began and f"{of.began} to {of.ended}")
    yield "policy", _recorded(of.policies)
    yield "weights", _recorded(of.weights)
    yield "sampling", _recorded(of.sampling)
    yield "agent", _recorded(of.agent)
    yield "system prompts, SHA-256", _recorded(of.prompts)
    yield "judge", _recorded(of.judges)
    yield "tasks", _recorded(of.task_file or of.offline_web)
    yield "sources", _recorded(of.sources)
    yield "split", of.split
    yield "drawn tasks, SHA-256", of.tasks_sha256
    yield "left out of the set", _recorded(of.left_out, empty="none")
    yield "seed", _recorded(of.seed)
    yield "samples per task", str(of.samples)
    yield "steps for easy, medium, hard", _recorded(of.budget)
    yield "browser", _recorded(of.browser)
    yield "sandboxed", _recorded(of.sandboxed)
    yield "viewport, CSS pixels", _recorded(of.viewport)
    yield "server", _recorded(of.server)
    yield "egress", _recorded(of.egress)
    yield "planned samples", str(of.planned)
    yield "judged samples, successes", f"{of.judged}, {of.successes}"
    yield "attempts, repeated ones included", str(of.attempts)
    yield "samples that are missing", str(of.missing)
    invalid = {
        f"{outcome} ({code})" if code else outcome: count
        for outcome, codes in of.invalid.items()
        for code, count in codes.items()
    }
    yield "samples without a reward", _recorded(invalid, empty="none")
    yield "blocked websites", _recorded(of.blocked_websites, empty="none")


def _recorded(value: Any, empty: str = "not recorded") -> str:
    if value is None:
        return "not recorded"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        told = (f"{name}: {_recorded(each)}" for name, each in value.items() if each is not None)
        return "; ".join(told) or empty
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or empty
    return str(value)


def show(one: Evaluation, console: Console) -> None:
    """One result on a terminal."""
    columns, rows = _by_difficulty(one)
    table = RichTable(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim")
    for place, name in enumerate(columns):
        short = _SHORT.get(name, name)
        table.add_column(short, justify="right" if place else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row, style="bold" if row[0] == "overall" else "")
    console.print()
    console.print(table)
    console.print()
    for note in notes(one):
        console.print(plain(note), highlight=False, soft_wrap=True, markup=False)


def notes(one: Evaluation) -> Iterator[str]:
    """What a reader of the table has to know."""
    overall = one.rows["overall"]
    yield from one.notes
    yield f"policy {one.policy}, judged by {one.judge}, seed {one.seed}"
    budget = "" if one.budget is None else f"at most {' / '.join(map(str, one.budget))} steps"
    per_task = "1 sample" if one.samples == 1 else f"{one.samples} samples"
    yield f"{per_task} per task{', ' if budget else ''}{budget}"
    if one.samples > 1:
        yield "ever: tasks that at least one sample of succeeded"
    if any(row.method == "bootstrap" for row in one.rows.values()):
        kinds = "bootstrap over tasks, stratified by difficulty"
        if any(row.method == "wilson" and row.interval for row in one.rows.values()):
            kinds += "; where all tasks ended alike, Wilson's over tasks"
        yield f"95 % intervals: {kinds}"
    else:
        yield "95 % intervals: Wilson's"
    if overall.no_reward:
        told = ", ".join(f"{count} {name}" for name, count in overall.no_reward.items())
        yield f"without a reward, so no success of all planned samples, and not in the other rate: {told}"
    if overall.missing:
        missing = "1 sample is" if overall.missing == 1 else f"{overall.missing} samples are"
        yield f"{missing} missing: the run is not finished (webgym eval --resume), or not judged"


def _by_difficulty(one: Evaluation) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """A row per level; how many tasks were ever solved only where that is another figure."""
    is_repeated = one.samples > 1
    once = ("ever, %",) if is_repeated else ()
    rates = ("success, %", "95 % interval", "of planned, %", "95 % interval")
    columns = ("difficulty", "tasks", "judged", *rates, *once, "steps", "no reward")
    rows = []
    for group in GROUPS:
        row = one.rows[group]
        won, of = row.solved
        ever = (f"{100 * won / of:.1f}" if of else DASH,) if is_repeated else ()
        steps = DASH if row.steps is None else f"{row.steps:.1f}"
        lost = str(sum(row.no_reward.values()))
        rows.append((group, str(row.tasks), str(row.attempts), *_rates(row), *ever, steps, lost))
    return columns, rows


def _side_by_side(found: Sequence[Evaluation]) -> Iterator[Table]:
    def row(one: Evaluation, count: int, places: slice) -> tuple[str, ...]:
        cells = (_rates(one.rows[group])[places] for group in GROUPS)
        return one.run, one.policy, str(count), *(_together(*cell) for cell in cells)

    head = ("run", "policy")
    judged = [row(one, one.rows["overall"].attempts, slice(0, 2)) for one in found]
    yield Table("Success over judged attempts, %, with 95 % intervals", (*head, "judged", *GROUPS), judged)
    planned = [row(one, one.rows["overall"].planned, slice(2, 4)) for one in found]
    yield Table(
        "Success over all planned samples, %, with 95 % intervals", (*head, "planned", *GROUPS), planned
    )


def _together(rate: str, interval: str) -> str:
    return rate if interval == DASH else f"{rate} [{interval}]"


def _outcomes(found: Sequence[Evaluation]) -> list[str]:
    return list(dict.fromkeys(name for one in found for name in one.rows["overall"].no_reward))


def _rates(row: Row) -> tuple[str, str, str, str]:
    """Both rates with their intervals: over judged attempts, over all planned samples."""
    judged = _told(row.rate, row.interval)
    return *judged, *_told(row.rate_of_planned, row.interval_of_planned)


def _told(rate: float | None, interval: Interval | None) -> tuple[str, str]:
    return (
        DASH if rate is None else f"{100 * rate:.1f}",
        DASH if interval is None else f"{100 * interval[0]:.1f}, {100 * interval[1]:.1f}",
    )
