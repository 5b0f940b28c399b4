"""Options that ``rollout`` and ``eval`` share, and the settings that come of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from webgym.cli._fields import Given, Option, Options

if TYPE_CHECKING:
    from webgym.run_config import RunConfig

Resume: TypeAlias = Annotated[
    Path | None,
    typer.Option("--resume", help="Run folder to resume; its own settings hold.", show_default=False),
]
Config: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(
        "--config",
        help="YAML file of settings, under the options below. Repeatable: each is laid over the last.",
        show_default=False,
    ),
]
TokenFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--token-file",
        help="File that holds the server's token; by default the token is taken from WEBGYM_TOKEN.",
        show_default=False,
    ),
]
SkipCorrupt: TypeAlias = Annotated[
    bool,
    typer.Option("--skip-corrupt", help="Resume: continue without records that cannot be trusted."),
]
RetryErrors: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--retry-errors", help="Resume: retry samples that ended in errors and have exhausted their retries."
    ),
]
WriteReport: TypeAlias = Annotated[
    bool, typer.Option("--report/--no-report", help="Write report.html at the end.")
]


def run_options(*, split: str, limit: str, **more: str) -> Options:
    """The options that set fields of a run.

    Args:
        split, limit: the defaults that are shown for ``--split`` and ``--limit``.
        more: fields of further options, by the option's name.
    """
    from webgym.run_config import RunConfig

    key = "its key: WEBGYM_JUDGE_API_KEY, else WEBGYM_API_KEY"
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


def _count(told: str) -> int | str:
    if told != "all" and not (told.isascii() and told.isdecimal() and int(told) > 0):
        raise typer.BadParameter(f"{told!r} is neither a number from 1 nor all")
    return told if told == "all" else int(told)


def mode_of(marks: bool | None) -> str | None:
    """The interaction mode that was asked for, if any."""
    return None if marks is None else "marks" if marks else "coordinates"


def run_settings(files: Sequence[Path] | None, given: Given) -> RunConfig:
    """The settings of a run.

    Args:
        files: YAML, each laid over those before it.
        given: what options say, in the shape of the settings.

    Raises:
        ConfigError: something is missing or malformed.
    """
    from webgym.cli import _run
    from webgym.cli._judge_options import judge_choice

    judge = given.get("judge")
    settings = _run.settings(files or (), {name: each for name, each in given.items() if name != "judge"})
    if judge:
        settings = settings.model_copy(update={"judge": judge_choice(judge, default=settings.judge)})
    return settings
