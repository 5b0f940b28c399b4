"""Functions shared by the command lines of benchmarks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import typer

from webgym.core.errors import ConfigError, UsageError, WebGymError


def run(command: Callable[..., None], arguments: Sequence[str] | None = None) -> None:
    """Run a function with Typer parameters as a command, and exit; an expected error is one line."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(command)
    try:
        app(args=arguments)
    except WebGymError as error:
        print(error, file=sys.stderr)
        sys.exit(2 if isinstance(error, UsageError) else 1)


def check_writable(file: Path | None) -> None:
    """Refuse an output file that cannot be written, before anything is measured.

    Raises:
        ConfigError: the path is a folder, or its folder does not exist.
    """
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"{file} cannot be written", hint="give a file in a folder that exists")
