"""``webgym tasks split``: split a task set into training and test tasks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from webgym.tasks.split import Split


def split(
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    out: Path = typer.Option(..., "--out", help="Folder to write a file per split to, or one file for both."),
    test: int = typer.Option(1_167, "--test", min=0, help="Number of test tasks, each from another website."),
    seed: int = typer.Option(0, "--seed", help="Seed of the choice of test tasks."),
    largest_website: int = typer.Option(
        100,
        "--largest-website",
        min=1,
        help="Test websites have at most this many tasks, if there are enough of them.",
    ),
    left_out: Path | None = typer.Option(
        None,
        "--left-out",
        help="Write id, website and reason of every task that is left out to this file (JSON lines).",
    ),
) -> None:
    """Choose test tasks from distinct websites; leave these websites and related tasks out of training."""
    import msgspec

    from webgym.cli.tasks._files import read_unique
    from webgym.tasks.files import whole_file
    from webgym.tasks.formats import write_tasks
    from webgym.tasks.split import SplitConfig
    from webgym.tasks.split import split as run

    config = SplitConfig(test_tasks=test, seed=seed, largest_website=largest_website)
    result = run(read_unique(files), config)
    write_tasks(out, result.tasks)
    if left_out is not None:
        with whole_file(left_out) as file:
            file.writelines(msgspec.json.encode(task) + b"\n" for task in result.left_out)
    _print_result(result, out)


def _print_result(result: Split, out: Path) -> None:
    from collections import Counter

    from rich.console import Console

    from webgym.core.tables import Table, show
    from webgym.core.task import LEVELS

    domains = sorted({domain for _, domain in result.test})
    rows = [
        (domain, *(str(result.test[level, domain]) for level in LEVELS), str(result.of_domain(domain)))
        for domain in domains
    ]
    rows.append(("all", *(str(result.of_level(level)) for level in LEVELS), str(result.test.total())))
    show([Table("Test tasks", ("domain", *LEVELS, "all"), rows)], Console())
    train = len(result.tasks) - result.test.total()
    print(f"{train:,} training and {result.test.total():,} test tasks written to {out}")
    for why, count in Counter(task.why for task in result.left_out).items():
        print(f"{count:,} left out: {why}")
