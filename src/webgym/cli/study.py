"""``webgym study``: repeat the paper's training study with the tiny policy."""

from __future__ import annotations

from pathlib import Path

import typer

from webgym.cli._fields import Given, Options, takes

STUDY = Options("webgym.study.conditions:StudyConfig")


@takes(settings=STUDY)
def command(
    settings: Given,
    config: list[Path] = typer.Argument(
        None,
        help="YAML files that override the study's settings; see webgym.study.conditions.",
        show_default=False,
    ),
    weights: Path | None = typer.Option(
        None,
        "--weights",
        help="Folder of the initial weights, as webgym pretrain writes them.",
        show_default="the weights in the package",
    ),
    out: Path | None = typer.Option(
        None,
        "--out",
        help="Folder of the study. Unfinished trainings in it are continued.",
        show_default=False,
    ),
    seeds: int = typer.Option(3, "--seeds", min=1, help="Number of trainings per row."),
    row: list[str] = typer.Option(
        None, "--row", help="Row of the study to train. May be repeated.", show_default="all"
    ),
    plan_only: bool = typer.Option(
        False, "--plan", help="Print the rows, their cost and what they can show, and exit."
    ),
) -> None:
    """Train the tiny policy with the settings of every row of the paper's study, and compare the results.

    Takes hours, and can be resumed. Pages are rendered once and attempted without browsers, which is many
    times faster; the setting server.static: false uses browsers. Writes study.md, study.json and study.png
    after every training.
    """
    from webgym.cli import _run
    from webgym.cli._checks import check_folder, check_model
    from webgym.core.errors import UsageError

    if out is None and not plan_only:
        raise UsageError("the study needs a folder", hint="--out FOLDER makes or continues one")
    if out is not None:
        check_folder(out)
    if weights is not None:
        check_model(weights)
    import torch
    from rich.console import Console

    from webgym.cli._print import say
    from webgym.store.files import locked, make_folder
    from webgym.study.conditions import carry_out, findings, plan, read_results, read_study, table
    from webgym.study.demo import WEIGHTS

    study = read_study(config or [], settings)
    rows = row or list(study.rows)
    if unknown := [name for name in rows if name not in study.rows]:
        raise UsageError(f"unknown row {unknown[0]!r}", hint=f"choose one of {', '.join(study.rows)}")
    console, initial = Console(), weights or WEIGHTS
    if plan_only:
        print("\n".join(rows))
    for line in plan(study, rows, seeds, read_results(out) if out is not None else []):
        say(line, console)
    if plan_only or out is None:
        return
    torch.set_num_threads(1)
    make_folder(out)
    with locked(out):
        results = _run.run(
            lambda: carry_out(study, initial, rows, seeds, out, lambda line: say(line, console)),
            kept="finished stages of trainings are stored",
        )
    for line in (*table(study, results), "", *findings(study, results)):
        say(line, console)
