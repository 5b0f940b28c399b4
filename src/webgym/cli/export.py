"""``webgym export``: write the steps of a run, or tasks, for other programs."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, TextColumn

from webgym.cli.tasks._files import read_all
from webgym.core.errors import UsageError
from webgym.core.outcome import Outcome
from webgym.offline.config import collection_of
from webgym.results.export import export
from webgym.results.summary import oracle_notes
from webgym.store.files import make_folder, refuse_used
from webgym.tasks.formats import write_tasks
from webgym.tasks.split import leaking


class Format(StrEnum):
    """The format of the files."""

    JSONL = "jsonl"
    PARQUET = "parquet"
    SHAREGPT = "sharegpt"


class Split(StrEnum):
    """The split of the tasks."""

    TRAIN = "train"
    TEST = "test"
    ALL = "all"


def command(
    source: Annotated[
        Path,
        typer.Argument(
            help="A run folder, a task file or a folder of them, or the name of tasks, such as offline-v2."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to make.")],
    kind: Annotated[
        Format,
        typer.Option(
            "--format",
            help="Format of the files; sharegpt is for LLaMA-Factory, with its settings in train.yaml.",
        ),
    ] = Format.PARQUET,
    split: Annotated[
        Split, typer.Option(help="Only attempts at tasks of this split, or tasks of it.")
    ] = Split.TRAIN,
    outcome: Annotated[
        list[Outcome] | None,
        typer.Option(
            help="Only attempts with this outcome. May be repeated.", show_default="all; success for sharegpt"
        ),
    ] = None,
) -> None:
    """Write a row for every step: request, pictures, reply, tokens, outcome, reward (null if there is none).

    jsonl and sharegpt write pictures as files next to their own, parquet in its rows, as the library datasets
    does. Tasks are written as a row each, to tasks.parquet or tasks.jsonl.
    """
    if collection_of(str(source)) or source.is_file() or _has_tasks(source):
        if kind is Format.SHAREGPT or outcome:
            raise UsageError(
                "tasks have no replies and no outcomes",
                hint="export a run, or leave out sharegpt and --outcome",
            )
        _export_tasks(source, out, kind, split)
        return
    console = Console(stderr=True)
    columns = TextColumn("{task.completed} attempts read")
    with Progress(columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("", total=None)
        result = export(
            source,
            out,
            kind.value,
            split=split.value,
            outcomes=frozenset(outcome) if outcome else None,
            progress=lambda count: progress.update(bar, completed=count),
        )
    typer.echo(f"{result.steps:,} steps of {result.attempts:,} attempts, {result.pictures:,} pictures: {out}")
    for note in oracle_notes(sorted(result.policies)):
        typer.echo(note)
    left_out = {
        "attempts at tasks of another split": result.other_split,
        "attempts with other outcomes": result.unrewarded,
        "steps that the format cannot represent": result.unusable,
    }
    if any(left_out.values()):
        typer.echo("left out: " + ", ".join(f"{count:,} {what}" for what, count in left_out.items() if count))


def _has_tasks(folder: Path) -> bool:
    names = ("tasks.*", "train*.*", "test*.*")
    return not (folder / "trajectories").exists() and any(any(folder.glob(name)) for name in names)


def _export_tasks(source: Path, out: Path, kind: Format, split: Split) -> None:
    records = read_all([source])
    leaks = leaking(records.tasks) if split is Split.TRAIN else {}
    chosen = [task for task in records.tasks if split is Split.ALL or task.split == split.value]
    tasks = [task for task in chosen if task.id not in leaks]
    if chosen and not tasks:
        raise UsageError(
            f"all {len(chosen):,} training tasks of {source} share websites or families with its test tasks",
            hint="webgym tasks split makes a split without leaks",
        )
    if not tasks:
        held = Counter(task.split or "unsplit" for task in records.tasks)
        splits = ", ".join(f"{count:,} {name}" for name, count in held.items()) or "none that can be judged"
        raise UsageError(
            f"{source} has no task of the split {split.value!r}; it holds {splits}",
            hint="choose with --split train, test or all",
        )
    make_folder(out)
    refuse_used(out)
    file = out / f"tasks.{kind.value}"
    typer.echo(f"{write_tasks(file, tasks):,} tasks: {file}")
    left_out = {
        "tasks of another split": len(records.tasks) - len(chosen),
        "tasks that share a website or family with test tasks": len(chosen) - len(tasks),
    }
    if any(left_out.values()):
        typer.echo("left out: " + ", ".join(f"{count:,} {what}" for what, count in left_out.items() if count))
    records.print_left_out()
