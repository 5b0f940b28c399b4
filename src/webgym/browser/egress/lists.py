"""Lists of hosts that pages may not connect to, such as of trackers and adverts."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from webgym.core.errors import ConfigError


def blocked_names(files: Iterable[Path]) -> frozenset[str]:
    """The names in files of the hosts format: an address and names, or a name alone, per line.

    Names without a dot, such as ``localhost``, are left out; names below a listed one are not blocked.

    Raises:
        ConfigError: a file cannot be read.
    """
    names = set[str]()
    for file in files:
        try:
            lines = file.read_text().lower().splitlines()
        except (OSError, ValueError) as error:
            raise ConfigError(f"cannot read the block list {file}: {error}") from error
        for line in lines:
            first, *others = line.partition("#")[0].split() or [""]
            names.update(name for name in others or [first] if "." in name)
    return frozenset(names)
