"""``webgym tasks split``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from webgym.tasks.split import Split


def split(
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    out: Path = typer.Option(..., "--out", help="Folder for a file per split; or one file for both."),
    test: int = typer.Option(1_167, "--test", min=0, help="Test tasks, each from a website of its own."),
    seed: int = typer.Option(0, "--seed", help="Seed of the choice."),
    largest_website: int = typer.Option(
        100, "--largest-website", min=1, help="Most tasks on a website that is for testing, if that suffices."
    ),
    left_out: Path | None = typer.Option(
        None,
        "--left-out",
        help="Write id, website and reason of every task that is left out here (JSON lines).",
    ),
) -> None:
    """Choose test tasks from distinct websites; keep these websites and their families out of training."""
    import msgspec

    from webgym.cli.tasks._files import with_own_ids
    from webgym.tasks.files import whole_file
    from webgym.tasks.formats import write_tasks
    from webgym.tasks.split import SplitConfig
    from webgym.tasks.split import split as run

    config = SplitConfig(test_tasks=test, seed=seed, largest_website=largest_website)
    found = run(with_own_ids(files), config)
    write_tasks(out, found.tasks)
    if left_out is not None:
        with whole_file(left_out) as file:
            file.writelines(msgspec.json.encode(each) + b"\n" for each in found.left_out)
    _tell(found, out)


def _tell(found: Split, out: Path) -> None:
    from collections import Counter

    from rich.console import Console

    from webgym.core.task import LEVELS
    from webgym.tables import Table, show

    domains = sorted({domain for _, domain in found.test})
    rows = [
        (domain, *(str(found.test[level, domain]) for level in LEVELS), str(found.of_domain(domain)))
        for domain in domains
    ]
    rows.append(("all", *(str(found.of_level(level)) for level in LEVELS), str(found.test.total())))
    show([Table("Test tasks", ("domain", *LEVELS, "all"), rows)], Console())
    train = len(found.tasks) - found.test.total()
    print(f"{train:,} training and {found.test.total():,} test tasks written to {out}")
    for why, count in Counter(each.why for each in found.left_out).items():
        print(f"{count:,} left out: {why}")
