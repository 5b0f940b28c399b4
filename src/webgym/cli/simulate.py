"""``webgym simulate``: simulate rollout systems of any size, to decide which to buy."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.cli._checks import check_figure, check_writable
from webgym.core.errors import UsageError


def command(
    cpus: list[int] = typer.Option(
        [],
        "--cpus",
        min=1,
        help="Number of processors of all browser machines. May be repeated.",
        show_default="64",
    ),
    gpus: list[float] = typer.Option(
        [],
        "--gpus",
        min=0.01,
        help="Number of GPUs that serve the policy. May be repeated.",
        show_default="24",
    ),
    environments: int | None = typer.Option(
        None, "--environments", min=1, help="Number of parallel episodes.", show_default="4 per CPU"
    ),
    paper: bool = typer.Option(False, "--paper", help="Simulate the paper's measurements instead."),
    compare: Path | None = typer.Option(
        None,
        "--compare",
        help="Folder of webgym bench rollout: compare its results with simulated ones instead.",
        show_default=False,
    ),
    bench: Path | None = typer.Option(
        None,
        "--bench",
        help="Folder of webgym bench rollout: its service times and trajectory lengths are the defaults.",
        show_default=False,
    ),
    config: list[Path] = typer.Option(
        [],
        "--config",
        help="YAML file of costs, system, workload or prices. May be repeated.",
        show_default=False,
    ),
    figure: Path | None = typer.Option(
        None, "--figure", help="Draw the results to this file: .svg, .png or .pdf."
    ),
    json: Path | None = typer.Option(None, "--json", help="Write all results to this JSON file."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print the table as Markdown."),
) -> None:
    """Simulate a rollout system: its throughput, its bottleneck, and the gain from one more of each resource.

    A discrete-event simulation without browsers and models. Service times are read from --bench and
    --config; the defaults are those of real websites and a model of eight billion parameters on H100s. A
    system of up to 10,000 CPUs and 1,000 GPUs takes less than a minute.
    """
    import msgspec
    from rich.console import Console
    from rich.progress import track

    from webgym.cli._print import print_tables
    from webgym.simulate.paper import draw_paper, paper_table, reproduce
    from webgym.simulate.sizing import draw_sizes, read_questions, sizes_table

    if figure is not None and compare is not None:
        raise UsageError("there is no figure of a comparison", hint="webgym bench rollout --figure draws one")
    check_writable(json)
    check_figure(figure)
    questions = read_questions(config)
    if bench is not None:
        from webgym.bench.rollout.results import loaded_service_times, read_bench

        plan, measured = read_bench(bench)
        questions = questions.over(loaded_service_times(plan, measured), plan.workload)
    progress = Console(stderr=True)
    results: object
    if compare is not None:
        from webgym.bench.rollout.results import beside_simulation, comparison_table, read_bench

        results = compared = list(beside_simulation(*read_bench(compare)))
        table = comparison_table(compared)
    elif paper:
        with progress.status("simulating the paper's measurements"):
            results = reproduced = reproduce(questions.costs, questions.workload)
        table = paper_table(reproduced.points)
    else:
        systems = list(questions.sizes(cpus, gpus, environments))
        if any(system.environments > system.sessions for system in systems):
            most = f"{questions.system.browsers_per_cpu:g} environments per CPU"
            progress.print(f"memory allows {most} (system.browsers_per_cpu)", soft_wrap=True, highlight=False)
        tracked = track(systems, "simulating", console=progress, transient=True)
        sizes = [questions.answer(system) for system in tracked]
        results, table = sizes, sizes_table(sizes)
    print_tables([table], Console(), as_markdown=as_markdown)
    if json is not None:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(results)))
    if figure is not None and paper:
        draw_paper(reproduced, figure)
    elif figure is not None:
        draw_sizes(sizes, figure)
