"""``webgym rollout``: collect trajectories into a run folder, or resume one."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.cli import _options as options


def command(
    out: Path | None = typer.Option(None, "--out", help="Run folder to make.", show_default=False),
    resume: options.Resume = None,
    config: options.Config = None,
    tasks: options.Tasks = None,
    split: options.SplitOf = None,
    limit: options.Limit = None,
    samples: options.Samples = None,
    sessions: options.Sessions = None,
    policy: options.PolicyName = None,
    mistakes: options.Mistakes = None,
    base_url: options.BaseUrl = None,
    model: options.Model = None,
    profile: options.ProfileName = None,
    judge: str | None = typer.Option(
        None,
        "--judge",
        help="offline, rubric or module:function; rubric with --judge-base-url.",
        show_default="offline",
    ),
    judge_base_url: options.JudgeBaseUrl = None,
    judge_model: options.JudgeModel = None,
    schedule: str | None = typer.Option(
        None,
        "--schedule",
        help="async; step_barrier and episode_barrier are the paper's baselines.",
        show_default="async",
    ),
    order: str | None = typer.Option(
        None, "--order", help="Of the tasks: given or hardest_first.", show_default="given"
    ),
    share: Path | None = typer.Option(
        None,
        "--share",
        help="Folder on a disk that other collectors of the same tasks see: each task is attempted by one.",
        show_default=False,
    ),
    marks: options.Marks = None,
    server: options.Server = None,
    token_file: options.TokenFile = None,
    sites: options.Sites = None,
    seed: options.Seed = None,
    skip_corrupt: options.SkipCorrupt = False,
    retry_errors: options.RetryErrors = False,
    report: options.WriteReport = True,
) -> None:
    """Collect trajectories: attempt every task, judge, and keep all of it in a run folder.

    Ctrl-C once ends the run when the attempts in flight are done, twice abandons them. A run that was stopped
    or killed is resumed with --resume RUN: nothing is lost and nothing is made twice.
    """
    import asyncio

    from rich.console import Console

    from webgym.cli import _run
    from webgym.cli._summary import all_failed, print_retry, print_summary
    from webgym.core.errors import UsageError
    from webgym.report import write_report
    from webgym.runs import ServerChoice, collect
    from webgym.runs import resume as go_on

    console = Console()
    secrets = _run.secrets(token_file)
    show, tell = _run.show_on(console), _run.tell_on(console)
    servers = ServerChoice(url=server, sites_url=sites)
    finishing = asyncio.Event()
    if resume is not None and out is None:
        folder, changed = resume, servers if server or sites else None
        summary = _run.run(
            lambda: go_on(
                folder,
                secrets=secrets,
                server=changed,
                skip_corrupt=skip_corrupt,
                retry_errors=retry_errors,
                show=show,
                tell=tell,
                finishing=finishing,
            ),
            resumed_by=("webgym rollout", folder),
            finishing=finishing,
            report=report,
        )
    elif out is not None and resume is None:
        folder = out
        overrides = {
            "seed": seed,
            "samples": samples,
            "tasks": {"file": tasks, "split": split, "count": limit},
            "agent": {"profile": profile, "mode": options.mode_of(marks)},
            "collector": {
                "sessions": sessions,
                "schedule": schedule,
                "order": order,
                "sharing": {"folder": share},
            },
            "server": {"url": server, "sites_url": sites},
        }
        settings = options.run_settings(
            config,
            overrides,
            (policy, mistakes, base_url, model),
            (judge, judge_base_url, judge_model),
        )
        summary = _run.run(
            lambda: collect(settings, folder, secrets=secrets, show=show, tell=tell, finishing=finishing),
            resumed_by=("webgym rollout", folder),
            finishing=finishing,
            report=report,
        )
    else:
        raise UsageError("give either --out or --resume", hint="--out makes a run, --resume resumes one")
    path = write_report(folder) if report else None
    print_summary(summary, console)
    console.print(f"\nrun      {folder}", highlight=False, soft_wrap=True, markup=False)
    print_retry(summary, f"webgym rollout --resume {folder}", console)
    if path is not None:
        console.print(f"report   {path}", highlight=False, soft_wrap=True, markup=False)
    _run.end_early(finishing, ("webgym rollout", folder))
    if all_failed(summary):
        raise typer.Exit(1)
