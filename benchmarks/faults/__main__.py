"""``python -m benchmarks.faults``: whether faults change rewards."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import typer
from benchmarks.command import run as run_command
from benchmarks.faults.campaign import KINDS, Campaign, differing, rows, run
from benchmarks.reward.measure import choose
from rich.console import Console

from webgym.core.errors import ConfigError
from webgym.core.tables import Table, show
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb


def command(
    tasks: int = typer.Option(300, "--tasks", min=1, help="Number of tasks of the offline web."),
    minutes: float = typer.Option(60.0, "--minutes", min=0, help="No fault is caused after this time."),
    faults: float = typer.Option(12.0, "--faults", min=0.1, help="Mean number of faults per minute."),
    only: list[str] = typer.Option(
        [], "--only", help=f"Kind of fault: {', '.join(KINDS)}. May be repeated.", show_default="all"
    ),
    sessions: int = typer.Option(2, "--sessions", min=1, help="Number of parallel browser sessions."),
    per_family: int = typer.Option(10, "--per-family", min=1, help="Number of websites per family."),
    seed: int = typer.Option(0, "--seed", help="Seed of tasks, policy and faults."),
    out: Path | None = typer.Option(
        None, "--out", help="Keep the runs in this new folder.", show_default=False
    ),
) -> None:
    """Compare the rewards of a run under random faults with those of the same run without them.

    A scripted policy is right at about half of the tasks, the same half in both runs. Renderers, browsers,
    workers, the server, the collector and the offline web are killed and started again; the policy's and the
    judge's endpoints fail for moments. Exits with 1 if a rewarded sample has another reward than without
    faults. The default size takes about an hour on two cores.
    """
    if unknown := [kind for kind in only if kind not in KINDS]:
        raise ConfigError(f"unknown kind of fault {unknown[0]!r}", hint=f"choose one of {', '.join(KINDS)}")
    campaign = Campaign(
        seed=seed,
        kinds=tuple(only) or KINDS,
        per_minute=faults,
        seconds=minutes * 60,
        sessions=sessions,
        per_family=per_family,
    )
    web = OfflineWeb(SitesConfig().seed, per_family=per_family)
    chosen, _ = choose(web, tasks, 0, seed)

    async def both(folder: Path) -> list[str]:
        console = Console(stderr=True)
        console.print(f"{len(chosen)} tasks without faults", style="dim")
        quiet = Campaign(seed=seed, kinds=(), sessions=sessions, per_family=per_family)
        twin = await run(quiet, chosen, folder / "without")
        console.print(f"{len(chosen)} tasks under faults", style="dim")
        ran = await run(campaign, chosen, folder / "under")
        columns = ("", "under faults", "without")
        show([Table("Attempts by outcome, and rewards of samples", columns, rows(ran, twin))], Console())
        return differing(ran, twin)

    with tempfile.TemporaryDirectory() as scratch:
        lines = asyncio.run(both(out or Path(scratch)))
    for line in lines:
        print(f"another reward: {line}")
    if lines:
        raise typer.Exit(1)
    print("No rewarded sample has another reward than without faults.")


if __name__ == "__main__":
    run_command(command)
