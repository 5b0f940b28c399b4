"""``webgym tasks split``, ``convert`` and ``offline``: write task sets to files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.cli._options import Collection

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


def convert(
    source: Path = typer.Argument(
        ..., metavar="IN", help="Task file of any format, or a folder with tasks.*, train.* or test.*."
    ),
    out: Path = typer.Argument(
        ..., metavar="OUT", help="File to write (.parquet, .jsonl, .jsonl.gz, .jsonl.zst), or a folder."
    ),
    format: str | None = typer.Option(
        None,
        "--format",
        metavar="jsonl|parquet|published",
        help="Format of OUT. A folder gets a file per split.",
        show_default="by the name of a file, jsonl in a folder",
    ),
) -> None:
    """Write a task set in another format. Fails if a record could not be read; the rest is written.

    Tasks without a fact to judge are not written; their number is printed.
    """
    from webgym.cli import EXIT_USAGE
    from webgym.cli.tasks._files import print_set_aside
    from webgym.core.errors import ConfigError
    from webgym.tasks.formats import FORMATS, read_tasks, write_tasks

    chosen = next((known for known in FORMATS if known == format), None)
    if format and not chosen:
        raise ConfigError(f"unknown format {format!r}", hint=f"choose one of {', '.join(FORMATS)}")
    records = read_tasks(source)
    count = write_tasks(out, records.tasks, format=chosen)
    print(f"{count} tasks written to {out}")
    print_set_aside(records.set_aside)
    if records.broken:
        for record in records.broken:
            print(f"left out {record}", file=sys.stderr)
        raise typer.Exit(EXIT_USAGE)


def offline(
    out: Path = typer.Option(..., "--out", help="Task file to write: .jsonl or .parquet."),
    split: str | None = typer.Option(None, "--split", help="train or test.", show_default="both"),
    seed: int | None = typer.Option(None, "--seed", help="Seed of the offline web.", show_default="7"),
    collection: Collection = "large",
    per_family: int | None = typer.Option(
        None, "--per-family", min=1, help="Number of websites per family.", show_default="50 large, 72 small"
    ),
) -> None:
    """Write the offline web's tasks to a file, with the hidden truths that they are judged by."""
    from rich.console import Console
    from rich.progress import track

    from webgym.core.errors import ConfigError
    from webgym.offline.config import DEFAULT_SEED
    from webgym.offline.web import OfflineWeb, collection_name
    from webgym.tasks.formats import write_tasks

    if split not in (None, "train", "test"):
        raise ConfigError(f"unknown split {split!r}", hint="choose train or test")
    web = OfflineWeb(
        DEFAULT_SEED if seed is None else seed, per_family=per_family, collection=collection_name(collection)
    )
    hosts = [host for host, spec in web.specs.items() if split in (None, spec.split)]
    console = Console(stderr=True)
    shown = track(hosts, "websites", console=console, transient=True, disable=not console.is_terminal)
    count = write_tasks(out, (task for host in shown for task in web.tasks_of(host)))
    print(f"{count} tasks written to {out}")
