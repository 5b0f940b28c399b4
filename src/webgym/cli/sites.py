"""``webgym sites``: serve, list and check the websites of the offline web."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.cli._options import Collection
from webgym.core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console


app = typer.Typer(no_args_is_help=True, help="Serve, list and check the websites of the offline web.")


@app.command()
def serve(
    host: str = typer.Option("127.0.0.1", "--host", help="Address to listen on."),
    port: int = typer.Option(8123, "--port", min=0, max=65535, help="Port to listen on; 0 for a free one."),
    seed: int | None = typer.Option(None, "--seed", help="Seed of all websites.", show_default="7"),
    collection: Collection = "large",
    per_family: int | None = typer.Option(
        None, "--per-family", min=1, help="Number of websites per family.", show_default="50 large, 72 small"
    ),
    latency: float = typer.Option(
        1.0, "--latency", min=0, max=100, help="Factor of the simulated latency; 0 for none."
    ),
) -> None:
    """Serve the offline web until Ctrl-C, and print how browsers reach it.

    The token of the administration API is read from WEBGYM_SITES_TOKEN; without it, a random one is printed.
    """
    import asyncio
    import os

    from pydantic import SecretStr

    from webgym.cli._run import run
    from webgym.offline.app import serving
    from webgym.offline.config import DEFAULT_SEED, SitesConfig
    from webgym.offline.web import collection_name
    from webgym.run.config import SITES_TOKEN

    token = os.environ.get(SITES_TOKEN)
    config = SitesConfig(
        host=host,
        port=port,
        seed=DEFAULT_SEED if seed is None else seed,
        collection=collection_name(collection),
        per_family=per_family,
        latency=latency,
        token=SecretStr(token) if token else None,
    )

    async def forever() -> None:
        async with serving(config) as sites:
            rules = " ".join(f"--allow-host '{rule}'" for rule in sites.allowed_hosts)
            first = next(iter(sites.web.specs))
            print(f"{len(sites.web.specs)} websites at {sites.address}", flush=True)
            if not token:
                print(f"token    {sites.token}")
            print(
                f"browse   chromium --host-resolver-rules='MAP *.webgym.test {sites.address}' http://{first}/"
            )
            print(f"browsers webgym serve {rules}")
            print("list     webgym sites list", flush=True)
            await asyncio.Event().wait()

    run(forever)


@app.command("list")
def list_sites(
    family: str | None = typer.Option(
        None, "--family", help="Only websites of this family.", show_default=False
    ),
    seed: int | None = typer.Option(None, "--seed", help="Seed of all websites.", show_default="7"),
    collection: Collection = "large",
) -> None:
    """List the websites: address, family, split and behaviour."""
    from webgym.offline.config import DEFAULT_SEED
    from webgym.offline.web import OfflineWeb, collection_name

    web = OfflineWeb(DEFAULT_SEED if seed is None else seed, collection=collection_name(collection))
    listed = [(host, spec) for host, spec in web.specs.items() if family in (None, spec.family.family)]
    if not listed:
        raise _unknown_family(family, collection)
    for host, spec in listed:
        print(f"http://{host}/  {spec.family.family}  {spec.split}  {spec.behaviour}")


def _unknown_family(family: str | None, collection: str) -> ConfigError:
    return ConfigError(
        f"unknown family {family!r}", hint=f"webgym sites list --collection {collection} shows the families"
    )


def _report(console: Console, failures: list[str], tasks: Sequence[str]) -> None:
    """Print the failures and the number of tasks that passed; exit with 1 if there are failures."""
    for failure in failures:
        console.print(failure, highlight=False, markup=False, soft_wrap=True)
    failed = {failure.partition(": ")[0] for failure in failures} & set(tasks)
    console.print(f"{len(tasks) - len(failed)} of {len(tasks)} tasks passed", highlight=False)
    if failures:
        raise typer.Exit(1)


@app.command()
def check(
    out: Path | None = typer.Option(
        None,
        "--out",
        help="Keep the attempts in this run folder; one that holds a check of these tasks is resumed.",
        show_default=False,
    ),
    shard: int = typer.Option(0, "--shard", min=0, help="Part of the tasks to play, from 0."),
    shards: int = typer.Option(1, "--shards", min=1, help="Number of parts, each with a folder of its own."),
    family: str | None = typer.Option(
        None, "--family", help="Only websites of this family.", show_default=False
    ),
    sample: int | None = typer.Option(
        None, "--sample", min=1, help="Number of tasks to check.", show_default="all"
    ),
    sessions: int = typer.Option(12, "--sessions", min=1, help="Number of browsers."),
    latency: float = typer.Option(
        0.0, "--latency", min=0, max=100, help="Factor of the simulated latency; 0 for none."
    ),
    marks: bool = typer.Option(False, "--marks", help="Use Set-of-Marks instead of coordinates."),
    quick: bool = typer.Option(False, "--quick", help="Only checks that need no browser."),
    seed: int = typer.Option(0, "--seed", help="Seed of the sample."),
    collection: Collection = "large",
) -> None:
    """Check in real browsers that every task can be solved, and that only a solution passes the judge.

    Carries out every solution. A task passes if its attempt has the outcome that its website allows (success
    within the step budget on a website that works) and if the judge rejects the same attempt with a wrong
    answer, with the right answer but without evidence, and without any action. Evidence that a page cuts off,
    and evidence that appears because it is typed (which needs no browser to check), fail a task as well.
    Exits with 1 if a task fails, and lists all that do. With a folder, a check that was stopped goes on where
    it was, and webgym view shows its attempts.
    """
    import tempfile
    from zlib import crc32

    from webgym.cli._run import lasting_console, run, show_progress_on
    from webgym.offline.web import OfflineWeb, collection_name
    from webgym.tasks.sampling import draw
    from webgym.testing.solutions import check_in_browsers, typed

    if shard >= shards:
        raise ConfigError(f"there is no part {shard} of {shards}: they count from 0")
    console = lasting_console()
    web = OfflineWeb(collection=collection_name(collection))
    tasks = [
        task
        for host, spec in web.specs.items()
        if family in (None, spec.family.family) and crc32(host.encode()) % shards == shard
        for task in web.tasks_of(host)
    ]
    if not tasks and shards > 1:
        raise ConfigError(f"part {shard} of {shards} has no website", hint="give fewer parts")
    if not tasks:
        raise _unknown_family(family, collection)
    tasks = draw(tasks, sample, seed)
    if quick:
        _report(console, list(typed(web, tasks)), [task.id for task in tasks])
        return
    with tempfile.TemporaryDirectory(prefix="webgym-check-") as scratch:
        failures = run(
            lambda: check_in_browsers(
                web,
                tasks,
                out or Path(scratch) / "run",
                mode="marks" if marks else "coordinates",
                sessions=sessions,
                latency=latency,
                show=show_progress_on(console),
            ),
            kept="" if out is None else "the attempts so far are stored",
        )
    _report(console, failures, [task.id for task in tasks])
