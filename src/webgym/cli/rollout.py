"""``webgym rollout``: collect trajectories into a run folder, or resume one."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.cli import _options as options
from webgym.cli._fields import Given, takes

RUN = options.run_options(
    split="train; all tasks if none has a split",
    limit="all tasks of a file of up to 100, else 20",
    schedule="collector.schedule",
    order="collector.order",
    share="collector.sharing.folder",
)


@takes(settings=RUN)
def command(
    context: typer.Context,
    *,
    out: Path | None = typer.Option(None, "--out", help="Run folder to make.", show_default=False),
    resume: options.Resume = None,
    config: options.Config = None,
    settings: Given,
    token_file: options.TokenFile = None,
    skip_corrupt: options.SkipCorrupt = False,
    retry_errors: options.RetryErrors = False,
    report: options.WriteReport = True,
) -> None:
    """Collect trajectories: attempt every task, judge the attempts, and store them in a run folder.

    After Ctrl-C the run ends when the attempts in flight have ended; a second Ctrl-C abandons them. A run
    that was stopped or killed is resumed with --resume RUN: no attempt is lost or made twice.
    """
    from functools import partial

    from webgym.cli import _run
    from webgym.cli._checks import check_folder
    from webgym.cli._summary import print_summary
    from webgym.core.errors import UsageError
    from webgym.report.write import write_report
    from webgym.run.collect import collect

    console = _run.lasting_console()
    if resume is not None and out is None:
        folder = resume
        _run.refuse_unused_with_resume(context, folder)
        job = _run.resume_job(folder, settings, skip_corrupt=skip_corrupt, retry_errors=retry_errors)
    elif out is not None and resume is None:
        folder = out
        check_folder(folder)
        job = partial(collect, _run.settings(config or (), settings), folder)
    else:
        raise UsageError("give either --out or --resume", hint="--out makes a run, --resume continues one")
    resumed_by = ("webgym rollout", folder)
    summary, finishing = _run.make_run(
        job, resumed_by=resumed_by, console=console, token_file=token_file, report=report
    )
    path = write_report(folder) if report else None
    print_summary(summary, console)
    _run.end(summary, resumed_by, console, report=path, finishing=finishing)
