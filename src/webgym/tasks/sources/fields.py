"""The fields of a record, in the spellings and encodings that copies of a source use, and companion files."""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import TypeVar

import msgspec

from webgym.core.websites import host_of
from webgym.tasks.missing_values import is_missing_value

T = TypeVar("T")

_LONGEST_LITERAL = 1_000_000
"""Most characters of a Python literal that is parsed; the values read here are far shorter."""


class PassedOver(msgspec.Struct, frozen=True):
    """A file that was not read as tasks.

    Attributes:
        file: path of the file.
        reason: what kind of file it is, or what is wrong with it.
    """

    file: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}: {self.reason}"


class Unusable(ValueError):
    """Raised for a record that gives no task. The message is the reason, without quoting the record."""


@lru_cache(maxsize=4096)
def _folded(name: str) -> str:
    return "".join(letter for letter in name.casefold() if letter.isalnum())


class Fields:
    """A record's values by name, ignoring case, spaces and punctuation of the names.

    ``"Final answer"``, ``"final_answer"`` and ``"FinalAnswer"`` are the same field.

    Methods with several names return the first of these fields that exists and is not missing
    (:func:`webgym.tasks.missing_values.is_missing_value`).

    Attributes:
        record: as it was read.
        key: key of the record, if its file is a mapping.
    """

    __slots__ = ("_values", "key", "record")

    def __init__(self, record: Mapping[str, object], key: str | None = None) -> None:
        self.record = record
        self._values = {_folded(name): value for name, value in record.items()}
        self.key = key

    def __contains__(self, name: str) -> bool:
        return _folded(name) in self._values

    def value(self, *names: str) -> object:
        """The value of a field; ``None`` if there is none."""
        for name in names:
            value = self._values.get(_folded(name))
            if not is_missing_value(value):
                return value
        return None

    def text(self, *names: str) -> str | None:
        """A field as text without surrounding white space; ``None`` if there is none.

        Raises:
            Unusable: it is not a text, or its encoding is broken.
        """
        value = self.value(*names)
        return None if value is None else as_text(value, names[0])

    def website(self, *names: str) -> str | None:
        """A field with a website, or with several, joined by spaces; ``None`` if there is none."""
        return " ".join(texts(self.value(*names))) or None

    def instruction(self, *names: str) -> str:
        """The field with the instruction.

        Raises:
            Unusable: there is none, or it is not a text.
        """
        value = self.value(*names)
        if value is None:
            known = any(name in self for name in names)
            raise Unusable(f"{names[0]!r} is empty" if known else f"no field {' or '.join(map(repr, names))}")
        if not isinstance(value, (str, bytes)):
            raise Unusable(f"{names[0]!r} is {kind(value)}, not a text")
        return as_text(value, names[0])

    def answer(self, *names: str) -> str | None:
        """A field as an answer; words such as "none" count as answers. ``None`` if there is none."""
        for name in names:
            value = self._values.get(_folded(name))
            if isinstance(value, float) and value.is_integer():  # in a column with missing values
                value = int(value)
            if value is not None and value != "" and not (isinstance(value, float) and math.isnan(value)):
                return as_text(value, name) or None
        return None

    def packed(self, *names: str) -> object:
        """A field, parsed if it is a string of JSON or a Python literal.

        Raises:
            Unusable: the string is neither.
        """
        value = self.value(*names)
        return unpacked(value, names[0]) if isinstance(value, (str, bytes)) else value

    def native_id(self, *names: str) -> str | None:
        """The record's own id: a field, else the record's key in its file."""
        value = self.value(*names)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if value is None or isinstance(value, bool) or not isinstance(value, (str, int, float)):
            return self.key
        return as_text(value, names[0])


