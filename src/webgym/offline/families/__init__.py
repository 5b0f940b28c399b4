"""The kinds of websites of the offline web, one file each."""

from __future__ import annotations

import importlib
import pkgutil

from webgym.offline.website import Website


def _families() -> tuple[type[Website], ...]:
    """Every :class:`Website` that a module of this package defines, in the order of their names."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    return tuple(sorted(Website.__subclasses__(), key=lambda family: family.family))


FAMILIES = _families()
