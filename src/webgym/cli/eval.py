"""``webgym eval``: how often a policy succeeds on a test set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.cli import _options as options
from webgym.cli._fields import Given, takes
from webgym.core.errors import ConfigError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from webgym.rollout.evaluation import Evaluation
    from webgym.run_config import RunConfig


RUN = options.run_options(
    split="test; every task where none says its split",
    limit="all of a file, 20 of the offline web",
)


@takes(settings=RUN)
def command(
    *,
    out: Path | None = typer.Option(
        None, "--out", help="Run folder to make; a new one under runs/ if not given.", show_default=False
    ),
    resume: options.Resume = None,
    of: list[Path] = typer.Option(
        [],
        "--of",
        help="Collect nothing: the table of this run; several make one table. --judge then chooses one of "
        "these runs' judges, by its name or how that begins.",
        show_default=False,
    ),
    config: options.Config = None,
    settings: Given,
    budget: str | None = typer.Option(
        None, "--budget", help="Steps for easy, medium and hard tasks.", show_default="30,50,70"
    ),
    token_file: options.TokenFile = None,
    skip_corrupt: options.SkipCorrupt = False,
    retry_errors: options.RetryErrors = False,
    report: options.WriteReport = True,
    as_json: bool = typer.Option(False, "--json", help="Print the result as JSON."),
    as_markdown: bool = typer.Option(
        False, "--markdown", help="Print the table as Markdown, with the conditions of the run."
    ),
    as_latex: bool = typer.Option(False, "--latex", help="Print the table as LaTeX (booktabs)."),
) -> None:
    """Attempt a test set with the paper's test budgets and print success by difficulty with intervals.

    An evaluation is a run like any other: it survives kill -9, is resumed with --resume, and can be judged
    again and browsed. Offline, with no model: webgym eval --policy scripted --limit 50.
    """
    from functools import partial

    from rich.console import Console

    from webgym.cli import _run
    from webgym.cli._summary import all_failed, print_losses, print_retry
    from webgym.report.write import write_report
    from webgym.rollout.evaluation import evaluate
    from webgym.rollout.rejudge import RECORDED
    from webgym.runs import collect
    from webgym.settings import merged

    if sum(1 for each in (out, resume, of) if each) > 1:
        raise UsageError("--out, --resume and --of exclude each other", hint="see webgym eval --help")
    if as_json + as_markdown + as_latex > 1:
        raise UsageError("give one of --json, --markdown and --latex")
    console = Console(stderr=as_json or as_markdown or as_latex)
    if of:
        judge = settings.get("judge", {}).get("name", RECORDED)
        _tell([evaluate(run, judge) for run in of], console, as_json, as_markdown, as_latex)
        return
    if resume is not None:
        folder = resume
        job = _run.resume_job(folder, settings, skip_corrupt=skip_corrupt, retry_errors=retry_errors)
    else:
        defaults = {"tasks": {"spread": True, "split": "test"}, "attempt": _budgets(budget)}
        run = _as_a_test(options.run_settings(config, merged(defaults, settings)))
        folder = out or _new_folder()
        job = partial(collect, run, folder)
    resumed_by = ("webgym eval", folder)
    summary, finishing = _run.make_run(
        job, resumed_by=resumed_by, console=console, token_file=token_file, report=report
    )
    if report:
        write_report(folder)
    _tell([evaluate(folder)], console, as_json, as_markdown, as_latex)
    print_losses(summary, console)
    told = f"\nrun      {folder}\nbrowse   webgym view {folder}"
    console.print(told, highlight=False, soft_wrap=True, markup=False)
    print_retry(summary, f"webgym eval --resume {folder}", console)
    _run.raise_if_interrupted(finishing, resumed_by)
    if all_failed(summary):
        raise typer.Exit(1)


def _tell(
    found: Sequence[Evaluation], console: Console, as_json: bool, as_markdown: bool, as_latex: bool
) -> None:
    """Print results: what was asked for on stdout, what a person should know on the console."""
    import msgspec

    from webgym.cli._evaluation import conditions, notes, show, tables
    from webgym.core.text import plain
    from webgym.tables import latex, markdown
    from webgym.tables import show as show_tables

    if as_json:
        told = msgspec.json.encode(found[0] if len(found) == 1 else found)
        print(msgspec.json.format(told, indent=2).decode())
        return
    if as_latex:
        print(latex(tables(found)), end="")
    elif as_markdown:
        print(markdown([*tables(found), conditions(found)]), end="")
    elif len(found) == 1:
        show(found[0], console)
        return
    else:
        show_tables(tables(found), console)
    for one in found:
        for note in notes(one):
            name = f"{one.run}: " if len(found) > 1 else ""
            console.print(plain(f"{name}{note}"), highlight=False, soft_wrap=True, markup=False)


def _budgets(told: str | None) -> dict[str, int]:
    if told is None:
        return {}
    parts = [part.strip() for part in told.split(",")]
    if len(parts) != 3 or not all(part.isascii() and part.isdecimal() for part in parts):
        raise ConfigError(f"--budget {told!r} is not three numbers", hint="as in --budget 30,50,70")
    return dict(zip(("budget_easy", "budget_medium", "budget_hard"), map(int, parts), strict=True))


def _as_a_test(settings: RunConfig) -> RunConfig:
    """Settings with what tests differ in from training, where nobody has set it.

    The paper's test budgets; all of a task file; and no attempt is cut short by the clock because others have
    ended: in a test that would take from the slow ones what the fast ones had.
    """
    from webgym.rollout.evaluation import TEST_BUDGET

    wanted = {
        "budget_easy": TEST_BUDGET.easy,
        "budget_medium": TEST_BUDGET.medium,
        "budget_hard": TEST_BUDGET.hard,
    }
    attempt = {name: value for name, value in wanted.items() if name not in settings.attempt.model_fields_set}
    collector = settings.collector
    if "straggler_share" not in collector.model_fields_set:
        collector = collector.model_copy(update={"straggler_share": 1.0})
    tasks = settings.tasks
    if tasks.file is not None and tasks.count is None:
        tasks = tasks.model_copy(update={"count": "all"})
    attempts = settings.attempt.model_copy(update=attempt)
    return settings.model_copy(update={"attempt": attempts, "collector": collector, "tasks": tasks})


def _new_folder() -> Path:
    from datetime import datetime

    return Path("runs") / f"eval-{datetime.now():%Y%m%d-%H%M%S}"
