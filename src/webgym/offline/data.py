"""Words and specifications are data: TOML files beside the family, decoded into typed structs."""

from __future__ import annotations

import inspect
import sys
from importlib import resources
from pathlib import Path
from typing import TypeVar

import msgspec

from webgym.core.errors import SitesError

T = TypeVar("T")


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of a file: values by key."""


class Row(Table, frozen=True, array_like=True):
    """An array of a file: values in the order of the fields."""


def load(package: str, file: str, shape: type[T]) -> T:
    """The contents of a TOML file of a package.

    Args:
        package: dotted name of the package that the file lies in.
        file: its name.
        shape: the struct that it must fit; unknown keys are refused where the struct forbids them.

    Raises:
        SitesError: the file does not fit; the message names file and key.
    """
    return _decoded(resources.files(package).joinpath(file).read_bytes(), f"{package}/{file}", shape)


def load_beside(module: str, file: str, shape: type[T]) -> T:
    """The contents of a TOML file that lies beside a module, in a package or not.

    Raises:
        SitesError: there is no such file, or it does not fit.
    """
    path = Path(inspect.getfile(sys.modules[module])).with_name(file)
    if not path.is_file():
        raise SitesError(f"there is no {path}", hint=f"write the specification of {module} into it")
    return _decoded(path.read_bytes(), str(path), shape)


def _decoded(raw: bytes, name: str, shape: type[T]) -> T:
    try:
        return msgspec.toml.decode(raw, type=shape)
    except msgspec.DecodeError as error:  # also what does not fit, with the key as "$.key"
        raise SitesError(f"{name}: {error}", hint="correct the file") from error
