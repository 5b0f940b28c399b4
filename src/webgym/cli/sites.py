"""``webgym sites``: the offline web."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Collection

    from rich.console import Console


app = typer.Typer(no_args_is_help=True, help="Serve, list and check the websites of the offline web.")


@app.command()
def serve(
    host: str = typer.Option("127.0.0.1", "--host", help="Address to listen on."),
    port: int = typer.Option(8123, "--port", min=0, max=65535, help="Port; 0 takes a free one."),
    seed: int | None = typer.Option(None, "--seed", help="Seed of every website.", show_default="7"),
    collection: str = typer.Option(
        "large", "--collection", help="large or small websites, or cross: tasks about two of the large ones."
    ),
    per_family: int | None = typer.Option(
        None, "--per-family", min=1, help="Websites per family.", show_default="50 large, 72 small"
    ),
    latency: float = typer.Option(1.0, "--latency", min=0, help="Scale of simulated latency; 0 for none."),
) -> None:
    """Serve the offline web until Ctrl-C, and say how a browser gets there.

    The token of its administration is taken from WEBGYM_SITES_TOKEN, or made up and printed.
    """
    import asyncio
    import os

    from pydantic import SecretStr

    from webgym.cli._run import SITES_TOKEN, run
    from webgym.offline.app import serving
    from webgym.offline.config import DEFAULT_SEED, SitesConfig
    from webgym.offline.web import collection_name

    given = os.environ.get(SITES_TOKEN)
    config = SitesConfig(
        host=host,
        port=port,
        seed=DEFAULT_SEED if seed is None else seed,
        collection=collection_name(collection),
        per_family=per_family,
        latency=latency,
        token=SecretStr(given) if given else None,
    )

    async def forever() -> None:
        async with serving(config) as sites:
            rules = " ".join(f"--allow-host '{rule}'" for rule in sites.allowed_hosts)
            first = next(iter(sites.web.specs))
            print(f"{len(sites.web.specs)} websites at {sites.address}", flush=True)
            if not given:
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
    family: str | None = typer.Option(None, "--family", help="Only of this family.", show_default=False),
    seed: int | None = typer.Option(None, "--seed", help="Seed of every website.", show_default="7"),
    collection: str = typer.Option(
        "large", "--collection", help="large or small websites, or cross: tasks about two of the large ones."
    ),
) -> None:
    """List the websites: address, family, split and behaviour."""
    from webgym.offline.config import DEFAULT_SEED
    from webgym.offline.web import OfflineWeb, collection_name

    web = OfflineWeb(DEFAULT_SEED if seed is None else seed, collection=collection_name(collection))
    for host, spec in web.specs.items():
        if family in (None, spec.family.family):
            print(f"http://{host}/  {spec.family.family}  {spec.split}  {spec.behaviour}")


def _report(console: Console, surprises: list[str], tasks: Collection[str]) -> None:
    """Print what is not as it should be; exit with 1 if there is anything."""
    for surprise in surprises:
        console.print(surprise, highlight=False, markup=False, soft_wrap=True)
    failed = {surprise.partition(": ")[0] for surprise in surprises} & set(tasks)
    right = len(tasks) - len(failed)
    console.print(f"{right} of {len(tasks)} tasks are as they should be", highlight=False)
    if surprises:
        raise typer.Exit(1)


@app.command()
def check(
    out: Path | None = typer.Option(None, "--out", help="Keep the run in this folder.", show_default=False),
    family: str | None = typer.Option(None, "--family", help="Only of this family.", show_default=False),
    sample: int | None = typer.Option(
        None, "--sample", min=1, help="So many tasks; else all.", show_default=False
    ),
    sessions: int = typer.Option(12, "--sessions", min=1, help="Browser sessions at the same time."),
    latency: float = typer.Option(0.0, "--latency", min=0, help="Scale of simulated latency; 0 for none."),
    marks: bool = typer.Option(False, "--marks", help="Set-of-Marks instead of coordinates."),
    quick: bool = typer.Option(False, "--quick", help="Without browsers: only what needs none."),
    seed: int = typer.Option(0, "--seed", help="Seed of the sample."),
    collection: str = typer.Option(
        "large", "--collection", help="large or small websites, or cross: tasks about two of the large ones."
    ),
) -> None:
    """Prove in real browsers that tasks are solvable, and by nothing less than a solution.

    Plays every solution. A task passes if its attempt ends as its website lets it end: in success where
    the website behaves, within the step budget; and if the same attempt with a wrong answer, with the
    right answer but without the evidence, or with nothing at all does not pass the judge. Evidence that
    a page cuts off, and evidence that typing would bring about (no browser is needed to find that), fail
    a task as well. Exits with 1 if any task fails, and names each.
    """
    import tempfile

    from rich.console import Console

    from webgym.cli._run import print_notes_on, run, show_progress_on
    from webgym.core.errors import ConfigError
    from webgym.offline.web import OfflineWeb, collection_name
    from webgym.tasks.sampling import draw
    from webgym.validation import check_in_browsers, typed

    console = Console()
    web = OfflineWeb(collection=collection_name(collection))
    tasks = [
        task
        for host, spec in web.specs.items()
        if family in (None, spec.family.family)
        for task in web.tasks_of(host)
    ]
    if not tasks:
        raise ConfigError(f"unknown family {family!r}", hint="webgym sites list shows the families")
    tasks = draw(tasks, sample, seed)
    surprises = list(typed(web, tasks))
    if quick:
        _report(console, surprises, [task.id for task in tasks])
        return
    with tempfile.TemporaryDirectory(prefix="webgym-check-") as scratch:
        checked = run(
            lambda: check_in_browsers(
                web,
                tasks,
                out or Path(scratch) / "run",
                mode="marks" if marks else "coordinates",
                sessions=sessions,
                latency=latency,
                show=show_progress_on(console),
                tell=print_notes_on(console),
            )
        )
    _report(console, [*surprises, *checked], [task.id for task in tasks])
