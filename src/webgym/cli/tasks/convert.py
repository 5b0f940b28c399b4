"""``webgym tasks convert``: write a task set in another format."""

from __future__ import annotations

import sys
from pathlib import Path

import typer


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
