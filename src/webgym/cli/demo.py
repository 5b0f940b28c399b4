"""``webgym demo``: the main job, end to end, on the offline web."""

from __future__ import annotations

from pathlib import Path

import typer

_OF_COLLECTING = ("policy", "mistakes", "base_url", "model", "profile", "marks")
"""What is of use with --collect-only alone."""
_OF_LEARNING = ("weights", "iterations")
"""What is of no use with it."""


def command(
    context: typer.Context,
    out: Path | None = typer.Option(
        None, "--out", help="Run folder; a new one under runs/ if not given.", show_default=False
    ),
    collect_only: bool = typer.Option(
        False, "--collect-only", help="Collect, judge and report alone: nothing is learned, no torch needed."
    ),
    tasks: int = typer.Option(200, "--tasks", min=1, help="Tasks, drawn from unseen (test) websites."),
    iterations: int | None = typer.Option(
        None, "--iterations", min=1, help="Of learning; four if not given.", show_default=False
    ),
    weights: Path | None = typer.Option(
        None,
        "--weights",
        help="Learn from these on: a model of webgym pretrain; the package's if not given.",
        show_default=False,
    ),
    sessions: int = typer.Option(8, "--sessions", min=1, help="Browser sessions at the same time."),
    policy: str | None = typer.Option(
        None,
        "--policy",
        help="Collecting: scripted, random or openai; scripted unless --base-url is given.",
        show_default=False,
    ),
    mistakes: float = typer.Option(
        0.2, "--mistakes", min=0, max=1, help="Scripted policy: share of attempts with a mistake."
    ),
    base_url: str | None = typer.Option(
        None,
        "--base-url",
        help="OpenAI-compatible endpoint, e.g. http://127.0.0.1:8000/v1. Its key: WEBGYM_API_KEY.",
        show_default=False,
    ),
    model: str | None = typer.Option(None, "--model", help="Model at that endpoint.", show_default=False),
    profile: str | None = typer.Option(
        None,
        "--profile",
        help="Family of the model (image sizes, grid, think tags, sampling); else by its name.",
        show_default=False,
    ),
    marks: bool | None = typer.Option(
        None, "--marks/--coordinates", help="Interaction mode; else the profile's.", show_default=False
    ),
    seed: int = typer.Option(1, "--seed", help="Seed of the tasks drawn and of everything random."),
) -> None:
    """The main job: attempt tasks on unseen websites, learn from attempts at others, attempt the first again.

    A vision-language model of 2.6 million weights acts in real browsers on small websites, its attempts are
    judged, it learns from those that succeeded, four times over: about ten minutes on two processors, without
    network or GPU. The report shows success before and after.

    With --collect-only a scripted policy plays on the large websites, about two minutes; or a model of yours:
    --base-url and --model.
    """
    from datetime import datetime

    from rich.console import Console

    from webgym.core.errors import UsageError

    useless = _OF_LEARNING if collect_only else _OF_COLLECTING
    given = [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in useless and context.params[parameter.name] != parameter.default
    ]
    if given and collect_only:
        raise UsageError(
            f"{given[0]} has no use with --collect-only: nothing is learned", hint=f"leave {given[0]} out"
        )
    if given:
        raise UsageError(
            f"{given[0]} has no use where the tiny policy plays and learns", hint="add --collect-only"
        )
    folder = out or Path("runs") / f"demo-{datetime.now():%Y%m%d-%H%M%S}"
    if not collect_only:
        _learn(folder, weights, seed, tasks, iterations, sessions)
        return
    from webgym.cli._options import mode_of
    from webgym.cli._run import print_notes_on, run, settings, show_progress_on
    from webgym.cli._summary import all_failed, print_summary
    from webgym.report.write import write_report
    from webgym.runs import collect

    console = Console()
    options = {
        "seed": seed,
        "policy": {"name": policy, "mistakes": mistakes, "chat": {"base_url": base_url, "model": model}},
        "tasks": {"split": "test", "count": tasks, "spread": True},
        "agent": {"profile": profile, "mode": mode_of(marks)},
        "collector": {"sessions": sessions},
    }
    config = settings((), options)
    console.print(
        f"{tasks} tasks on unseen websites, {sessions} browser sessions, {config.policy.name} policy",
        highlight=False,
    )
    summary = run(
        lambda: collect(config, folder, show=show_progress_on(console), tell=print_notes_on(console)),
        resumed_by=("webgym rollout", folder),
        report=True,
    )
    report = write_report(folder)
    print_summary(summary, console)
    told = f"\nreport   {report}\nbrowse   webgym view {folder}"
    console.print(told, highlight=False, soft_wrap=True, markup=False)
    if all_failed(summary):
        raise typer.Exit(1)


def _learn(
    folder: Path, weights: Path | None, seed: int, tasks: int, iterations: int | None, sessions: int
) -> None:
    """Before, learning, after."""
    from rich.console import Console

    from webgym.cli._run import secrets
    from webgym.cli._training_output import run_training
    from webgym.core.errors import ConfigError

    try:
        import torch
    except ImportError as error:
        raise ConfigError(
            "learning needs torch", hint="pip install 'webgym-rl[train]', or add --collect-only"
        ) from error
    from webgym.tiny.demo import WEIGHTS, before_and_after, settings

    # Browsers need the other processors; and threads that wait for a busy one make small models slow.
    torch.set_num_threads(1)
    console = Console()
    config = settings(weights or WEIGHTS, seed=seed, tasks=tasks, iterations=iterations, sessions=sessions)
    run_training(config, folder, resume=False, secrets=secrets(None), console=console)
    for line in before_and_after(folder):
        console.print(line, highlight=False, soft_wrap=True)
    told = f"browse   webgym view {folder}/evaluations"
    console.print(told, highlight=False, soft_wrap=True, markup=False)
