"""The fields of a record, however a copy of the source spells and packs them."""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Iterable, Mapping
from functools import lru_cache

from webgym.core.websites import host_of
from webgym.tasks.missing_values import is_missing_value
from webgym.tasks.sources.problems import Unusable

_DEEPEST_LITERAL = 1_000_000
"""Characters of a Python literal that are looked at; the values we read are far shorter."""


@lru_cache(maxsize=4096)
def _folded(name: str) -> str:
    return "".join(letter for letter in name.casefold() if letter.isalnum())


class Fields:
    """A record's values by name, where case, spaces and punctuation of the names do not count.

    So ``"Final answer"``, ``"final_answer"`` and ``"FinalAnswer"`` are one field. The order of columns
    and columns that nobody asks for do not matter.

    Attributes:
        record: as it was read.
        key: what the record stands under, where its file is a mapping.
    """

    __slots__ = ("_values", "key", "record")

    def __init__(self, record: Mapping[str, object], key: str | None = None) -> None:
        self.record = record
        self._values = {_folded(name): value for name, value in record.items()}
        self.key = key

    def __contains__(self, name: str) -> bool:
        return _folded(name) in self._values

    def names(self) -> Iterable[str]:
        """The names of the fields, folded."""
        return self._values.keys()

    def value(self, *names: str) -> object:
        """The first of these fields that is there and not absent; ``None`` if there is none."""
        for name in names:
            found = self._values.get(_folded(name))
            if not is_missing_value(found):
                return found
        return None

    def text(self, *names: str) -> str | None:
        """The first of these fields that is there, as text without surrounding white space.

        Raises:
            Unusable: it is no text, or its encoding is broken.
        """
        found = self.value(*names)
        return None if found is None else as_text(found, names[0])

    def website(self, *names: str) -> str | None:
        """The first of these fields that is there, as it names a website, or several in a row."""
        return " ".join(texts(self.value(*names))) or None

    def instruction(self, *names: str) -> str:
        """The field that says what to do.

        Raises:
            Unusable: there is none, or it is no text.
        """
        found = self.value(*names)
        if found is None:
            known = any(name in self for name in names)
            raise Unusable(f"{names[0]!r} is empty" if known else f"no field {' or '.join(map(repr, names))}")
        if not isinstance(found, (str, bytes)):
            raise Unusable(f"{names[0]!r} is {kind(found)}, not a text")
        return as_text(found, names[0])

    def answer(self, *names: str) -> str | None:
        """The first of these fields that is there, as an answer: a word such as "none" may well be one."""
        for name in names:
            found = self._values.get(_folded(name))
            if found is not None and found != "" and not (isinstance(found, float) and math.isnan(found)):
                return as_text(found, name) or None
        return None

    def packed(self, *names: str) -> object:
        """The first of these fields that is there, unpacked if it is JSON or a Python literal in a string.

        Raises:
            Unusable: the string is neither.
        """
        found = self.value(*names)
        return unpacked(found, names[0]) if isinstance(found, (str, bytes)) else found

    def native_id(self, *names: str) -> str | None:
        """The record's own id: the first of these fields that is there, else the key it stands under."""
        found = self.value(*names)
        if isinstance(found, float) and found.is_integer():
            found = int(found)
        if found is None or isinstance(found, bool) or not isinstance(found, (str, int, float)):
            return self.key
        return as_text(found, names[0])


def kind(value: object) -> str:
    """What a value is, in words of JSON."""
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
            raise Unusable(f"{name!r} is not UTF-8, or holds half a character") from error
    return text


def texts(value: object) -> tuple[str, ...]:
    """The texts in a list, or a text by itself, without absent ones. Whatever else is in it is left out."""
    values = value if isinstance(value, (list, tuple)) else [value]
    found = []
    for each in values:
        if not is_missing_value(each) and isinstance(each, (str, int, float)) and not isinstance(each, bool):
            try:
                found.append(as_text(each, "it"))
            except Unusable:
                continue  # a scrap with a broken encoding; nothing of ours depends on it
    return tuple(found)


def unpacked(packed: str | bytes, name: str) -> object:
    """What a string of JSON or a Python literal holds.

    Raises:
        Unusable: it is neither.
    """
    text = as_text(packed, name)
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    if len(text) > _DEEPEST_LITERAL:
        raise Unusable(f"{name!r} is longer than {_DEEPEST_LITERAL} characters")
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        raise Unusable(f"{name!r} is neither JSON nor a Python literal") from error


@lru_cache(maxsize=4096)
def website_url(given: str) -> str | None:
    """The URL that a bare host or a URL stands for; ``None`` if it does not name a website.

    A bare host is taken to speak https. A URL stays as it is.
    """
    url = given.strip().strip("<>").strip()
    scheme, separator, _ = url.partition("://")
    if separator and scheme.casefold() not in ("http", "https"):
        return None
    if not separator:
        if "@" in url.partition("/")[0]:
            return None  # a mail address
        url = f"https://{url.removeprefix('//')}"
    try:
        host = host_of(url)
    except ValueError:
        return None
    if ("." not in host and ":" not in host) or len(url.split()) > 1:
        return None
    return url if "/" in url.partition("://")[2] else f"{url}/"
