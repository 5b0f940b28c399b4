"""``webgym export``: write the steps of a run, or tasks, for other programs."""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from webgym.cli._checks import check_folder
from webgym.cli._print import bars
from webgym.cli._push import Public, PushTo, push_folder, steps_card, target, tasks_card
from webgym.cli.tasks._files import has_tasks, read_all
from webgym.core.errors import UsageError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.offline.config import collection_of
from webgym.results.export import export, left_out_line
from webgym.store.files import make_folder, refuse_used
from webgym.tasks.formats import write_tasks
from webgym.tasks.hub import address_of
from webgym.tasks.split import leaking

Format: TypeAlias = Literal["jsonl", "parquet", "sharegpt"]
Split: TypeAlias = Literal["train", "test", "all"]


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
    ] = "parquet",
    split: Annotated[
        Split, typer.Option(help="Only attempts at tasks of this split, or tasks of it.")
    ] = "train",
    outcome: Annotated[
        list[Outcome] | None,
        typer.Option(
            help="Only attempts with this outcome. May be repeated.", show_default="all; success for sharegpt"
        ),
    ] = None,
    push: PushTo = None,
    public: Public = False,
) -> None:
    """Write a row for every step: request, pictures, reply, tokens, outcome, reward (null if there is none).

    jsonl and sharegpt write pictures as files next to their own, parquet in its rows, as the library datasets
    does. Tasks are written as a row each, to tasks.parquet or tasks.jsonl.
    """
    check_folder(out)
    to = None if push is None else target(push)
    if collection_of(str(source)) or address_of(source) or (source.exists() and has_tasks(source)):
        if kind == "sharegpt" or outcome:
            raise UsageError(
                "tasks have no replies and no outcomes",
                hint="export a run, or leave out sharegpt and --outcome",
            )
        tasks = _export_tasks(source, out, kind, split)
        if to is not None:
            push_folder(out, to, tasks_card(tasks, {}), is_public=public)
        return
    with bars() as advance:
        result = export(
            source,
            out,
            kind,
            split=split,
            outcomes=frozenset(outcome) if outcome else None,
            progress=partial(advance, "attempts"),
        )
    print(result)
    if to is not None:
        push_folder(out, to, steps_card(source, result, kind), is_public=public)


def _export_tasks(source: Path, out: Path, kind: Format, split: Split) -> list[Task]:
    records = read_all([source])
    leaks = leaking(records.tasks) if split == "train" else {}
    chosen = [task for task in records.tasks if split == "all" or task.split == split]
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
            f"{source} has no task of the split {split!r}; it holds {splits}",
            hint="choose with --split train, test or all",
        )
    make_folder(out)
    refuse_used(out)
    file = out / f"tasks.{kind}"
    print(f"{write_tasks(file, tasks):,} tasks: {file}")
    left_out = {
        "tasks of another split": len(records.tasks) - len(chosen),
        "tasks that share a website or family with test tasks": len(chosen) - len(tasks),
    }
    for line in left_out_line(left_out):
        print(line)
    records.print_left_out()
    return tasks
