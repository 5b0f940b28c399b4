"""``webgym tasks show``."""

from __future__ import annotations

from pathlib import Path

import typer


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
