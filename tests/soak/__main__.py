"""``python -m tests.soak``: a real server under random faults, and whether anything is lost or left."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec
import typer
import uvloop
from benchmarks.command import check_writable, run
from rich.console import Console
from tests.soak.run import soak
from tests.soak.target import SoakPlan

SIZE = SoakPlan()


def command(
    minutes: float = typer.Option(
        5.0, "--minutes", min=0.05, help="Duration of clients and faults, minutes."
    ),
    seed: int = typer.Option(0, "--seed", help="Seed of all random choices; their effects depend on timing."),
    clients: int = typer.Option(SIZE.clients, "--clients", min=1, help="Number of parallel clients."),
    slots: int = typer.Option(
        SIZE.slots, "--slots", min=1, help="Parallel sessions of all workers together."
    ),
    workers: int = typer.Option(SIZE.workers, "--workers", min=1, help="Worker processes of the gateway."),
    faults: float = typer.Option(SIZE.faults, "--faults", min=0.1, help="Mean number of faults per minute."),
    hostile: float = typer.Option(
        SIZE.hostile, "--hostile", min=0.0, max=1.0, help="Share of the pages that are hostile."
    ),
    log: str = typer.Option(os.devnull, "--log", help="Append the server's log to this file."),
) -> None:
    """Run a server under random faults, with clients on calm and hostile pages, and check that nothing leaks.

    Kills and stops browsers, renderers, GPU processes, workers and the gateway, fills the disk (as root), and
    drops clients. Afterwards every session must be accounted for, every error must have a type, every slot
    must serve again, and no process, lease, file, profile or descriptor may be left. Exits with 1 if not.

    Starts its own server and pages, and touches no processes but its own. Prints the counts as JSON.
    """
    check_writable(Path(log))
    logging.basicConfig(level=logging.CRITICAL, format="%(levelname)s %(message)s")
    plan = SoakPlan(
        seconds=minutes * 60,
        seed=seed,
        clients=clients,
        slots=slots,
        workers=workers,
        faults=faults,
        hostile=hostile,
    )
    result = uvloop.run(soak(plan, Console(stderr=True, highlight=False).print, Path(log)))
    print(msgspec.json.format(msgspec.json.encode(result)).decode())
    for problem in result.problems:
        print(f"problem: {problem}")
    if result.problems:
        raise typer.Exit(1)
    print("No problems: every session is accounted for, and nothing is left.")


if __name__ == "__main__":
    run(command)
