"""Turns text into the input of a keyboard (US layout) or an input method."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from typing import Any, Literal, TypeAlias

import msgspec

InputMethod: TypeAlias = Literal["keys", "compose", "insert"]
"""How text is entered: key by key, as a composition of an input method, or inserted as a whole."""

SHIFT = 8
"""The protocol's modifier bit of Shift."""


class Key(msgspec.Struct, frozen=True):
    """One key of a keyboard.

    Attributes:
        key, code: as in a page's ``KeyboardEvent``.
        number: its ``keyCode``; 0 if the layout has no such key.
        text: the text that it types; empty for a key that types none.
        shift: whether Shift is held down.
    """

    key: str
    code: str = ""
    number: int = 0
    text: str = ""
    shift: bool = False

    def event(self, kind: Literal["down", "up"]) -> dict[str, Any]:
        """The parameters of ``Input.dispatchKeyEvent``."""
        event = {
            "type": "keyUp" if kind == "up" else "keyDown" if self.text else "rawKeyDown",
            "key": self.key,
            "code": self.code,
            "windowsVirtualKeyCode": self.number,
            "modifiers": SHIFT if self.shift else 0,
        }
        return {**event, "text": self.text} if self.text and kind == "down" else event


ENTER = Key("Enter", "Enter", 13, "\r")
BACKSPACE = Key("Backspace", "Backspace", 8)
PROCESS = Key("Process", "", 229)
"""The key that a page sees while an input method handles the keys."""

PLAIN = {
    "-": ("Minus", 189), "=": ("Equal", 187), "[": ("BracketLeft", 219), "]": ("BracketRight", 221),
    "\\": ("Backslash", 220), ";": ("Semicolon", 186), "'": ("Quote", 222), "`": ("Backquote", 192),
    ",": ("Comma", 188), ".": ("Period", 190), "/": ("Slash", 191), " ": ("Space", 32),
}  # fmt: skip
"""Code and number of the keys that are neither letters nor digits."""

SHIFTED = dict(zip(')!@#$%^&*(_+{}|:"~<>?', "0123456789-=[]\\;'`,./", strict=True))
"""The unshifted character on the key of each shifted one."""


def key_of(character: str) -> Key:
    """The key that types a character. One that is not on the layout has no code, as on a phone."""
    shift = character in SHIFTED or (character.isascii() and character.isupper())
    base = SHIFTED.get(character, character.lower())
    if base.isascii() and base.isalpha():
        code, number = f"Key{base.upper()}", ord(base.upper())
    elif base.isascii() and base.isdigit():
        code, number = f"Digit{base}", ord(base)
    else:
        code, number = PLAIN.get(base, ("", 0))
    return Key(character, code, number, character, shift)


def runs(text: str) -> Iterator[tuple[InputMethod, str]]:
    """Split a text into runs that are typed key by key, composed by an input method (East Asian scripts), or
    inserted (emoji, characters of several code points, line breaks)."""
    method: InputMethod | None = None
    start = 0
    for index in range(len(text)):
        current = _method_at(text, index)
        if current != method:
            if method is not None:
                yield method, text[start:index]
            method, start = current, index
    if method is not None:
        yield method, text[start:]


def split_input(text: str, most_keys: int) -> list[tuple[InputMethod, str]]:
    """:func:`runs`, except that a text of more than ``most_keys`` characters is inserted, save its last
    one."""
    all_runs = [*runs(text)]
    if len(text) <= most_keys:
        return all_runs
    method, last = all_runs[-1]
    if method == "keys":
        last = last[-1]
    return [("insert", text[: -len(last)]), (method, last)] if len(last) < len(text) else all_runs


_JOINERS = "\u200d\ufe0e\ufe0f"


def _method_at(text: str, index: int) -> InputMethod:
    character = text[index]
    if character.isascii():
        following = text[index + 1 : index + 2]
        is_bare = not following or following.isascii() or not _is_mark(following)
        return "keys" if character.isprintable() and is_bare else "insert"
    if _is_mark(character) or _is_mark(text[index + 1 : index + 2]) or ord(character) > 0xFFFF:
        return "insert"
    category = unicodedata.category(character)
    if unicodedata.east_asian_width(character) in "WF":
        return "compose" if category[0] in "LPN" else "insert"
    return "keys" if category[0] in "LPN" or category in ("Sc", "Sm", "Zs") else "insert"


def _is_mark(character: str) -> bool:
    return bool(character) and (character in _JOINERS or unicodedata.category(character)[0] == "M")