def kind(value: object) -> str:
    """The JSON type of a value, in words."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "a boolean"
    if isinstance(value, (int, float)):
        return "a number"
    if isinstance(value, Mapping):
        return "an object"
    return "a text" if isinstance(value, str) else "a list" if isinstance(value, (list, tuple)) else "no JSON"


def as_text(value: object, name: str) -> str:
    """A text, or a number as text, without surrounding white space.

    Raises:
        Unusable: it is neither, or its encoding is broken.
    """
    if isinstance(value, bytes):
        value = value.decode("utf-8", "surrogateescape")
    if not isinstance(value, str):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise Unusable(f"{name!r} is {kind(value)}, not a text")
        value = str(value)
    text = value.strip()
    if not text.isascii():
        try:
            text.encode()
        except UnicodeEncodeError as error:
            raise Unusable(f"{name!r} is not valid Unicode") from error
    return text


def texts(value: object) -> tuple[str, ...]:
    """The texts and numbers in a list, or a single one, as text, without missing values and other types."""
    values = value if isinstance(value, (list, tuple)) else [value]
    result = []
    for item in values:
        if not is_missing_value(item) and isinstance(item, (str, int, float)) and not isinstance(item, bool):
            try:
                result.append(as_text(item, "it"))
            except Unusable:
                continue  # a hint with a broken encoding
    return tuple(result)


def unpacked(packed: str | bytes, name: str) -> object:
    """The value of a string of JSON or a Python literal.

    Raises:
        Unusable: it is neither.
    """
    text = as_text(packed, name)
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    if len(text) > _LONGEST_LITERAL:
        raise Unusable(f"{name!r} is longer than {_LONGEST_LITERAL} characters")
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        raise Unusable(f"{name!r} is neither JSON nor a Python literal") from error


@lru_cache(maxsize=4096)
def website_url(given: str) -> str | None:
    """The URL of a website given as a bare host or a URL; ``None`` if it is neither.

    A bare host gets the scheme https. A URL is kept.
    """
    url = given.strip().strip("<>").strip()
    scheme, separator, _ = url.partition("://")
    if separator and scheme.casefold() not in ("http", "https"):
        return None
    if not separator:
        if "@" in url.partition("/")[0]:
            return None  # an e-mail address
        url = f"https://{url.removeprefix('//')}"
    try:
        host = host_of(url)
    except ValueError:
        return None
    if ("." not in host and ":" not in host) or len(url.split()) > 1:
        return None
    return url if "/" in url.partition("://")[2] else f"{url}/"


class Companions:
    """Reads the companion files in the folder of a file of tasks, each once.

    Args:
        folder: of the tasks' file; ``None`` if there is none.

    Attributes:
        folder: as given.
        broken: companions that could not be read.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._loaded: dict[str, object] = {}
        self.broken: list[PassedOver] = []

    def load(self, name: str, build: Callable[[object], T]) -> T | None:
        """The result of ``build`` for a companion's JSON; ``None`` if there is no such file, or it is broken.

        Args:
            name: of the file, relative to the folder; paths outside of the folder are not read.
            build: converts the decoded JSON; may raise ValueError.
        """
        if name not in self._loaded:
            self._loaded[name] = self._read(name, build)
        return self._loaded[name]  # type: ignore[return-value]

    def _read(self, name: str, build: Callable[[object], T]) -> T | None:
        path = self._find(name)
        if path is None:
            return None
        try:
            return build(msgspec.json.decode(path.read_bytes()))
        except OSError as error:
            self.broken.append(PassedOver(str(path), f"cannot be read: {error.strerror}"))
        except (ValueError, RecursionError) as error:
            self.broken.append(PassedOver(str(path), f"is not a companion file of the tasks: {error}"))
        return None

    def _find(self, name: str) -> Path | None:
        parts = PurePosixPath(name.replace("\\", "/")).parts
        if self.folder is None or not parts or ".." in parts or "\0" in name:
            return None
        whole = self.folder.joinpath(*(part for part in parts if part not in ("/", ".")))
        for path in (whole, self.folder / parts[-1]):
            try:
                if path.is_file():
                    return path
            except OSError:  # the file name is too long
                return None
        return None
