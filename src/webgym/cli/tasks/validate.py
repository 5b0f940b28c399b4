"""``webgym tasks validate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from webgym.tasks.validate import Report


def validate(
    files: list[Path] = typer.Argument(..., help="Task files of one set, training and test together."),
    unsplit: bool = typer.Option(False, "--unsplit", help="The tasks have not been split yet."),
    lines: int = typer.Option(20, "--lines", min=0, help="How many offenders to name, per rule."),
    json: Path | None = typer.Option(None, "--json", help="Write the whole report here."),
) -> None:
    """Prove that no training task is on a test website, among other rules; name the offenders. Fails if any.

    A file named train or test splits tasks that do not say what they are for. Broken records offend, too;
    tasks without a fact to judge are counted and not checked.
    """
    import msgspec

    from webgym.cli import EXIT_FAILED, EXIT_USAGE
    from webgym.cli.tasks._files import read_all, tell_set_aside
    from webgym.tasks.files import whole_file
    from webgym.tasks.validate import validate as check

    held = read_all(files)
    report = check(held.tasks, split=not unsplit)
    broken = [str(record) for record in held.broken]
    if json is not None:
        aside = [str(record) for record in held.set_aside]
        whole = {"report": report, "broken": broken, "set_aside": aside}
        with whole_file(json) as file:
            file.write(msgspec.json.format(msgspec.json.encode(whole)))
    _tell(report, broken, lines)
    tell_set_aside(held.set_aside)
    if broken:
        raise typer.Exit(EXIT_USAGE)
    if not report.ok:
        raise typer.Exit(EXIT_FAILED)


def _tell(report: Report, broken: Sequence[str], lines: int) -> None:
    from webgym.core.text import plain
    from webgym.tasks.validate import RULES

    print(
        f"{report.tasks:,} tasks on {report.websites:,} websites, {report.train:,} for training and", end=" "
    )
    print(f"{report.test:,} for testing, on {report.test_websites:,} websites")
    for rule, count in report.counts().items():
        print(f"{'ok ' if not count else 'BAD'} {RULES[rule]}" + (f": {count:,} do not" if count else ""))
        _some([str(each) for each in report.offenders if each.rule == rule], lines)
    for rule in report.unchecked:
        print(f"--  not checked, for the tasks are not split yet: {RULES[rule]}")
    if broken:
        print(f"BAD every record can be read: {len(broken):,} cannot")
        _some(broken, lines)
    if report.orphans:
        some = plain(", ".join(report.orphans[:3]))
        print(f"{len(report.orphans):,} derived tasks have no parent here, which is no offence: {some}, ...")


def _some(told: Sequence[str], lines: int) -> None:
    for line in told[:lines]:
        print(f"      {line}")
    if len(told) > lines:
        print(f"      and {len(told) - lines:,} more (--lines)")
