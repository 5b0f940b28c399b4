"""Keys by name, and keys pressed together.

Names are those of ``KeyboardEvent.key`` and ``KeyboardEvent.code``, in any case, and common aliases
(``ctrl``, ``esc``, ``return``, ``up``). A single character names its own key.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from webgym.browser.keyboard import BACKSPACE, ENTER, PLAIN, SHIFT, SHIFTED, Key, key_of

_BITS = {"Alt": 1, "Control": 2, "Meta": 4, "Shift": SHIFT}
"""The protocol's modifier bits."""

_LEFT = 1
"""The protocol's ``location`` of keys on the left side of the keyboard."""

_NAMED = (
    ENTER,
    BACKSPACE,
    key_of(" "),
    Key("Shift", "ShiftLeft", 16),
    Key("Control", "ControlLeft", 17),
    Key("Alt", "AltLeft", 18),
    Key("Meta", "MetaLeft", 91),
    Key("Tab", "Tab", 9),
    Key("CapsLock", "CapsLock", 20),
    Key("Escape", "Escape", 27),
    Key("PageUp", "PageUp", 33),
    Key("PageDown", "PageDown", 34),
    Key("End", "End", 35),
    Key("Home", "Home", 36),
    Key("ArrowLeft", "ArrowLeft", 37),
    Key("ArrowUp", "ArrowUp", 38),
    Key("ArrowRight", "ArrowRight", 39),
    Key("ArrowDown", "ArrowDown", 40),
    Key("Insert", "Insert", 45),
    Key("Delete", "Delete", 46),
    Key("ContextMenu", "ContextMenu", 93),
    *(Key(f"F{number}", f"F{number}", 111 + number) for number in range(1, 13)),
    *(key_of(character) for character in (*"abcdefghijklmnopqrstuvwxyz0123456789", *PLAIN)),
)

_ALIASES = {
    "ctrl": "Control",
    "controlormeta": "Control",
    "cmd": "Meta",
    "command": "Meta",
    "super": "Meta",
    "win": "Meta",
    "windows": "Meta",
    "option": "Alt",
    "esc": "Escape",
    "return": "Enter",
    "del": "Delete",
    "ins": "Insert",
    "pgup": "PageUp",
    "pgdn": "PageDown",
    "up": "ArrowUp",
    "down": "ArrowDown",
    "left": "ArrowLeft",
    "right": "ArrowRight",
    "spacebar": "Space",
    "divide": "Slash",
}
_BY_NAME = {name.lower(): key for key in _NAMED for name in (key.code, key.key)}
_BY_NAME |= {alias: _BY_NAME[name.lower()] for alias, name in _ALIASES.items()}

_SHIFTED_BY_BASE = {base: shifted for shifted, base in SHIFTED.items()}
_PARTS = re.compile(r"[^+]+|\+$")


def keys_of(names: Iterable[str]) -> list[Key]:
    """The keys of a chord: ``("Control", "a")``, ``("Control+a",)``, ``("Enter",)``.

    Raises:
        ValueError: a name is not that of a key.
    """
    parts = (part for name in names for part in ([name] if len(name) == 1 else _PARTS.findall(name)))
    return [_named(part) for part in parts]


def modifier_bits(names: Iterable[str]) -> int:
    """The protocol's bit mask of these modifiers."""
    return sum(_BITS[name] for name in names)


def _named(name: str) -> Key:
    if len(name) == 1:
        return key_of(name)
    key = _BY_NAME.get(name.strip().lower())
    if key is None:
        raise ValueError(f'there is no key "{name[:40]}"; keys are named like Enter, ArrowDown, Control or a')
    return key


def chord(keys: Sequence[Key]) -> list[dict[str, Any]]:
    """The protocol's key events of a chord: down one after the other, up in the reverse order."""
    modifiers = 0
    events = []
    for key in keys:
        modifiers |= _BITS.get(key.key, 0)
        events.append(_event(key, modifiers, is_down=True))
    for key in reversed(keys):
        modifiers &= ~_BITS.get(key.key, 0)
        events.append(_event(key, modifiers, is_down=False))
    return events


def _event(key: Key, modifiers: int, *, is_down: bool) -> dict[str, Any]:
    if modifiers & SHIFT and key.text:
        key = key_of(_SHIFTED_BY_BASE.get(key.text, key.text.upper())) if key is not ENTER else key
    event = {**key.event("down" if is_down else "up")}
    event["modifiers"] |= modifiers
    if key.key in _BITS:
        event["location"] = _LEFT
    if is_down and modifiers & ~SHIFT:  # a keyboard shortcut types no text
        event |= {"type": "rawKeyDown"}
        event.pop("text", None)
    return event
