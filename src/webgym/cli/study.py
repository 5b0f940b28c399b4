"""``webgym study``: the paper's study in miniature."""

from __future__ import annotations

from pathlib import Path

import typer


def command(
    config: list[Path] = typer.Argument(
        None, help="Settings (YAML) laid over the study's own; see webgym.tiny.study.", show_default=False
    ),
    weights: Path | None = typer.Option(
        None,
        "--weights",
        help="First weights, a model of webgym pretrain; the package's if not given.",
        show_default=False,
    ),
    out: Path | None = typer.Option(
        None, "--out", help="Folder; unfinished trainings in it are continued.", show_default=False
    ),
    seeds: int = typer.Option(3, "--seeds", min=1, help="Trainings per row."),
    row: list[str] = typer.Option(None, "--row", help="A row; may be repeated. All if not given."),
    list_rows: bool = typer.Option(False, "--list", help="Name the rows and do nothing."),
) -> None:
    """Train the tiny policy by every row of the paper's study, and compare: hours, resumable.

    Pages are drawn once and attempted without browser sessions, which is many times faster; --help of
    `webgym train` and the settings say how to make the same with browsers (server.static: false).
    Writes study.md, study.json and study.png after every training.
    """
    from rich.console import Console

    from webgym.cli import _run
    from webgym.core.errors import ConfigError, UsageError
    from webgym.rollout.files import make_folder

    try:
        import torch
    except ImportError as error:
        raise ConfigError("training needs torch", hint="pip install 'webgym-rl[train]'") from error
    from webgym.tiny.demo import WEIGHTS
    from webgym.tiny.study import carry_out, findings, read_study, table

    study, console = read_study(config or []), Console()
    rows = row or list(study.rows)
    if unknown := [each for each in rows if each not in study.rows]:
        raise UsageError(f"unknown row {unknown[0]!r}", hint=f"rows: {', '.join(study.rows)}")
    if list_rows:
        for name in rows:
            typer.echo(name)
        return
    if out is None:
        raise UsageError("there is no folder for the study", hint="--out FOLDER makes one or goes on in it")
    torch.set_num_threads(1)
    first = weights or WEIGHTS
    make_folder(out)

    def tell(line: str) -> None:
        console.print(line, highlight=False, soft_wrap=True, markup=False)

    found = _run.run(lambda: carry_out(study, first, rows, seeds, out, tell))
    for line in (*table(study, found), "", *findings(study, found)):
        tell(line)
