"""``webgym tasks offline``: write the tasks of the offline web to a file."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.cli._options import Collection


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
