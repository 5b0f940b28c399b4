"""Refuse files that cannot be written before their contents are computed."""

from __future__ import annotations

from pathlib import Path

from webgym.core.errors import ConfigError


def check_writable(file: Path | None) -> None:
    """Refuse an output file that cannot be written, before anything is measured.

    Raises:
        ConfigError: the path is a folder, or its folder does not exist.
    """
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"{file} cannot be written", hint="give a file in a folder that exists")


def check_figure(file: Path | None) -> None:
    """Refuse a figure's file that cannot be written, or has no suffix of a format.

    Raises:
        UsageError: that is so.
    """
    from webgym.core.plotting import check_suffix

    check_writable(file)
    if file is not None:
        check_suffix(file)
