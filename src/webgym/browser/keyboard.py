"""From text to what a keyboard or an input method would send (US layout)."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from typing import Any, Literal, TypeAlias

import msgspec

Way: TypeAlias = Literal["keys", "compose", "insert"]

SHIFT = 8
"""The protocol's modifier bit."""


class Key(msgspec.Struct, frozen=True):
    """One key of a keyboard.

    Attributes:
        key, code: as a page's ``KeyboardEvent`` has them.
        number: its ``keyCode``, 0 where the layout has no such key.
        text: what it types; empty for a key that types nothing.
        shift: whether Shift is held.
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
"""What a page is told while an input method takes the keys."""

PLAIN = {
    "-": ("Minus", 189), "=": ("Equal", 187), "[": ("BracketLeft", 219), "]": ("BracketRight", 221),
    "\\": ("Backslash", 220), ";": ("Semicolon", 186), "'": ("Quote", 222), "`": ("Backquote", 192),
    ",": ("Comma", 188), ".": ("Period", 190), "/": ("Slash", 191), " ": ("Space", 32),
}  # fmt: skip
"""Code and number of the keys that are neither letters nor digits."""

SHIFTED = dict(zip(')!@#$%^&*(_+{}|:"~<>?', "0123456789-=[]\\;'`,./", strict=True))
"""What is on the key of what Shift types."""


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


def runs(text: str) -> Iterator[tuple[Way, str]]:
    """Cut a text into what is typed key by key, what an input method composes (East Asian scripts), and
    what is inserted as it is (emoji, characters of several code points, line breaks)."""
    way: Way | None = None
    start = 0
    for index in range(len(text)):
        now = _way_at(text, index)
        if now != way:
            if way is not None:
                yield way, text[start:index]
            way, start = now, index
    if way is not None:
        yield way, text[start:]


def strokes(text: str, most_keys: int) -> list[tuple[Way, str]]:
    """:func:`runs`; but a text of more than ``most_keys`` characters is inserted up to its last one."""
    found = [*runs(text)]
    if len(text) <= most_keys:
        return found
    way, last = found[-1]
    if way == "keys":
        last = last[-1]
    return [("insert", text[: -len(last)]), (way, last)] if len(last) < len(text) else found


_JOINERS = "\u200d\ufe0e\ufe0f"


def _way_at(text: str, index: int) -> Way:
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
