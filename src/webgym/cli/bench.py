"""``webgym bench``: measure this machine. Every sub-verb is thin; the work is in ``webgym.bench``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

import typer

from webgym.core.errors import ConfigError

if TYPE_CHECKING:
    from webgym.bench.rollout.plan import PageLatency

HELP = """Measure this machine: figures of one run, as ratios.

What measures this code and not the machine stays in the repository: python -m benchmarks.settle, .task_set
and .reward.
"""

app = typer.Typer(no_args_is_help=True, help=HELP)


@app.callback()
def _bench() -> None:
    pass


def _expect_to_write(file: Path | None) -> None:
    """Say now, not after the measurement, that there is no place for its figures.

    Raises:
        ConfigError: the file's folder is not there.
    """
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"{file} cannot be written", hint="give a file in a folder that exists")


def _expect_known(kind: str, given: Sequence[str], known: Sequence[str]) -> None:
    """Refuse a choice that there is not.

    Raises:
        ConfigError: one of those given is not known.
    """
    if unknown := [one for one in given if one not in known]:
        raise ConfigError(f"unknown {kind} {unknown[0]!r}", hint=f"one of {'; '.join(known)}")


@app.command()
def server(
    only: list[str] = typer.Option(
        [], "--only", help="ceiling, costs, thinking, burst or density. May be repeated.", show_default="all"
    ),
    sessions: int = typer.Option(32, "--sessions", min=1, help="Sessions against the ceiling."),
    rounds: int = typer.Option(5, "--rounds", min=1, help="Rounds of the bare loop and the server, in turn."),
    seconds: float = typer.Option(6.0, "--seconds", min=0.1, help="Length of a round."),
    thinkers: int = typer.Option(64, "--thinkers", min=1, help="Sessions that think between steps."),
    think: float = typer.Option(5.0, "--think", min=0.1, help="Seconds of thinking per step."),
    thinking: float = typer.Option(45.0, "--thinking", min=0.1, help="Seconds that they are watched for."),
    dense: int = typer.Option(200, "--dense", min=2, help="Live sessions of the density run."),
    calls: int = typer.Option(48, "--calls", min=1, help="Calls per operation, for its CPU time."),
    burst: int = typer.Option(
        48, "--burst", min=2, help="Navigations at once, with screenshots behind them."
    ),
    browser: Path | None = typer.Option(None, "--browser", help="Chromium to run.", show_default="found"),
    json: Path | None = typer.Option(None, "--json", help="Write all figures here."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print Markdown, for a document."),
) -> None:
    """The browser server against Chromium's own ceiling, frozen and not, and how many sessions fit.

    Starts its own servers and pages; needs nothing else. About ten minutes in full on two cores.
    """
    import logging

    import msgspec
    import uvloop
    from rich.console import Console

    from webgym.bench.server import PARTS, ServerFigures, measure
    from webgym.bench.stepping import BenchPlan
    from webgym.bench.tables import server_tables
    from webgym.tables import markdown, show

    _expect_to_write(json)
    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    _expect_known("part", only, PARTS)
    plan = BenchPlan(
        sessions=sessions,
        rounds=rounds,
        round_seconds=seconds,
        thinkers=thinkers,
        think_seconds=think,
        thinking_seconds=thinking,
        dense=dense,
        calls=calls,
        burst=burst,
    )
    said = Console(stderr=True)

    def say(line: str) -> None:
        said.print(line, style="dim", highlight=False)

    def keep(figures: ServerFigures) -> None:
        if json is not None:
            json.write_bytes(msgspec.json.format(msgspec.json.encode(figures)))

    async def run() -> None:
        shown = 0
        async for figures in measure(plan, only or PARTS, browser, say):
            keep(figures)  # what is found stays, whatever happens to the rest
            tables = list(server_tables(figures))
            if not shown:
                print(f"Chromium {figures.browser}, {figures.processors} processors\n", flush=True)
            if as_markdown:
                print(markdown(tables[shown:]), flush=True)
            else:
                show(tables[shown:], Console())
            shown = len(tables)

    uvloop.run(run())


@app.command()
def soak(
    minutes: float = typer.Option(
        5.0, "--minutes", min=0.05, help="How long clients come and faults happen."
    ),
    seed: int = typer.Option(0, "--seed", help="Of all choices; what they meet is up to timing."),
    clients: int = typer.Option(10, "--clients", min=1, help="Clients at work at once."),
    slots: int = typer.Option(6, "--slots", min=1, help="Sessions at once, over all workers."),
    workers: int = typer.Option(2, "--workers", min=1, help="Worker processes behind the gateway."),
    faults: float = typer.Option(20.0, "--faults", min=0.1, help="Faults per minute, on average."),
    hostile: float = typer.Option(
        0.25, "--hostile", min=0.0, max=1.0, help="Share of the pages that mean harm."
    ),
    browser: Path | None = typer.Option(None, "--browser", help="Chromium to run.", show_default="found"),
    log: Path = typer.Option(
        Path("/dev/null"), "--log", help="Add the server's log to this file.", show_default="thrown away"
    ),
    json: Path | None = typer.Option(None, "--json", help="Write everything here."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print Markdown, for a document."),
) -> None:
    """A real server, clients on calm and hostile pages, and random faults: do the books balance afterwards?

    Kills and stops browsers, renderers, GPU processes, workers and the gateway, fills the disk (as root), and
    lets clients vanish. Then every session must be accounted for, every error have a type, every slot serve
    again, and no process, lease, file, profile or descriptor be left. Exit code 1 if not.

    Starts its own server and pages; needs nothing else, and touches no process but its own.
    """
    import logging

    import msgspec
    import uvloop
    from rich.console import Console

    from webgym.bench.soak import Soak, SoakPlan, soak_tables
    from webgym.bench.soak import soak as run
    from webgym.bench.soak.progress import progress
    from webgym.tables import markdown, show

    _expect_to_write(json)
    _expect_to_write(log)
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
    with progress(Console(stderr=True), plan.seconds) as watch:
        found: Soak = uvloop.run(run(plan, browser, watch, log))
    if json is not None:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(found)))
    if as_markdown:
        print(markdown(soak_tables(found)))
    else:
        show(soak_tables(found), Console())
    for problem in found.problems:
        print(f"does not balance: {problem}")
    if found.problems:
        raise typer.Exit(1)
    print("The books balance.")


@app.command()
def rollout(
    only: list[str] = typer.Option(
        [],
        "--only",
        help="calibration, schedules, capacity or overload. May be repeated.",
        show_default="all",
    ),
    mode: list[str] = typer.Option(
        [],
        "--mode",
        help="async, 'async, one queue', step barrier, 'step barrier, fixed group' or episode barrier: "
        "what is compared. May be repeated.",
        show_default="all",
    ),
    trajectories: int = typer.Option(64, "--trajectories", min=1, help="Of every cell."),
    sessions: int = typer.Option(16, "--sessions", min=1, help="Environments."),
    cpus: list[int] = typer.Option(
        [],
        "--cpus",
        min=1,
        help="Processors that browsers may use. May be repeated.",
        show_default="1, 2, 4, …",
    ),
    gpus: int = typer.Option(8, "--gpus", min=1, help="Of the policy, where processors are varied."),
    mean_steps: float = typer.Option(13.2, "--mean-steps", min=1.1, help="Of a trajectory."),
    reply_tokens: float = typer.Option(80.0, "--reply-tokens", min=1, help="Of a reply, on average."),
    page_latency: str = typer.Option(
        "offline",
        "--page-latency",
        help="offline: the offline web's own. paper: as in the simulation that is fitted to the paper, "
        "median 1 s and a far heavier tail.",
    ),
    rounds: int = typer.Option(3, "--rounds", min=1, help="Of every cell; medians and ranges are printed."),
    seed: int = typer.Option(0, "--seed", help="Of the tasks, their lengths and the policy's play."),
    quick: bool = typer.Option(False, "--quick", help="A look: few short trajectories, schedules alone."),
    out: Path = typer.Option(
        Path("runs/bench-rollout"), "--out", help="Folder, a file per cell. Given again, it goes on."
    ),
    measures: bool = typer.Option(
        True, "--measure/--no-measure", help="Measure what is missing, or print what --out holds so far."
    ),
    figure: Path | None = typer.Option(None, "--figure", help="Draw it here: .svg, .png or .pdf."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print Markdown, for a document."),
) -> None:
    """Async collection against its rivals: step barrier, episode barrier, one queue for all operations.

    The real collector, server and Chromium on the offline web, and a policy endpoint that takes as long as
    GPUs would. Browsers and their server are bound to so many processors, all else runs on any. Each cell is
    the same work. Nothing else should run on the machine: the load before each cell is in the table.
    """
    import logging
    import os

    from rich.console import Console
    from rich.progress import track

    from webgym.bench.rollout.measure import begin, measure_into
    from webgym.bench.rollout.plan import MODE_NAMES, PAGE_LATENCIES, PARTS, RolloutPlan
    from webgym.bench.rollout.tables import draw_rollout, rollout_tables
    from webgym.tables import markdown, show

    _expect_known("part", only, PARTS)
    _expect_known("mode", mode, MODE_NAMES)
    _expect_known("page latency", [page_latency], tuple(PAGE_LATENCIES))
    _expect_to_write(figure)
    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    ours = len(os.sched_getaffinity(0))
    plan = RolloutPlan(
        trajectories=12 if quick else trajectories,
        sessions=6 if quick else sessions,
        cpus=tuple(cpus) or tuple(2**power for power in range(ours.bit_length())),
        policy_gpus=gpus,
        mean_steps=5.0 if quick else mean_steps,
        reply_tokens=reply_tokens,
        page_latency=cast("PageLatency", page_latency),
        rounds=1 if quick else rounds,
        seed=seed,
    )
    done = {one.cell.name: one for one in begin(plan, out)}
    parts = only or (("calibration", "schedules") if quick else PARTS)
    cells = list(plan.cells(parts, mode or MODE_NAMES))
    missing = [cell for cell in cells if cell.name not in done] if measures else []
    for cell in track(missing, "cells", console=Console(stderr=True), transient=True):
        done[cell.name] = measure_into(out, plan, cell)
    found = [done[cell.name] for cell in cells if cell.name in done]
    if as_markdown:
        print(markdown(rollout_tables(found)), end="")
    else:
        show(rollout_tables(found), Console())
    if figure is not None:
        draw_rollout(found, figure)
