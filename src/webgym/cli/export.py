"""``webgym export``: a run's steps, or tasks, for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, TextColumn

from webgym.cli.tasks._files import Held, read_all
from webgym.core.errors import RunFolderError, UsageError
from webgym.core.outcome import Outcome
from webgym.environment import COLLECTIONS, config_of
from webgym.rollout.export import export
from webgym.rollout.files import make_folder
from webgym.task_choice import all_tasks
from webgym.tasks.formats import write_tasks


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
    source: Annotated[
        Path,
        typer.Argument(
            help="A run folder; a task file, or a folder of them; or the name of tasks, such as offline-v1."
        ),
    ],
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

    jsonl and sharegpt keep the pictures beside them, parquet in its rows, as the library datasets does. Of
    tasks it is a row for each: tasks.parquet or tasks.jsonl.
    """
    if str(source) in COLLECTIONS or source.is_file() or _holds_tasks(source):
        if kind is Format.SHAREGPT or outcome:
            raise UsageError("tasks have no replies and no outcomes", hint="export a run, or leave it out")
        _export_tasks(source, out, kind, split)
        return
    console = Console(stderr=True)
    columns = TextColumn("{task.completed} attempts read")
    with Progress(columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        bar = shown.add_task("", total=None)
        done = export(
            source,
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


def _holds_tasks(folder: Path) -> bool:
    names = ("tasks.*", "train*.*", "test*.*")
    return not (folder / "trajectories").exists() and any(any(folder.glob(name)) for name in names)


def _export_tasks(source: Path, out: Path, kind: Format, split: Split) -> None:
    name = str(source)
    held = (
        Held(all_tasks(config_of(name, "all"), typer.echo), [], [])
        if name in COLLECTIONS
        else read_all([source])
    )
    tasks = [task for task in held.tasks if split is Split.ALL or task.split == split.value]
    make_folder(out)
    if any(out.iterdir()):
        raise RunFolderError(f"{out} is not empty", hint="choose another folder")
    file = out / f"tasks.{kind.value}"
    typer.echo(f"{write_tasks(file, tasks):,} tasks: {file}")
    if len(tasks) < len(held.tasks):
        typer.echo(f"left out: {len(held.tasks) - len(tasks):,} tasks of another split")
    held.tell_left_out()
