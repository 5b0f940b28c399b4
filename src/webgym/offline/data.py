"""Words and specifications are data: TOML files beside the family, decoded into typed structs."""

from __future__ import annotations

from importlib import resources
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
    raw = resources.files(package).joinpath(file).read_bytes()
    try:
        return msgspec.toml.decode(raw, type=shape)
    except msgspec.DecodeError as error:  # also what does not fit, with the key as "$.key"
        raise SitesError(f"{package}/{file}: {error}", hint="correct the file") from error
