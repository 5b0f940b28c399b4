"""``webgym demo``: the whole pipeline on the offline web."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import typer

from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._options import mode_of, number
from webgym.core.errors import ConfigError
from webgym.run.config import RunConfig

_ALWAYS = ("out", "collect_only", "tasks", "sessions", "seed")
_COLLECTING = (*_ALWAYS, "policy", "mistakes", "base_url", "model", "profile", "marks", "assignments")
"""Options that apply with --collect-only."""
_TRAINING = (*_ALWAYS, "weights", "iterations")
"""Options that apply without it."""
_TASKS, _SESSIONS, _SEED, _MISTAKES = 200, 8, 1, 0.2

RUN = Options(
    RunConfig,
    {
        "--tasks": Option(
            "tasks.count",
            help="Number of tasks, drawn from unseen (test) websites.",
            metavar="N",
            default=str(_TASKS),
            parse=number,
        ),
        "--sessions": Option("collector.sessions", default=str(_SESSIONS)),
        "--policy": Option(
            "policy.name",
            help="With --collect-only: scripted, random or openai.",
            default="openai with --base-url, else scripted",
        ),
        "--mistakes": Option("policy.mistakes", default=str(_MISTAKES)),
        "--base-url": "policy.chat.base_url",
        "--model": "policy.chat.model",
        "--profile": "agent.profile",
        "--marks/--coordinates": Option("agent.mode", parse=mode_of),
        "--seed": Option("seed", default=str(_SEED)),
    },
)


@takes(settings=RUN)
def command(
    context: typer.Context,
    settings: Given,
    out: Path | None = typer.Option(
        None, "--out", help="Run folder to make.", show_default="a new folder in runs/"
    ),
    collect_only: bool = typer.Option(
        False, "--collect-only", help="Only collect, judge and report; do not train. Needs no torch."
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
) -> None:
    """Run the whole pipeline: evaluate on tasks of unseen websites, train on others, evaluate again.

    A vision-language model of 2.6 million weights acts in real browsers on small websites, its attempts are
    judged, and it is trained on the successful ones, in four iterations: about ten minutes on two processors,
    without network or GPU. The report shows success before and after.

    With --collect-only a scripted policy attempts tasks on the large websites, in about two minutes;
    --base-url and --model select a model of yours instead.
    """
    from datetime import datetime

    from webgym.cli import _run
    from webgym.cli._checks import check_folder, check_model
    from webgym.core.settings import merged

    if collect_only:
        _run.refuse_unused(context, _COLLECTING, "--collect-only does not train", "leave out one of them")
    else:
        _run.refuse_unused(context, _TRAINING, "the demo trains the tiny policy", "add --collect-only")
    folder = out or Path("runs") / f"demo-{datetime.now():%Y%m%d-%H%M%S}"
    check_folder(folder)
    defaults = {
        "seed": _SEED,
        "policy": {"mistakes": _MISTAKES},
        "tasks": {"split": "test", "count": _TASKS, "spread": True},
        "collector": {"sessions": _SESSIONS},
    }
    chosen = merged(defaults, settings)
    if collect_only:
        _collect(folder, chosen)
        return
    if weights is not None:
        check_model(weights)
    _train(folder, weights, chosen, iterations)


def _collect(folder: Path, chosen: Given) -> None:
    """Collect and judge trajectories, write the report, and print both."""
    from functools import partial

    from webgym.cli import _run
    from webgym.cli._print import say
    from webgym.cli._summary import print_summary
    from webgym.report.write import write_report
    from webgym.run.collect import collect

    console = _run.lasting_console()
    config = _run.settings((), chosen)
    what = f"{config.tasks.count} tasks on unseen websites, {config.collector.sessions} browser sessions"
    say(f"{what}, {config.policy.name} policy", console)
    resumed_by = ("webgym rollout", folder)
    summary, finishing = _run.make_run(
        partial(collect, config, folder), resumed_by=resumed_by, console=console, token_file=None, report=True
    )
    report = write_report(folder)
    print_summary(summary, console)
    _run.end(summary, resumed_by, console, report=report, finishing=finishing)


def _train(folder: Path, weights: Path | None, chosen: dict[str, Any], iterations: int | None) -> None:
    """Evaluate the weights, train them, evaluate them again, and print success before and after."""
    try:
        import torch
    except ImportError as error:
        raise ConfigError(
            "training needs torch", hint="pip install 'webgym-rl[train]', or add --collect-only"
        ) from error
    from webgym.cli._print import say
    from webgym.cli._run import lasting_console, secrets
    from webgym.cli._training_output import run_training
    from webgym.study.demo import WEIGHTS, before_and_after, settings
    from webgym.train.folder import TrainingFolder

    # Browsers need the other processors, and small models are slower with threads that wait for busy ones.
    torch.set_num_threads(1)
    console = lasting_console()
    config = settings(
        weights or WEIGHTS,
        seed=chosen["seed"],
        tasks=chosen["tasks"]["count"],
        iterations=iterations,
        sessions=chosen["collector"]["sessions"],
    )
    run_training(config, folder, resume=False, secrets=secrets(None), console=console)
    for line in before_and_after(folder):
        say(line, console)
    last = max(TrainingFolder(folder).evaluations())
    say(f"browse   webgym view {shlex.quote(str(TrainingFolder(folder).evaluation(last)))}", console)
