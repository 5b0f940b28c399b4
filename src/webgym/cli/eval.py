"""``webgym eval``: evaluate a policy on a test set."""

from __future__ import annotations

import shlex
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from webgym.cli import _options as options
from webgym.cli._fields import Given, Option, takes
from webgym.cli._print import AsJson, AsLatex, AsMarkdown, print_json, print_tables, refuse_several, say
from webgym.core.errors import ConfigError, UsageError
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS
from webgym.core.text import plain

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Sequence

    from rich.console import Console

    from webgym.results.evaluation import Evaluation
    from webgym.results.summary import Summary


RUN = options.run_options(
    split="test; all tasks if none has a split",
    limit="all tasks of a file, 20 of the offline web",
    benchmark=Option(
        "tasks.benchmark",
        help="Benchmark to evaluate on: its public file is read as it is, and its own judge decides unless "
        "--judge names another.",
    ),
    file=Option(
        "tasks.file",
        help="The benchmark's public file, or hub:OWNER/NAME[@REVISION][:SPLIT].",
        default="none; as --tasks",
    ),
)


@takes(settings=RUN)
def command(
    context: typer.Context,
    *,
    out: Path | None = typer.Option(
        None, "--out", help="Run folder to make.", show_default="a new folder in runs/"
    ),
    resume: options.Resume = None,
    of: list[Path] = typer.Option(
        [],
        "--of",
        help="Print the results of this run instead of collecting one. May be repeated, for one table. "
        "--judge then selects one of their judges, by its name or the beginning of it; with --judge-base-url "
        "and --judge-model the judge first judges what it has not judged yet.",
        show_default=False,
    ),
    config: options.Config = None,
    settings: Given,
    budget: str | None = typer.Option(
        None,
        "--budget",
        help="Maximum number of steps for easy, medium and hard tasks.",
        show_default="30,50,70",
    ),
    token_file: options.TokenFile = None,
    skip_corrupt: options.SkipCorrupt = False,
    retry_errors: options.RetryErrors = False,
    report: options.WriteReport = True,
    as_json: AsJson = False,
    as_markdown: AsMarkdown = False,
    as_latex: AsLatex = False,
) -> None:
    """Evaluate a policy on a test set with the paper's test budgets, and print success rates with intervals.

    An evaluation is a run like any other: it survives kill -9, is resumed with --resume, and can be judged
    again and browsed. Without network and model: webgym eval --policy scripted --limit 50. A benchmark:
    webgym eval --benchmark online-mind2web --file FILE, with endpoints of the policy and of the judge.
    """
    from webgym.cli import _run
    from webgym.cli._summary import print_losses, print_unjudged
    from webgym.report.write import write_report
    from webgym.results.evaluation import evaluate
    from webgym.store.runs import RECORDED

    if sum(1 for option in (out, resume, of) if option) > 1:
        raise UsageError("--out, --resume and --of exclude each other", hint="see webgym eval --help")
    refuse_several(json=as_json, markdown=as_markdown, latex=as_latex)
    refuse_several(**{name: bool(context.params.get(name)) for name in ("tasks", "file")})
    console = _run.lasting_console(stderr=as_json or as_markdown or as_latex)
    if of:
        used = ("of", "judge", "judge_base_url", "judge_model", "as_json", "as_markdown", "as_latex")
        _run.refuse_unused(context, used, "--of prints a run's results")
        given = settings.get("judge", {})
        judge = _judge_stored(of, given, console) if "rubric" in given else given.get("name", RECORDED)
        results = [evaluate(run, judge) for run in of]
        _print_results(results, console, as_json, as_markdown, as_latex)
        for run, result in zip(of, results, strict=True):
            unjudged = result.rows["overall"].no_reward.get(Outcome.JUDGE_ERROR, 0)
            resume_it = f"webgym eval --resume {shlex.quote(str(run))}"
            print_unjudged(unjudged, resume_it if judge == RECORDED else "this command again", console)
        return
    if resume is not None:
        folder = resume
        _run.refuse_unused_with_resume(context, folder)
        job = _run.resume_job(folder, settings, skip_corrupt=skip_corrupt, retry_errors=retry_errors)
    else:
        folder = out or Path("runs") / f"eval-{datetime.now():%Y%m%d-%H%M%S}"
        job = _collection(folder, config or (), settings, budget)
    resumed_by = ("webgym eval", folder)
    summary, finishing = _run.make_run(
        job, resumed_by=resumed_by, console=console, token_file=token_file, report=report
    )
    path = write_report(folder) if report else None
    _print_results([evaluate(folder)], console, as_json, as_markdown, as_latex)
    print_losses(summary, console)
    _run.end(summary, resumed_by, console, report=path, finishing=finishing)


def _judge_stored(runs: Sequence[Path], given: Given, console: Console) -> str:
    """Judge stored runs with a judge that asks a model; its name."""
    from webgym.cli._judge_options import judge_choice
    from webgym.cli.judge import judge_stored
    from webgym.judge.factory import name_of
    from webgym.llm.prices import Prices
    from webgym.rollout.rejudge import RejudgeConfig

    choice = judge_choice(given)
    for run in runs:
        judge_stored(run, choice, RejudgeConfig(), Prices(), console)
    return name_of(choice)


def _collection(
    folder: Path, config: Sequence[Path], settings: Given, budget: str | None
) -> Callable[..., Coroutine[Any, Any, Summary]]:
    """The job that collects a new evaluation; see :func:`webgym.cli._run.make_run`."""
    from functools import partial

    from webgym.cli import _run
    from webgym.cli._checks import check_folder
    from webgym.core.settings import merged
    from webgym.results.evaluation import TEST_BUDGET
    from webgym.run.collect import collect

    check_folder(folder)
    # The slowest attempts do not end early: they would have fewer steps than the others.
    defaults = {
        "attempt": {f"budget_{level}": getattr(TEST_BUDGET, level) for level in LEVELS},
        "collector": {"straggler_share": 1.0},
    }
    always = {"tasks": {"spread": True, "split": "test"}, "attempt": _budgets(budget)}
    run = _run.settings(config, merged(always, settings), defaults)
    if run.tasks.file is not None and run.tasks.count is None:
        run = run.model_copy(update={"tasks": run.tasks.model_copy(update={"count": "all"})})
    return partial(collect, run, folder)


def _print_results(
    results: Sequence[Evaluation], console: Console, as_json: bool, as_markdown: bool, as_latex: bool
) -> None:
    """Print results in the requested format on stdout, and notes on the console."""
    from webgym.results.evaluation import conditions, notes, tables

    if as_json:
        print_json(results[0] if len(results) == 1 else results)
        return
    shown = [*tables(results), *([conditions(results)] if as_markdown else [])]
    print_tables(shown, console, as_markdown=as_markdown, as_latex=as_latex)
    for result in results:
        for note in notes(result, alone=len(results) == 1):
            say(plain(f"{result.run}: {note}" if len(results) > 1 else note), console)


def _budgets(budget: str | None) -> dict[str, int]:
    if budget is None:
        return {}
    parts = [part.strip() for part in budget.split(",")]
    if len(parts) != 3 or not all(part.isascii() and part.isdecimal() for part in parts):
        raise ConfigError(f"--budget {budget!r} is not three numbers", hint="as in --budget 30,50,70")
    return {f"budget_{level}": int(part) for level, part in zip(LEVELS, parts, strict=True)}
