"""``webgym sites``: serve, list and check the websites of the offline web."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.cli._fields import Given, Option, takes
from webgym.cli._options import web_options
from webgym.core.errors import ConfigError

if TYPE_CHECKING:
    from webgym.offline.config import SitesConfig
    from webgym.offline.web import OfflineWeb, Spec

_PORT = 8123

app = typer.Typer(no_args_is_help=True, help="Serve, list and check the websites of the offline web.")


@app.command()
@takes(
    settings=web_options(
        "seed",
        "collection",
        "per_family",
        host="host",
        port=Option("port", default=str(_PORT)),
        latency="latency",
    )
)
def serve(settings: Given) -> None:
    """Serve the offline web until Ctrl-C, and print how browsers reach it.

    The token of the administration API is read from WEBGYM_SITES_TOKEN; without it, a random one is printed.
    """
    import asyncio
    import os

    from webgym.cli._run import run
    from webgym.core.settings import validated
    from webgym.offline.app import serving
    from webgym.offline.config import SitesConfig
    from webgym.run.config import SITES_TOKEN

    token = os.environ.get(SITES_TOKEN) or None
    config = validated(SitesConfig, {"port": _PORT, "token": token} | settings)

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
@takes(settings=web_options("seed", "collection"))
def list_sites(
    settings: Given,
    family: str | None = typer.Option(
        None, "--family", help="Only websites of this family.", show_default=False
    ),
) -> None:
    """List the websites: address, family, split and behaviour."""
    from webgym.core.settings import validated
    from webgym.offline.config import SitesConfig

    _, chosen = _websites(validated(SitesConfig, settings), family)
    for host, spec in chosen.items():
        print(f"http://{host}/  {spec.family.family}  {spec.split}  {spec.behaviour}")


def _websites(config: SitesConfig, family: str | None) -> tuple[OfflineWeb, dict[str, Spec]]:
    """The offline web, and its websites of a family, or all of them.

    Raises:
        ConfigError: there is no such family.
    """
    from webgym.offline.web import OfflineWeb

    web = OfflineWeb(config.seed, per_family=config.per_family, collection=config.collection)
    chosen = {host: spec for host, spec in web.specs.items() if family in (None, spec.family.family)}
    if not chosen:
        listed = f"webgym sites list --collection {config.collection}"
        raise ConfigError(f"unknown family {family!r}", hint=f"{listed} shows the families")
    return web, chosen


@app.command()
@takes(settings=web_options("collection", latency=Option("latency", default="0")))
def check(
    settings: Given,
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
    marks: bool = typer.Option(False, "--marks", help="Use Set-of-Marks instead of coordinates."),
    quick: bool = typer.Option(False, "--quick", help="Only checks that need no browser."),
    seed: int = typer.Option(0, "--seed", help="Seed of the sample."),
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

    from webgym.cli._print import say
    from webgym.cli._run import lasting_console, run, show_progress_on
    from webgym.core.settings import validated
    from webgym.offline.config import SitesConfig
    from webgym.tasks.sampling import draw
    from webgym.testing.solutions import Checked, check_in_browsers, typed

    if shard >= shards:
        raise ConfigError(f"there is no part {shard} of {shards}: they count from 0")
    console = lasting_console()
    config = validated(SitesConfig, {"latency": 0} | settings)
    web, chosen = _websites(config, family)
    hosts = [host for host in chosen if crc32(host.encode()) % shards == shard]
    if not hosts:
        raise ConfigError(f"part {shard} of {shards} has no website", hint="give fewer parts")
    tasks = [task for host in hosts for task in web.tasks_of(host)]
    tasks = draw(tasks, sample, seed)
    if quick:
        failures = list(typed(web, tasks))
    else:
        with tempfile.TemporaryDirectory(prefix="webgym-check-") as scratch:
            failures = run(
                lambda: check_in_browsers(
                    web,
                    tasks,
                    out or Path(scratch) / "run",
                    mode="marks" if marks else "coordinates",
                    sessions=sessions,
                    latency=config.latency,
                    show=show_progress_on(console),
                ),
                kept="" if out is None else "the attempts so far are stored",
            )
    say(Checked([task.id for task in tasks], failures), console)
    if failures:
        raise typer.Exit(1)
