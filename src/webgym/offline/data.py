"""Loads words and specifications from TOML files next to the code, decoded into typed structs."""

from __future__ import annotations

import codecs
import inspect
import re
import sys
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from webgym.core.errors import SitesError

T = TypeVar("T")


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of structs for TOML tables; unknown keys are errors."""


class Row(Table, frozen=True, array_like=True):
    """Base of structs for TOML arrays, with values in the order of the fields."""


def load(package: str, file: str, shape: type[T]) -> T:
    """Load a TOML file of a package.

    Args:
        package: dotted name of the package that contains the file.
        file: name of the file.
        shape: the type of its contents.

    Raises:
        SitesError: the contents do not match the type; the message has the file and the key.
    """
    return _decoded(resources.files(package).joinpath(file).read_bytes(), f"{package}/{file}", shape)


def load_beside(module: str, file: str, shape: type[T]) -> T:
    """Load a TOML file in the folder of a module, which need not be in a package.

    Raises:
        SitesError: there is no such file, or its contents do not match the type.
    """
    path = Path(inspect.getfile(sys.modules[module])).with_name(file)
    if not path.is_file():
        raise SitesError(f"there is no file {path}", hint=f"it has to contain the specification of {module}")
    return _decoded(path.read_bytes(), str(path), shape)


def _decoded(raw: bytes, name: str, shape: type[T]) -> T:
    try:
        return msgspec.toml.decode(raw.removeprefix(codecs.BOM_UTF8), type=shape)
    except msgspec.ValidationError as error:
        told = _with_keys(str(error), msgspec.toml.decode(raw.removeprefix(codecs.BOM_UTF8)), shape)
        raise SitesError(f"{name}: {told}", hint="correct the file") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise SitesError(f"{name}: {error}", hint="correct the file") from error


def _with_keys(message: str, data: Any, shape: Any) -> str:
    """An error's message with keys of tables in its path (``$.key``), where msgspec has ``[...]``."""
    said, at, path = message.rpartition("`$")
    table = data
    for part in re.findall(r"\w+|\[\.\.\.\]", path) if at else ():
        if part != "[...]":
            table = table[int(part) if isinstance(table, list) else part]
            continue
        entries = dict(table)
        table.clear()
        for key, value in entries.items():  # the first one with which the error occurs
            table[key] = value
            try:
                msgspec.convert(data, shape)
            except msgspec.ValidationError as error:
                if str(error) == message:
                    break
        path, table = path.replace(part, f".{key}", 1), value
    return said + at + path
