"""``webgym train``: train a policy on its own successful attempts, iteration by iteration."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.cli import _options as options
from webgym.cli._fields import Given, Options, takes

if TYPE_CHECKING:
    from webgym.train.loop import TrainConfig

TRAIN = Options("webgym.train.loop:TrainConfig")


@takes(settings=TRAIN)
def command(
    settings: Given,
    config: list[Path] = typer.Argument(
        None,
        help="YAML files of settings; later files override earlier ones. See configs/train/.",
        show_default=False,
    ),
    out: Path | None = typer.Option(
        None, "--out", help="Folder of the training to make.", show_default=False
    ),
    resume: Path | None = typer.Option(
        None, "--resume", help="Folder of the training to resume, with its settings.", show_default=False
    ),
    runs: list[Path] = typer.Option(
        [],
        "--from",
        metavar="RUN",
        help="A run whose successes the model is trained on first (warm start); may be given several times.",
        show_default=False,
    ),
    explain: bool = typer.Option(
        False,
        "--explain",
        help="Print the settings and the estimated memory and time of an update, and exit.",
    ),
    check: bool = typer.Option(
        False,
        "--check",
        help="Load everything, open a page, ask for a reply, try an update, say what was found, and exit.",
    ),
    gpus: str | None = typer.Option(
        None,
        "--gpus",
        help="GPUs of this machine to use, such as 8, where --layout does not say what for; for "
        "--explain with their type, such as 8xh100, 4xa100, 1xh200.",
        show_default=False,
    ),
    layout: str | None = typer.Option(
        None,
        "--layout",
        metavar="LEARNER+SERVERS+JUDGE",
        help="GPUs that learn, policy servers, GPUs of the judge's server, such as 4+3+1, or 4+2x2+0 for two "
        "servers of two GPUs each. All are started.",
        show_default=False,
    ),
    stop_before: str | None = typer.Option(
        None,
        "--stop-before",
        metavar="DURATION",
        help="Stop this long, such as 10m, before Slurm's allocation ends: finish what can be finished, exit "
        "with 0. --resume continues.",
        show_default=False,
    ),
    ends: str | None = typer.Option(
        None,
        "--ends",
        metavar="TIME",
        help="Of --stop-before, without Slurm: the end, such as 2026-11-30T08:00.",
        show_default=False,
    ),
    token_file: options.TokenFile = None,
) -> None:
    """Train a policy: sample tasks, roll out, judge, learn from successful attempts, publish, evaluate.

    A training that was killed is resumed with --resume FOLDER: no attempt is lost and none is made twice.
    What runs at other addresses by then is set anew: rollout.server, rollout.judge, vllm, --layout.
    """
    from webgym.cli import _run
    from webgym.cli._checks import check_training
    from webgym.cli._print import say
    from webgym.core.errors import UsageError
    from webgym.core.settings import merged, read_files
    from webgym.train.stopping import ends_in_time

    files = list(config or ())
    settings |= {"layout": layout} if layout else {}
    begins = bool(files or out or runs)
    if (resume and (begins or not _are_places(settings))) or not (explain or resume or (files and out)):
        hint = "webgym train CONFIG --out FOLDER starts one, webgym train --resume FOLDER continues it"
        raise UsageError("give either settings and --out, or --resume", hint=hint)
    if ends and not stop_before:
        raise UsageError("--ends is the end that --stop-before counts from", hint="give --stop-before, too")
    stop = ends_in_time(stop_before, ends) if stop_before else None
    if not (resume or explain):
        check_training(merged(read_files(files, hint="see configs/train/ for examples"), settings), out)
    from webgym.cli._training_output import run_check, run_training
    from webgym.run.config import with_pinned_tasks
    from webgym.train.placing import choose, gpus_of, launch, placed
    from webgym.train.rehearsal import join_rehearsal
    from webgym.train.start import follow, is_follower, load_train_config, read_config

    console = _run.lasting_console()
    chosen = read_config(resume, settings) if resume else load_train_config(files, settings)
    arguments = sys.argv[1:]
    if not layout and (gpus or (explain and chosen.layout is None)):
        layout = str(choose(chosen, gpus_of(gpus or "8xh100")))
        chosen, arguments = chosen.model_copy(update={"layout": layout}), [*arguments, "--layout", layout]
    if explain:
        for line in _explanation(chosen, gpus):
            say(line, console)
        return
    folder = out or resume
    assert folder is not None
    placed(chosen)  # refuses a layout that does not fit before processes are started
    launch(chosen, arguments)
    if runs and not check:
        from webgym.run.choice import all_tasks
        from webgym.train.folder import TrainingFolder
        from webgym.train.start import warm_start

        if not is_follower():
            TrainingFolder(folder).refuse_used()
        started = folder.with_name(f"{folder.name}-start")
        chosen = warm_start(chosen, runs, all_tasks(chosen.rollout), started, lambda line: say(line, console))
    if is_follower():
        (join_rehearsal if check else follow)(chosen, folder)
        return
    if resume is None:
        chosen = chosen.model_copy(update={"rollout": with_pinned_tasks(chosen.rollout)})
    secrets = _run.secrets(token_file)
    if check:
        run_check(chosen, folder, resume=resume is not None, secrets=secrets, console=console)
        return
    run_training(chosen, folder, resume=resume is not None, secrets=secrets, console=console, stop=stop)


def _are_places(settings: Given) -> bool:
    """Whether settings say only where browsers, judge and policy run."""
    return settings.keys() <= {"layout", "rollout", "vllm"} and settings.get("rollout", {}).keys() <= {
        "server",
        "judge",
    }


def _explanation(settings: TrainConfig, gpus: str | None) -> list[str]:
    """Lines that describe a training: tasks, attempts, objective, GPUs, and the cost of an update."""
    from webgym.train.layout import Layout
    from webgym.train.placing import explain, gpus_of

    assert settings.layout is not None
    layout = Layout.parse(settings.layout)
    sampler, attempt = settings.sampler, settings.rollout.attempt
    learn, update = settings.learn, settings.learn.update
    ratio = ", ".join(f"{share:g} {level}" for level, share in (sampler.ratio or {}).items() if share)
    drawn = ratio or "uniform"
    if sampler.without_share:
        drawn += f", without {sampler.without_share:.0%} of the subdomains"
    steps = f"{attempt.budget_easy}, {attempt.budget_medium}, {attempt.budget_hard} steps in training"
    tested = ", ".join(map(str, settings.evaluation.budget))
    penalty = "dropped" if learn.replay.repetition_penalty else "trained on"
    steps_drawn = "all usable" if learn.replay.steps is None else f"{learn.replay.steps:,}"
    batch = f"{update.minibatches} mini-batches" if update.minibatches else f"batch {update.batch}"
    if learn.replay.trajectories is not None:
        steps_drawn = f"{learn.replay.trajectories:,} trajectories: all"
    return [
        f"tasks      {settings.loop.tasks:,} per iteration of split {sampler.split}, {drawn}",
        f"attempts   {steps}, {tested} in evaluation (easy, medium, hard); "
        f"prompt format {settings.rollout.agent.prompt_format}",
        f"learning   {learn.objective.name}, rate {update.learning_rate:g}, {batch}, "
        f"{steps_drawn} steps x {learn.replay.passes}; steps that changed nothing are {penalty}",
        *explain(settings, layout, gpus_of(gpus or f"{layout.total}xh100")),
    ]
