"""Options that several commands share, and the settings of a run from the values of options."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from webgym.cli._fields import Given, Option, Options

if TYPE_CHECKING:
    from webgym.run.config import RunConfig

Resume: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--resume", help="Run folder to resume, with the settings that are stored in it.", show_default=False
    ),
]
Config: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(
        "--config",
        help="YAML file of settings. May be repeated; later files, and options, override earlier ones.",
        show_default=False,
    ),
]
TokenFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--token-file",
        help="File that contains the server's token; by default the token is read from WEBGYM_TOKEN.",
        show_default=False,
    ),
]
SkipCorrupt: TypeAlias = Annotated[
    bool, typer.Option("--skip-corrupt", help="With --resume: ignore records that are damaged.")
]
RetryErrors: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--retry-errors",
        help="With --resume: retry samples that ended in errors and have exhausted their retries.",
    ),
]
WriteReport: TypeAlias = Annotated[
    bool, typer.Option("--report/--no-report", help="Write report.html when the run ends.")
]
Collection: TypeAlias = Annotated[
    str,
    typer.Option(
        "--collection", help="large or small websites, or cross: tasks that need two of the large ones."
    ),
]


def run_options(*, split: str, limit: str, **more: str) -> Options:
    """The options that set fields of :class:`webgym.run.config.RunConfig`.

    Args:
        split: the default that the help shows for ``--split``.
        limit: the default that the help shows for ``--limit``.
        more: further options: name and field.
    """
    from webgym.run.config import RunConfig

    key = "its key is read from WEBGYM_JUDGE_API_KEY, else WEBGYM_API_KEY"
    return Options(
        RunConfig,
        {
            "--tasks": "tasks.file",
            "--split": Option("tasks.split", default=split),
            "--limit": Option("tasks.count", metavar="N|all", parse=_count, default=limit),
            "--samples": "samples",
            "--sessions": "collector.sessions",
            "--policy": "policy.name",
            "--mistakes": "policy.mistakes",
            "--base-url": "policy.chat.base_url",
            "--model": "policy.chat.model",
            "--profile": "agent.profile",
            "--marks/--coordinates": Option("agent.mode", parse=mode_of),
            "--judge": "judge.name",
            "--judge-base-url": Option(
                "judge.rubric.chat.base_url", help=f"OpenAI-compatible endpoint of the rubric judge; {key}."
            ),
            "--judge-model": "judge.rubric.chat.model",
            "--server": "server.url",
            "--sites": "server.sites_url",
            "--seed": "seed",
            **{f"--{name}": field for name, field in more.items()},
        },
    )


def _count(value: str) -> int | str:
    if value != "all" and not (value.isascii() and value.isdecimal() and int(value) > 0):
        raise typer.BadParameter(f"{value!r} is neither a positive number nor 'all'")
    return value if value == "all" else int(value)


def mode_of(marks: bool | None) -> str | None:
    """The interaction mode of ``--marks/--coordinates``; ``None`` if the option was not given."""
    return None if marks is None else "marks" if marks else "coordinates"


def run_settings(files: Sequence[Path] | None, given: Given) -> RunConfig:
    """The settings of a run.

    Args:
        files: YAML files; later ones override earlier ones.
        given: values of options, nested like the settings; they override the files.

    Raises:
        ConfigError: a file cannot be read, or a setting is missing or invalid.
    """
    from webgym.cli import _run
    from webgym.cli._judge_options import judge_choice

    judge = given.get("judge")
    settings = _run.settings(files or (), {name: value for name, value in given.items() if name != "judge"})
    if judge:
        settings = settings.model_copy(update={"judge": judge_choice(judge, default=settings.judge)})
    return settings
