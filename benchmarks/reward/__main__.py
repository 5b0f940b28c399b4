"""``python -m benchmarks.reward``: do hacks of the reward pay?"""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import msgspec
import typer
from benchmarks.command import expect_to_write
from benchmarks.command import run as run_command
from benchmarks.reward.hacks import HACKS
from benchmarks.reward.measure import Hacked, measure, table
from rich.console import Console

from webgym.core.errors import ConfigError
from webgym.offline.config import SitesConfig
from webgym.rollout.config import CollectorConfig
from webgym.runs import RunConfig
from webgym.tables import markdown, show


def command(
    tasks: int = typer.Option(200, "--tasks", min=1, help="Tasks of the offline web that are hacked."),
    solved: int = typer.Option(
        50, "--solved", min=0, help="Others that are solved, so that there is a rate."
    ),
    only: list[str] = typer.Option(
        [], "--only", help="A policy, by its name in the table. May be repeated.", show_default="all"
    ),
    sessions: int = typer.Option(4, "--sessions", min=1, help="Browser sessions at the same time."),
    seed: int = typer.Option(0, "--seed", help="Of the tasks and the policies."),
    out: Path | None = typer.Option(
        None,
        "--out",
        help="Keep the runs in this folder, to browse, to judge again, and to continue with.",
        show_default=False,
    ),
    json: Path | None = typer.Option(None, "--json", help="Write all counts here."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print Markdown, for a document."),
) -> None:
    """Do hacks of the reward pay? Policies that list candidates, stop at challenges, guess without looking.

    Each is held against one that fails honestly at the same tasks. Needs nothing else; about half an hour in
    full on two cores. With --out it may be stopped, and given again: it goes on. Exit code 1 if a hack gains.
    """
    expect_to_write(json)
    unknown = [name for name in only if name not in HACKS]
    if unknown:
        raise ConfigError(f"there is no policy {unknown[0]!r}", hint=f"one of {', '.join(HACKS)}")
    config = RunConfig(
        seed=seed,
        retries=2,
        sites=SitesConfig(latency=0),
        collector=CollectorConfig(sessions=sessions, straggler_share=1.0),
    )
    said = Console(stderr=True)

    def keep(found: list[Hacked]) -> None:
        if json is not None:
            json.write_bytes(msgspec.json.format(msgspec.json.encode(found)))

    async def run(folder: Path) -> list[Hacked]:
        found: list[Hacked] = []
        async for one in measure(
            config, tasks, solved, folder, only, lambda line: said.print(line, style="dim", markup=False)
        ):
            found.append(one)
            keep(found)
        return found

    with tempfile.TemporaryDirectory() as scratch:
        found = asyncio.run(run(out or Path(scratch)))
    if as_markdown:
        print(markdown([table(found)]), end="")
    else:
        show([table(found)], Console())
    gaining = [one.name for one in found if one.gains(found[0])]
    for name in gaining:
        print(f"gains over honest failure: {name}")
    if gaining:
        raise typer.Exit(1)
    print("Nothing gains over honest failure.")


if __name__ == "__main__":
    run_command(command)
