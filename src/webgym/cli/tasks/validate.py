"""``webgym tasks validate``: check the rules that a split task set must meet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from webgym.taskset.validate import Report


def validate(
    files: list[Path] = typer.Argument(..., help="Task files of one set, training and test together."),
    unsplit: bool = typer.Option(
        False, "--unsplit", help="The tasks are not split yet: check the other rules only."
    ),
    lines: int = typer.Option(20, "--lines", min=0, help="Maximum number of violations to list per rule."),
    json: Path | None = typer.Option(None, "--json", help="Write the full report to this JSON file."),
) -> None:
    """Check that no training task is on a test website, among other rules, and list violations. Fails if any.

    Tasks without a split get it from the name of their file, train or test. Broken records are violations,
    too; tasks without a fact to judge are counted and not checked.
    """
    import msgspec

    from webgym.cli import EXIT_FAILED, EXIT_USAGE
    from webgym.cli.tasks._files import print_set_aside, read_all
    from webgym.tasks.files import whole_file
    from webgym.taskset.validate import validate as check

    records = read_all(files)
    report = check(records.tasks, split=not unsplit)
    broken = [str(record) for record in records.broken]
    if json is not None:
        aside = [str(record) for record in records.set_aside]
        document = {"report": report, "broken": broken, "set_aside": aside}
        with whole_file(json) as file:
            file.write(msgspec.json.format(msgspec.json.encode(document)))
    _print_report(report, broken, lines)
    print_set_aside(records.set_aside)
    if broken:
        raise typer.Exit(EXIT_USAGE)
    if not report.ok:
        raise typer.Exit(EXIT_FAILED)


def _print_report(report: Report, broken: Sequence[str], lines: int) -> None:
    from webgym.core.text import plain
    from webgym.taskset.validate import RULES

    print(
        f"{report.tasks:,} tasks on {report.websites:,} websites, {report.train:,} for training and", end=" "
    )
    print(f"{report.test:,} for testing, on {report.test_websites:,} websites")
    for rule, count in report.counts().items():
        print(f"{'ok ' if not count else 'BAD'} {RULES[rule]}" + (f": {count:,} exceptions" if count else ""))
        _print_some([str(offender) for offender in report.offenders if offender.rule == rule], lines)
    for rule in report.unchecked:
        print(f"--  not checked, as the tasks are not split yet: {RULES[rule]}")
    if broken:
        print(f"BAD every record can be read: {len(broken):,} cannot")
        _print_some(broken, lines)
    if report.orphans:
        some = plain(", ".join(report.orphans[:3]))
        print(f"{len(report.orphans):,} derived tasks have no parent here, which is allowed: {some}, ...")


def _print_some(entries: Sequence[str], lines: int) -> None:
    for line in entries[:lines]:
        print(f"      {line}")
    if len(entries) > lines:
        print(f"      and {len(entries) - lines:,} more (--lines)")
