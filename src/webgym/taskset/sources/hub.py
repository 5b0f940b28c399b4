"""Records from the Hugging Face hub, through the optional library ``datasets``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from webgym.core.errors import ConfigError
from webgym.taskset.sources.base import Skipped
from webgym.taskset.sources.fields import Fields
from webgym.taskset.sources.reading import Found, Record

HUB = "hub:"
"""Prefix of a data set on the hub: ``hub:<datasets id>[:[<configuration>/]<split>]``."""


def hub_records(where: str) -> Iterator[Found]:
    """The rows of a data set's split, or of all its splits.

    Raises:
        ConfigError: the library is not installed, or cannot load the data set.
    """
    name, _, part = where.removeprefix(HUB).partition(":")
    configuration, _, split = part.rpartition("/")
    loaded = _load(name, configuration or None, split or None)
    tables = {split: loaded} if split else dict(loaded)
    for title, table in tables.items():
        yield from _rows(f"{HUB}{name}:{title}", table)


def _load(name: str, configuration: str | None, split: str | None) -> Any:
    try:
        import datasets
    except ImportError as error:
        raise ConfigError(
            "reading from the hub needs the library datasets", hint="pip install 'webgym-rl[hub]'"
        ) from error
    if not name:
        raise ConfigError(
            f"{HUB!r} needs the id of a data set", hint="give hub:<datasets id>[:[<configuration>/]<split>]"
        )
    try:
        return datasets.load_dataset(name, configuration, split=split)
    except Exception as error:  # of the network, the hub or the library
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise ConfigError(
            f"the data set {name!r} cannot be loaded from the hub: {reason}",
            hint="check name and network, for gated data `hf auth login`; or give a downloaded folder",
        ) from error


def _rows(name: str, table: Any) -> Iterator[Found]:
    row = 0
    try:
        for value in table:
            row += 1
            yield Record(name, f"row {row}", Fields(value))
    except (OSError, ValueError) as error:  # pyarrow's errors are subclasses of these
        yield Skipped(name, f"after row {row}", f"the rest cannot be read: {error}")
