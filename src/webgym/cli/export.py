"""``webgym export``: a run's steps for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, TextColumn

from webgym.core.outcome import Outcome
from webgym.rollout.export import export


class Format(StrEnum):
    """Of the files."""

    JSONL = "jsonl"
    PARQUET = "parquet"
    SHAREGPT = "sharegpt"


class Split(StrEnum):
    """Of the tasks."""

    TRAIN = "train"
    TEST = "test"
    ALL = "all"


def command(
    run: Annotated[Path, typer.Argument(help="A run folder.")],
    out: Annotated[Path, typer.Option(help="A folder that is not there yet.")],
    kind: Annotated[
        Format, typer.Option("--format", help="sharegpt: for LLaMA-Factory, with mask_history: true.")
    ] = Format.PARQUET,
    split: Annotated[Split, typer.Option(help="Whose tasks.")] = Split.TRAIN,
    outcome: Annotated[
        list[Outcome] | None,
        typer.Option(help="Attempts that ended so; may be repeated. By default all; for sharegpt success."),
    ] = None,
) -> None:
    """Write a row for every step: request, pictures, reply, tokens, outcome, reward (null if there is none).

    jsonl and sharegpt keep the pictures beside them, parquet in its rows, as the library datasets does.
    """
    console = Console(stderr=True)
    columns = TextColumn("{task.completed} attempts read")
    with Progress(columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        bar = shown.add_task("", total=None)
        done = export(
            run,
            out,
            kind.value,
            split=split.value,
            outcomes=frozenset(outcome) if outcome else None,
            progress=lambda read: shown.update(bar, completed=read),
        )
    typer.echo(f"{done.steps:,} steps of {done.attempts:,} attempts, {done.pictures:,} pictures: {out}")
    left = {
        "attempts at tasks of another split": done.other_split,
        "attempts of other outcomes": done.unrewarded,
        "steps that the format cannot hold": done.unusable,
    }
    if any(left.values()):
        typer.echo("left out: " + ", ".join(f"{count:,} {what}" for what, count in left.items() if count))
