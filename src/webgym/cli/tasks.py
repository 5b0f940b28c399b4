"""``webgym tasks``: task sets as files."""

from __future__ import annotations

from pathlib import Path

import typer

app = typer.Typer(no_args_is_help=True, help="List, check and write task sets.")


@app.command()
def offline(
    out: Path = typer.Option(..., "--out", help="Task file to write (JSON lines)."),
    split: str | None = typer.Option(
        None, "--split", help="train or test; both if not given.", show_default=False
    ),
    seed: int | None = typer.Option(None, "--seed", help="Of the offline web.", show_default="7"),
    per_family: int | None = typer.Option(
        None, "--per-family", min=1, help="Websites per family.", show_default="50"
    ),
) -> None:
    """Write the offline web's tasks to a file, with their hidden truths."""
    from webgym.core.errors import ConfigError
    from webgym.offline import OfflineWeb
    from webgym.offline.web import DEFAULT_SEED, WEBSITES_PER_FAMILY
    from webgym.tasks import write_tasks

    if split not in (None, "train", "test"):
        raise ConfigError(f"there is no split {split!r}", hint="give train or test")
    web = OfflineWeb(DEFAULT_SEED if seed is None else seed, per_family=per_family or WEBSITES_PER_FAMILY)
    count = write_tasks(out, web.tasks(split))  # type: ignore[arg-type]
    print(f"{count} tasks written to {out}")


@app.command()
def check(file: Path = typer.Argument(..., help="Task file.")) -> None:
    """Say what a task file holds, and which of its records are broken. Fails if any is."""
    from collections import Counter

    from rich.console import Console
    from rich.table import Table

    from webgym.core.task import LEVELS
    from webgym.tasks import read_tasks

    found = read_tasks(file)
    console = Console()
    table = Table(box=None, header_style="dim")
    table.add_column("domain")
    table.add_column("subdomain")
    for level in LEVELS:
        table.add_column(level, justify="right")
    counts = Counter((task.domain, task.subdomain, task.level) for task in found.tasks)
    for domain, subdomain in sorted({key[:2] for key in counts}):
        table.add_row(domain, subdomain, *(str(counts[domain, subdomain, level]) for level in LEVELS))
    console.print(table)
    websites = len({task.website for task in found.tasks})
    console.print(f"{len(found.tasks)} tasks on {websites} websites, {len(found.broken)} broken records")
    for record in found.broken:
        console.print(str(record), highlight=False, markup=False, soft_wrap=True)
    if found.broken:
        raise typer.Exit(1)


@app.command()
def show(
    file: Path = typer.Argument(..., help="Task file."),
    task_id: str = typer.Argument(..., help="Id of the task."),
) -> None:
    """Print one task: instruction, rubric and, where it is known, the truth."""
    from rich.console import Console

    from webgym.core.errors import UsageError
    from webgym.tasks import read_tasks

    task = next((task for task in read_tasks(file).tasks if task.id == task_id), None)
    if task is None:
        raise UsageError(
            f"there is no task {task_id!r} in {file}", hint="webgym tasks check lists what it holds"
        )
    console = Console()
    console.print(f"[bold]{task.id}[/]  {task.level}, difficulty {task.difficulty}", highlight=False)
    console.print(f"[dim]{task.domain} / {task.subdomain} · {task.website}[/]\n", highlight=False)
    console.print(task.instruction, highlight=False, markup=False)
    for group in task.rubric.groups:
        console.print(f"\n{group.id}. {group.description}", highlight=False, markup=False)
        for fact in group.facts:
            console.print(f"   - {fact}", highlight=False, markup=False)
    if task.reference_answer is not None:
        console.print(f"\nreference answer: {task.reference_answer}", highlight=False, markup=False)
    if task.truth is not None:
        console.print("\nsolution", style="dim")
        for move in task.truth.moves:
            console.print(f"   {move!r}", highlight=False, markup=False)
