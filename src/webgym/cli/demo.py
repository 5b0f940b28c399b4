"""``webgym demo``: the whole pipeline on the offline web."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import typer

from webgym.cli._options import mode_of
from webgym.core.errors import ConfigError, UsageError

_COLLECTING = ("policy", "mistakes", "base_url", "model", "profile", "marks")
"""Options that need --collect-only."""
_TRAINING = ("weights", "iterations")
"""Options that exclude --collect-only."""


def command(
    context: typer.Context,
    out: Path | None = typer.Option(
        None, "--out", help="Run folder to make.", show_default="a new folder in runs/"
    ),
    collect_only: bool = typer.Option(
        False, "--collect-only", help="Only collect, judge and report; do not train. Needs no torch."
    ),
    tasks: int = typer.Option(
        200, "--tasks", min=1, help="Number of tasks, drawn from unseen (test) websites."
    ),
    iterations: int | None = typer.Option(
        None, "--iterations", min=1, help="Number of training iterations.", show_default="4"
    ),
    weights: Path | None = typer.Option(
        None,
        "--weights",
        help="Folder of the initial weights, as webgym pretrain writes them.",
        show_default="the weights in the package",
    ),
    sessions: int = typer.Option(8, "--sessions", min=1, help="Number of parallel browser sessions."),
    policy: str | None = typer.Option(
        None,
        "--policy",
        help="With --collect-only: scripted, random or openai.",
        show_default="openai with --base-url, else scripted",
    ),
    mistakes: float = typer.Option(
        0.2, "--mistakes", min=0, max=1, help="Scripted policy: share of the attempts that contain a mistake."
    ),
    base_url: str | None = typer.Option(
        None,
        "--base-url",
        help="OpenAI-compatible endpoint, such as http://127.0.0.1:8000/v1; its key: WEBGYM_API_KEY.",
        show_default=False,
    ),
    model: str | None = typer.Option(
        None, "--model", help="Name of the model at that endpoint.", show_default=False
    ),
    profile: str | None = typer.Option(
        None,
        "--profile",
        help="Model family, which decides on image sizes, coordinates, think tags and sampling.",
        show_default="by the model's name",
    ),
    marks: bool | None = typer.Option(
        None, "--marks/--coordinates", help="Interaction mode.", show_default="the profile's"
    ),
    seed: int = typer.Option(
        1, "--seed", help="Seed of the draw of tasks and of everything else that is random."
    ),
) -> None:
    """Run the whole pipeline: evaluate on tasks of unseen websites, train on others, evaluate again.

    A vision-language model of 2.6 million weights acts in real browsers on small websites, its attempts are
    judged, and it is trained on the successful ones, in four iterations: about ten minutes on two processors,
    without network or GPU. The report shows success before and after.

    With --collect-only a scripted policy attempts tasks on the large websites, in about two minutes;
    --base-url and --model select a model of yours instead.
    """
    from datetime import datetime

    _refuse_unused_options(context, collect_only)
    folder = out or Path("runs") / f"demo-{datetime.now():%Y%m%d-%H%M%S}"
    if not collect_only:
        _train(folder, weights, seed, tasks, iterations, sessions)
        return
    _collect(
        folder,
        {
            "seed": seed,
            "policy": {"name": policy, "mistakes": mistakes, "chat": {"base_url": base_url, "model": model}},
            "tasks": {"split": "test", "count": tasks, "spread": True},
            "agent": {"profile": profile, "mode": mode_of(marks)},
            "collector": {"sessions": sessions},
        },
    )


def _refuse_unused_options(context: typer.Context, collect_only: bool) -> None:
    """Refuse options that would have no effect.

    Raises:
        UsageError: there is one.
    """
    unused = _TRAINING if collect_only else _COLLECTING
    given = [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in unused and context.params[parameter.name] != parameter.default
    ]
    if given and collect_only:
        raise UsageError(
            f"{given[0]} has no effect with --collect-only, which does not train",
            hint=f"leave out {given[0]}",
        )
    if given:
        raise UsageError(f"{given[0]} has no effect without --collect-only", hint="add --collect-only")


def _collect(folder: Path, options: dict[str, Any]) -> None:
    """Collect and judge trajectories, write the report, and print both."""
    from webgym.cli._run import lasting_console, print_notes_on, run, settings, show_progress_on
    from webgym.cli._summary import all_failed, print_summary
    from webgym.report.write import write_report
    from webgym.run.collect import collect

    console = lasting_console()
    config = settings((), options)
    console.print(
        f"{config.tasks.count} tasks on unseen websites, {config.collector.sessions} browser sessions, "
        f"{config.policy.name} policy",
        highlight=False,
    )
    summary = run(
        lambda: collect(config, folder, show=show_progress_on(console), tell=print_notes_on(console)),
        resumed_by=("webgym rollout", folder),
        report=True,
    )
    report = write_report(folder)
    print_summary(summary, console)
    console.print(
        f"\nreport   {report}\nbrowse   webgym view {shlex.quote(str(folder))}",
        highlight=False,
        soft_wrap=True,
        markup=False,
    )
    if all_failed(summary):
        raise typer.Exit(1)


def _train(
    folder: Path, weights: Path | None, seed: int, tasks: int, iterations: int | None, sessions: int
) -> None:
    """Evaluate the weights, train them, evaluate them again, and print success before and after."""
    try:
        import torch
    except ImportError as error:
        raise ConfigError(
            "training needs torch", hint="pip install 'webgym-rl[train]', or add --collect-only"
        ) from error
    from webgym.cli._run import lasting_console, secrets
    from webgym.cli._training_output import run_training
    from webgym.study.demo import WEIGHTS, before_and_after, settings
    from webgym.train.folder import TrainingFolder

    # Browsers need the other processors, and small models are slower with threads that wait for busy ones.
    torch.set_num_threads(1)
    console = lasting_console()
    config = settings(weights or WEIGHTS, seed=seed, tasks=tasks, iterations=iterations, sessions=sessions)
    run_training(config, folder, resume=False, secrets=secrets(None), console=console)
    for line in before_and_after(folder):
        console.print(line, highlight=False, soft_wrap=True)
    last = max(TrainingFolder(folder).evaluations())
    browse = f"browse   webgym view {shlex.quote(str(TrainingFolder(folder).evaluation(last)))}"
    console.print(browse, highlight=False, soft_wrap=True, markup=False)
