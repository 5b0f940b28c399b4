"""Options that several commands share."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from webgym.cli._fields import Option, Options
from webgym.core.errors import ConfigError
from webgym.llm.prices import Prices
from webgym.offline.config import SitesConfig
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
Price: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--price",
        help="Price in dollars per million tokens: PROMPT,COMPLETION or PROMPT,CACHED,COMPLETION.",
        show_default=False,
    ),
]
PriceFile: TypeAlias = Annotated[
    Path | None,
    typer.Option("--prices", help="YAML file of prices by model, instead of --price.", show_default=False),
]
WriteReport: TypeAlias = Annotated[
    bool, typer.Option("--report/--no-report", help="Write report.html when the run ends.")
]


def run_options(*, split: str, limit: str, **more: str | Option) -> Options:
    """The options that set fields of :class:`webgym.run.config.RunConfig`.

    Args:
        split: the default that the help shows for ``--split``.
        limit: the default that the help shows for ``--limit``.
        more: further options, by name.
    """
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
                "judge.rubric.chat.base_url", help=f"OpenAI-compatible endpoint of the judge's model; {key}."
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


def number(value: str) -> int:
    """The value of an option that takes a positive number, though its field takes more.

    Raises:
        BadParameter: it is none.
    """
    if not (value.isascii() and value.isdecimal() and int(value) > 0):
        raise typer.BadParameter(f"{value!r} is not a positive number")
    return int(value)


def prices_of(price: str | None, file: Path | None) -> Prices:
    """The prices of model calls.

    Raises:
        ConfigError: both were given, or what was given has no prices.
    """
    if price and file:
        raise ConfigError("--price and --prices exclude each other", hint="give one of them")
    return Prices.parse(price) if price else Prices.read(file) if file else Prices()


def mode_of(marks: bool | None) -> str | None:
    """The interaction mode of ``--marks/--coordinates``; ``None`` if the option was not given."""
    return None if marks is None else "marks" if marks else "coordinates"


def web_options(*options: str, **more: str | Option) -> Options:
    """The options that choose websites of the offline web.

    Args:
        options: names of :class:`webgym.offline.config.SitesConfig`.
        more: further options, by name.
    """
    every: dict[str, str | Option] = {
        "seed": "seed",
        "collection": Option(
            "collection", help="large or small websites, or cross: tasks that need two of the large ones."
        ),
        "per_family": Option(
            "per_family", help="Number of websites per family.", default="50 large, 72 small"
        ),
    }
    chosen = {name: every[name] for name in options} | more
    return Options(SitesConfig, {f"--{name.replace('_', '-')}": option for name, option in chosen.items()})


def has_desktop() -> bool:
    """Whether a browser would open a window; a text browser would take over the terminal."""
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
