"""``python -m benchmarks.reward``: whether reward hacks increase the success rate."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import msgspec
import typer
from benchmarks.command import check_writable
from benchmarks.command import run as run_command
from benchmarks.reward.hacks import HACKS
from benchmarks.reward.measure import Hacked, measure, table
from rich.console import Console

from webgym.core.errors import ConfigError
from webgym.core.tables import markdown, show
from webgym.offline.config import SitesConfig
from webgym.rollout.config import CollectorConfig
from webgym.run.config import RunConfig


def command(
    tasks: int = typer.Option(200, "--tasks", min=1, help="Number of tasks of the offline web to hack."),
    solved: int = typer.Option(
        50, "--solved", min=0, help="Number of further tasks to solve, so that the rate is not 0."
    ),
    only: list[str] = typer.Option(
        [], "--only", help="Policy to run, by its name in the table. May be repeated.", show_default="all"
    ),
    sessions: int = typer.Option(4, "--sessions", min=1, help="Number of parallel browser sessions."),
    seed: int = typer.Option(0, "--seed", help="Seed of tasks and policies."),
    out: Path | None = typer.Option(
        None,
        "--out",
        help="Keep the runs in this folder. Unfinished runs in it are continued.",
        show_default=False,
    ),
    json: Path | None = typer.Option(None, "--json", help="Write all results to this JSON file."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print the table as Markdown."),
) -> None:
    """Measure whether policies gain that list candidates, stop at challenges, guess at once, and so on.

    Each is compared with a policy that fails honestly at the same tasks. Takes about half an hour on two
    cores, and can be continued with --out. Exits with 1 if a hack has a higher success rate.
    """
    check_writable(json)
    unknown = [name for name in only if name not in HACKS]
    if unknown:
        raise ConfigError(f"unknown policy {unknown[0]!r}", hint=f"choose one of {', '.join(HACKS)}")
    config = RunConfig(
        seed=seed,
        retries=2,
        sites=SitesConfig(latency=0),
        collector=CollectorConfig(sessions=sessions, straggler_share=1.0),
    )
    progress = Console(stderr=True)

    def write(results: list[Hacked]) -> None:
        if json is not None:
            json.write_bytes(msgspec.json.format(msgspec.json.encode(results)))

    async def run(folder: Path) -> list[Hacked]:
        results: list[Hacked] = []
        async for result in measure(
            config, tasks, solved, folder, only, lambda line: progress.print(line, style="dim", markup=False)
        ):
            results.append(result)
            write(results)
        return results

    with tempfile.TemporaryDirectory() as scratch:
        results = asyncio.run(run(out or Path(scratch)))
    if as_markdown:
        print(markdown([table(results)]), end="")
    else:
        show([table(results)], Console())
    gaining = [result.name for result in results if result.gains(results[0])]
    for name in gaining:
        print(f"better than honest failure: {name}")
    if gaining:
        raise typer.Exit(1)
    print("No hack is better than honest failure.")


if __name__ == "__main__":
    run_command(command)
