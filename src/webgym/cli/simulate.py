"""``webgym simulate``: the rollout system as a model, for questions that no machine at hand can answer."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.core.errors import UsageError


def command(
    cpus: list[int] = typer.Option(
        [], "--cpus", min=1, help="Processors of all browser machines. May be repeated.", show_default="64"
    ),
    gpus: list[float] = typer.Option(
        [], "--gpus", min=0.01, help="GPUs that serve the policy. May be repeated.", show_default="24"
    ),
    environments: int | None = typer.Option(
        None, "--environments", min=1, help="Episodes at once.", show_default="4 per CPU"
    ),
    paper: bool = typer.Option(False, "--paper", help="Repeat the paper's measurements instead."),
    compare: Path | None = typer.Option(
        None,
        "--compare",
        help="A folder of webgym bench rollout: its ratios beside the model's.",
        show_default=False,
    ),
    config: list[Path] = typer.Option(
        [], "--config", help="YAML with costs, system, workload or prices. Repeatable.", show_default=False
    ),
    figure: Path | None = typer.Option(None, "--figure", help="Draw it here: .svg, .png or .pdf."),
    json: Path | None = typer.Option(None, "--json", help="Write all figures here."),
    as_markdown: bool = typer.Option(False, "--markdown", help="Print Markdown, for a document."),
) -> None:
    """How many trajectories a system of any size makes, what limits it, and what one more of each thing buys.

    A discrete-event model; starts no browser and no model. The service times are those of a config, else they
    stand for real websites and a model of eight billion parameters on H100s. Up to 10,000 CPUs and 1,000 GPUs
    in under a minute per size.
    """
    import msgspec
    from rich.console import Console
    from rich.progress import track

    from webgym.cli._simulation_tables import paper_table, sizes_table
    from webgym.simulate.figures import draw_paper, draw_sizes
    from webgym.simulate.paper import reproduce
    from webgym.simulate.questions import read_questions
    from webgym.tables import markdown, show

    asked = read_questions(config)
    said = Console(stderr=True)
    found: object
    if compare is not None:
        from webgym.bench.rollout.compare import compare as compared_with
        from webgym.bench.rollout.compare import comparison_table
        from webgym.bench.rollout.measure import read_bench

        found = compared = list(compared_with(*read_bench(compare)))
        table = comparison_table(compared)
    elif paper:
        with said.status("simulating the paper's measurements"):
            found = reproduced = reproduce(asked.costs, asked.workload)
        table = paper_table(reproduced.points)
    else:
        systems = list(asked.sizes(cpus, gpus, environments))
        watched = track(systems, "simulating", console=said, transient=True)
        sizes = [asked.answer(system) for system in watched]
        found, table = sizes, sizes_table(sizes)
    if as_markdown:
        print(markdown([table]), end="")
    else:
        show([table], Console())
    if json is not None:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(found)))
    if figure is not None and compare is not None:
        raise UsageError("there is no figure of a comparison", hint="webgym bench rollout --figure draws one")
    if figure is not None and paper:
        draw_paper(reproduced, figure)
    elif figure is not None:
        draw_sizes(sizes, figure)
