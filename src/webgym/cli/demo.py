"""``webgym demo``: the main job, end to end, on the offline web."""

from __future__ import annotations

from pathlib import Path

import typer


def command(
    out: Path | None = typer.Option(
        None, "--out", help="Run folder; a new one under runs/ if not given.", show_default=False
    ),
    tasks: int = typer.Option(200, "--tasks", min=1, help="Tasks, drawn from unseen (test) websites."),
    sessions: int = typer.Option(8, "--sessions", min=1, help="Browser sessions at the same time."),
    policy: str | None = typer.Option(
        None,
        "--policy",
        help="scripted, random or openai; scripted unless --base-url is given.",
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
    seed: int = typer.Option(1, "--seed", help="Of the tasks drawn and of everything random."),
) -> None:
    """Collect, judge and report trajectories on the offline web: no network, no model, no GPU needed.

    Starts the offline web and a browser server, attempts the tasks, writes the run folder and its
    report, and says where to look. A scripted policy plays; give --base-url and --model for a real one.
    """
    from datetime import datetime

    from rich.console import Console

    from webgym.cli._options import mode_of
    from webgym.cli._run import run, settings, show_on, tell_on
    from webgym.cli._summary import all_failed, print_summary
    from webgym.collection import collect
    from webgym.report import write_report

    console = Console()
    folder = out or Path("runs") / f"demo-{datetime.now():%Y%m%d-%H%M%S}"
    options = {
        "seed": seed,
        "tasks": {"split": "test", "count": tasks, "spread": True},
        "agent": {"profile": profile, "mode": mode_of(marks)},
        "collector": {"sessions": sessions},
    }
    config = settings((), options, (policy, mistakes, base_url, model))
    console.print(
        f"{tasks} tasks on unseen websites, {sessions} browser sessions, {config.policy.name} policy",
        highlight=False,
    )
    summary = run(lambda: collect(config, folder, show=show_on(console), tell=tell_on(console)))
    report = write_report(folder)
    print_summary(summary, console)
    console.print(f"\nreport   {report}\nbrowse   webgym view {folder}", highlight=False, soft_wrap=True)
    if all_failed(summary):
        raise typer.Exit(1)
