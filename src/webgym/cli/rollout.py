"""``webgym rollout``: collect trajectories into a run folder, or go on with one."""

from __future__ import annotations

from pathlib import Path

import typer


def command(
    out: Path | None = typer.Option(None, "--out", help="Run folder to make.", show_default=False),
    resume: Path | None = typer.Option(
        None, "--resume", help="Run folder to go on with; its own settings hold.", show_default=False
    ),
    config: Path | None = typer.Option(
        None, "--config", help="YAML file of settings; the options below override it.", show_default=False
    ),
    tasks: Path | None = typer.Option(
        None,
        "--tasks",
        help="Task file of any format, or a folder; without one, the offline web's tasks.",
        show_default=False,
    ),
    split: str | None = typer.Option(None, "--split", help="train or test.", show_default=False),
    limit: int | None = typer.Option(None, "--limit", min=1, help="Draw so many tasks.", show_default=False),
    samples: int | None = typer.Option(None, "--samples", min=1, help="Attempts per task.", show_default="1"),
    sessions: int | None = typer.Option(
        None, "--sessions", min=1, help="Browser sessions at the same time.", show_default="16"
    ),
    policy: str | None = typer.Option(
        None, "--policy", help="scripted, random or openai.", show_default=False
    ),
    mistakes: float | None = typer.Option(
        None, "--mistakes", min=0, max=1, help="Scripted policy: share of attempts with a mistake."
    ),
    base_url: str | None = typer.Option(
        None, "--base-url", help="OpenAI-compatible endpoint. Its key: WEBGYM_API_KEY.", show_default=False
    ),
    model: str | None = typer.Option(None, "--model", help="Model at that endpoint.", show_default=False),
    profile: str | None = typer.Option(
        None,
        "--profile",
        help="Family of the model (image sizes, grid, think tags, sampling); else by its name.",
        show_default=False,
    ),
    judge: str | None = typer.Option(
        None,
        "--judge",
        help="offline, rubric or module:function; rubric with --judge-base-url.",
        show_default="offline",
    ),
    judge_base_url: str | None = typer.Option(
        None,
        "--judge-base-url",
        help="Endpoint of the rubric judge. Its key: WEBGYM_JUDGE_API_KEY, else WEBGYM_API_KEY.",
        show_default=False,
    ),
    judge_model: str | None = typer.Option(
        None, "--judge-model", help="Model at that endpoint.", show_default=False
    ),
    marks: bool | None = typer.Option(
        None, "--marks/--coordinates", help="Interaction mode; else the profile's.", show_default=False
    ),
    server: str | None = typer.Option(
        None, "--server", help="A running browser server; else one is started here.", show_default=False
    ),
    token_file: Path | None = typer.Option(
        None, "--token-file", help="Holds the server's token; else WEBGYM_TOKEN does.", show_default=False
    ),
    sites: str | None = typer.Option(
        None,
        "--sites",
        help="A running offline web (token: WEBGYM_SITES_TOKEN); else it is served here.",
        show_default=False,
    ),
    seed: int | None = typer.Option(None, "--seed", help="Of everything random.", show_default="0"),
    skip_corrupt: bool = typer.Option(
        False, "--skip-corrupt", help="Resume: go on without records that cannot be trusted."
    ),
    report: bool = typer.Option(True, "--report/--no-report", help="Write report.html at the end."),
) -> None:
    """Collect trajectories: attempt every task, judge, and keep all of it in a run folder.

    A run that was killed goes on with --resume RUN: nothing is lost and nothing is made twice.
    """
    from rich.console import Console

    from webgym.cli import _run
    from webgym.cli._judge import judge_choice
    from webgym.cli._summary import print_summary
    from webgym.collection import ServerChoice, collect
    from webgym.collection import resume as go_on
    from webgym.core.errors import UsageError
    from webgym.report import write_report

    console = Console()
    secrets = _run.secrets(token_file)
    show, tell = _run.show_on(console), _run.tell_on(console)
    servers = ServerChoice(url=server, sites_url=sites)
    if resume is not None and out is None:
        folder, changed = resume, servers if server or sites else None
        summary = _run.run(
            lambda: go_on(
                folder, secrets=secrets, server=changed, skip_corrupt=skip_corrupt, show=show, tell=tell
            )
        )
    elif out is not None and resume is None:
        folder = out
        overrides = {
            "seed": seed,
            "samples": samples,
            "tasks": {"file": tasks, "split": split, "count": limit},
            "agent": {
                "profile": profile,
                "mode": None if marks is None else ("marks" if marks else "coordinates"),
            },
            "collector": {"sessions": sessions},
            "server": {"url": server, "sites_url": sites},
        }
        settings = _run.settings(config, overrides)
        if policy or base_url or mistakes is not None:
            choice = _run.policy_choice(policy, mistakes or 0.0, base_url, model)
            settings = settings.model_copy(update={"policy": choice})
        if judge or judge_base_url or judge_model:
            judged = judge_choice(judge, judge_base_url, judge_model, default=settings.judge)
            settings = settings.model_copy(update={"judge": judged})
        summary = _run.run(lambda: collect(settings, folder, secrets=secrets, show=show, tell=tell))
    else:
        raise UsageError("give either --out or --resume", hint="--out makes a run, --resume goes on with one")
    path = write_report(folder) if report else None
    print_summary(summary, console)
    console.print(f"\nrun      {folder}", highlight=False, soft_wrap=True)
    if path is not None:
        console.print(f"report   {path}", highlight=False, soft_wrap=True)
