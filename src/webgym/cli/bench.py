"""``webgym bench``: benchmarks of this machine. The sub-verbs call :mod:`webgym.bench`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

import typer

from webgym.cli._checks import check_figure, check_writable
from webgym.core.errors import ConfigError

if TYPE_CHECKING:
    from webgym.bench.rollout.plan import Cell, PageLatency, RolloutPlan
    from webgym.bench.rollout.results import Measured

HELP = """Benchmark this machine. Results of one run are compared as ratios.

Benchmarks of the code, which do not depend on the machine, are in the repository: python -m
benchmarks.settle, benchmarks.task_set and benchmarks.reward.
"""

app = typer.Typer(no_args_is_help=True, help=HELP)


@app.callback()
def _bench() -> None:
    pass


def _check_known(kind: str, given: Sequence[str], known: Sequence[str]) -> None:
    """Refuse unknown values of an option.

    Raises:
        ConfigError: a value is unknown.
    """
    if unknown := [value for value in given if value not in known]:
        raise ConfigError(f"unknown {kind} {unknown[0]!r}", hint=f"choose one of {'; '.join(known)}")


@app.command()
def server(
    only: list[str] = typer.Option(
        [],
        "--only",
        help="Part to run: ceiling, costs, thinking, burst or density. May be repeated.",
        show_default="all",
    ),
    sessions: int = typer.Option(32, "--sessions", min=1, help="Part ceiling: number of sessions."),
    rounds: int = typer.Option(5, "--rounds", min=1, help="Part ceiling: number of rounds of each loop."),
    seconds: float = typer.Option(
        6.0, "--seconds", min=0.1, max=86_400, help="Part ceiling: duration of a round, seconds."
    ),
    thinkers: int = typer.Option(64, "--thinkers", min=1, help="Part thinking: number of sessions."),
    think: float = typer.Option(
        5.0, "--think", min=0.1, max=86_400, help="Parts thinking and density: pause between steps, seconds."
    ),
    thinking: float = typer.Option(
        45.0, "--thinking", min=0.1, max=86_400, help="Parts thinking and density: duration, seconds."
    ),
    dense: int = typer.Option(200, "--dense", min=2, help="Part density: number of sessions."),
    calls: int = typer.Option(48, "--calls", min=1, help="Part costs: number of calls per operation."),
    burst: int = typer.Option(
        48, "--burst", min=2, help="Part burst: number of navigations that are requested at once."
    ),
    browser: Path | None = typer.Option(
        None, "--browser", help="Chromium executable.", show_default="search for one"
    ),
    json: Path | None = typer.Option(None, "--json", help="Write all results to this JSON file."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print the tables as Markdown."),
) -> None:
    """Benchmark the browser server: against Chromium alone, with freezing on and off, with many sessions.

    Starts its own servers and pages; needs nothing else. All parts take about ten minutes on two cores.
    Ctrl-C prints the tables of what is finished, which --json has, too.
    """
    import logging

    import msgspec
    import uvloop
    from rich.console import Console

    from webgym.bench.server import PARTS, ServerFigures, measure
    from webgym.bench.stepping import BenchPlan
    from webgym.core.tables import markdown, show

    check_writable(json)
    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    _check_known("part", only, PARTS)
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
    progress = Console(stderr=True)
    finished: ServerFigures | None = None

    def report(line: str) -> None:
        progress.print(line, style="dim", highlight=False)

    def write(figures: ServerFigures) -> None:
        if json is not None:
            json.write_bytes(msgspec.json.format(msgspec.json.encode(figures)))

    async def run() -> None:
        nonlocal finished
        async for finished in measure(plan, only or PARTS, browser, report):
            write(finished)

    try:
        uvloop.run(run())
    finally:  # Ctrl-C, or a part that fails, loses nothing of what is finished
        if finished is not None:
            print(f"{finished.head}\n", flush=True)
            if as_markdown:
                print(markdown(finished.tables()), flush=True)
            else:
                show(finished.tables(), Console())


@app.command()
def rollout(
    only: list[str] = typer.Option(
        [],
        "--only",
        help="Part to run: calibration, schedules, capacity or overload. May be repeated.",
        show_default="all",
    ),
    mode: list[str] = typer.Option(
        [],
        "--mode",
        help="Schedule to compare: async, 'async, one queue', step barrier, 'step barrier, fixed group' or "
        "episode barrier. May be repeated.",
        show_default="all",
    ),
    trajectories: int = typer.Option(
        64, "--trajectories", min=1, help="Number of trajectories per measurement."
    ),
    sessions: int = typer.Option(16, "--sessions", min=1, help="Number of parallel environments."),
    cpus: list[int] = typer.Option(
        [],
        "--cpus",
        min=1,
        help="Number of processors that browsers may use. May be repeated.",
        show_default="1, 2, 4, …",
    ),
    gpus: int = typer.Option(8, "--gpus", min=1, help="Number of the policy's GPUs in the part schedules."),
    mean_steps: float = typer.Option(
        13.2, "--mean-steps", min=1.1, max=10_000, help="Mean number of steps per trajectory."
    ),
    reply_tokens: float = typer.Option(
        80.0, "--reply-tokens", min=1, max=1_000_000, help="Mean number of tokens per reply."
    ),
    page_latency: str = typer.Option(
        "offline",
        "--page-latency",
        help="Latency of pages: offline (that of the offline web), paper (that of the simulation that is "
        "fitted to the paper: a median of 1 s, a much heavier tail, at most 60 s, with browsers that wait "
        "for it) or paper_cut (at most 10 s, with the usual deadlines).",
    ),
    rounds: int = typer.Option(
        3,
        "--rounds",
        min=1,
        help="Number of times each measurement is repeated; medians and ranges are printed.",
    ),
    seed: int = typer.Option(0, "--seed", help="Seed of tasks, trajectory lengths and actions."),
    quick: bool = typer.Option(
        False,
        "--quick",
        help="A quick preview: few short trajectories, one round, only calibration and schedules.",
    ),
    out: Path = typer.Option(
        Path("runs/bench-rollout"),
        "--out",
        help="Folder of the results, a file per measurement. An interrupted benchmark in it is continued.",
    ),
    measures: bool = typer.Option(
        True, "--measure/--no-measure", help="Run what is missing in --out, or only print what it contains."
    ),
    figure: Path | None = typer.Option(
        None, "--figure", help="Draw the results to this file: .svg, .png or .pdf."
    ),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print the tables as Markdown."),
) -> None:
    """Compare asynchronous collection with step barriers, episode barriers and one queue for all operations.

    Uses the real collector, server and Chromium on the offline web, and a policy endpoint that takes as long
    as GPUs would. Browsers and their server are confined to the given number of processors, everything else
    is not. Each measurement does the same work. Nothing else should run on the machine: the table contains
    the load before each measurement.
    """
    import logging
    import os

    from rich.console import Console

    from webgym.bench.rollout.plan import MODE_NAMES, PAGE_LATENCIES, PARTS, RolloutPlan
    from webgym.bench.rollout.results import draw_rollout, rollout_tables
    from webgym.cli._print import print_tables

    _check_known("part", only, PARTS)
    _check_known("mode", mode, MODE_NAMES)
    _check_known("page latency", [page_latency], tuple(PAGE_LATENCIES))
    check_figure(figure)
    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    available = len(os.sched_getaffinity(0))
    plan = RolloutPlan(
        trajectories=12 if quick else trajectories,
        sessions=6 if quick else sessions,
        cpus=tuple(cpus) or tuple(2**power for power in range(available.bit_length())),
        policy_gpus=gpus,
        mean_steps=5.0 if quick else mean_steps,
        reply_tokens=reply_tokens,
        page_latency=cast("PageLatency", page_latency),
        rounds=1 if quick else rounds,
        seed=seed,
    )
    parts = only or (("calibration", "schedules") if quick else PARTS)
    cells = list(plan.cells(parts, mode or MODE_NAMES))
    results = _results(plan, cells, out, measures=measures)
    print_tables(rollout_tables(results), Console(), as_markdown=as_markdown)
    if figure is not None:
        draw_rollout(results, figure)


def _results(plan: RolloutPlan, cells: Sequence[Cell], folder: Path, *, measures: bool) -> list[Measured]:
    """The results of these measurements, as far as they are in the folder.

    Args:
        plan: of the benchmark.
        cells: the measurements.
        folder: of the results.
        measures: whether to run those that are missing, or in which no attempt made a step.
    """
    from rich.console import Console
    from rich.progress import track

    from webgym.bench.rollout.measure import check_machine, measure_into
    from webgym.bench.rollout.results import begin

    if measures:
        check_machine(cells)
    results = {result.cell.name: result for result in begin(plan, folder, new=measures)}
    made = {name for name, result in results.items() if result.steps}
    missing = [cell for cell in cells if cell.name not in made] if measures else []
    for cell in track(missing, "measurements", console=Console(stderr=True), transient=True):
        results[cell.name] = measure_into(folder, plan, cell)
    return [results[cell.name] for cell in cells if cell.name in results]
