"""Options that ``rollout`` and ``eval`` share, and the settings that come of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

if TYPE_CHECKING:
    from webgym.runs import RunConfig

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
Tasks: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--tasks",
        help="Task file of any format, or a folder; without one, the offline web's tasks.",
        show_default=False,
    ),
]
SplitOf: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--split",
        help="train, test, all, or unsplit (tasks that do not say).",
        show_default="train; every task where none says its split",
    ),
]


def _count(told: str) -> int | str:
    if told != "all" and not (told.isascii() and told.isdecimal() and int(told) > 0):
        raise typer.BadParameter(f"{told!r} is neither a number from 1 nor all")
    return told if told == "all" else int(told)


def _limit(default: str) -> Any:
    return typer.Option(
        "--limit", metavar="N|all", parser=_count, help="Draw so many tasks.", show_default=default
    )


Limit: TypeAlias = Annotated[Any, _limit("all of a file of up to 100, else 20")]
LimitOfTest: TypeAlias = Annotated[Any, _limit("all of a file, 20 of the offline web")]
Samples: TypeAlias = Annotated[
    int | None, typer.Option("--samples", min=1, help="Attempts per task.", show_default="1")
]
Sessions: TypeAlias = Annotated[
    int | None,
    typer.Option("--sessions", min=1, help="Browser sessions at the same time.", show_default="16"),
]
PolicyName: TypeAlias = Annotated[
    str | None, typer.Option("--policy", help="scripted, random or openai.", show_default=False)
]
Mistakes: TypeAlias = Annotated[
    float | None,
    typer.Option("--mistakes", min=0, max=1, help="Scripted policy: share of attempts with a mistake."),
]
BaseUrl: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--base-url", help="OpenAI-compatible endpoint. Its key: WEBGYM_API_KEY.", show_default=False
    ),
]
Model: TypeAlias = Annotated[
    str | None, typer.Option("--model", help="Model at that endpoint.", show_default=False)
]
ProfileName: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--profile",
        help="Family of the model (image sizes, grid, think tags, sampling); else by its name.",
        show_default=False,
    ),
]
Marks: TypeAlias = Annotated[
    bool | None,
    typer.Option("--marks/--coordinates", help="Interaction mode; else the profile's.", show_default=False),
]
JudgeBaseUrl: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--judge-base-url",
        help="Endpoint of the rubric judge. Its key: WEBGYM_JUDGE_API_KEY, else WEBGYM_API_KEY.",
        show_default=False,
    ),
]
JudgeModel: TypeAlias = Annotated[
    str | None, typer.Option("--judge-model", help="Model at that endpoint.", show_default=False)
]
Server: TypeAlias = Annotated[
    str | None,
    typer.Option("--server", help="A running browser server; else one is started here.", show_default=False),
]
TokenFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--token-file", help="Holds the server's token; else WEBGYM_TOKEN does.", show_default=False
    ),
]
Sites: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--sites",
        help="A running offline web (token: WEBGYM_SITES_TOKEN); else it is served here.",
        show_default=False,
    ),
]
Seed: TypeAlias = Annotated[
    int | None, typer.Option("--seed", help="Of everything random.", show_default="0")
]
SkipCorrupt: TypeAlias = Annotated[
    bool,
    typer.Option("--skip-corrupt", help="Resume: continue without records that cannot be trusted."),
]
RetryErrors: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--retry-errors", help="Resume: attempt again what ended in errors and exhausted its retries."
    ),
]
WriteReport: TypeAlias = Annotated[
    bool, typer.Option("--report/--no-report", help="Write report.html at the end.")
]


def mode_of(marks: bool | None) -> str | None:
    """The interaction mode that was asked for, if any."""
    return None if marks is None else "marks" if marks else "coordinates"


def run_settings(
    files: list[Path] | None,
    overrides: Mapping[str, Any],
    policy: tuple[str | None, float | None, str | None, str | None],
    judge: tuple[str | None, str | None, str | None],
) -> RunConfig:
    """The settings of a run.

    Args:
        files: YAML, each laid over those before it.
        overrides: what other options say, in the shape of the settings; ``None`` overrides nothing.
        policy: name, share of mistakes, endpoint and model.
        judge: name, endpoint and model.

    Raises:
        ConfigError: something is missing or malformed.
    """
    from webgym.cli import _run
    from webgym.cli._judge_options import judge_choice

    settings = _run.settings(files or (), overrides, policy)
    if any(judge):
        settings = settings.model_copy(update={"judge": judge_choice(*judge, default=settings.judge)})
    return settings
