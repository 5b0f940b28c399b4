"""The agent's memory: what it carries from step to step beyond the screenshots that it still sees.

The window of recent screenshots is no sufficient statistic of the past, so the agent writes a memory,
m_t = VLM(o_t, m_{t-1}, task), and reads it back (paper §5). It is append-only. A model does not always
keep to that, so every reply's memory is merged into the one before by this rule:

- a new key is taken in;
- a key that is gone from the reply is kept (*dropped*);
- a value that continues the old one replaces it: a text that begins with the old text, a list that begins
  with the old items, an object whose own values do so;
- any other new value (*rewritten*) is kept beside the old one, under ``"key (2)"``, ``"key (3)"``, ...;
- what would make the memory larger than its limit is not taken in (*refused*).

Progress is not merged: it may be refined, so the latest counts.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from typing import Any

from webgym.core.trajectory import Revision


def merge(
    old: Mapping[str, Any], new: Mapping[str, Any], *, max_chars: int, unseen: Collection[str] = ()
) -> tuple[dict[str, Any], Revision]:
    """``old`` with what ``new`` adds, and what the rule had to correct.

    Args:
        old: the memory so far; left as it is.
        new: the memory of a reply.
        max_chars: the most that the memory may measure as JSON text.
        unseen: keys that the reply's writer was not shown, and so may leave out.
    """
    merged = dict(old)
    rewritten, refused = [], []
    room = max_chars - len(to_json(old))
    for key, value in new.items():
        place = key
        if key in old and not _continues(old[key], value):
            if _stands_beside(merged, key, value):
                continue
            place = _free_key(merged, key)
            rewritten.append(key)
        before = len(to_json({place: merged[place]})) if place in merged else 0
        room -= (cost := len(to_json({place: value})) - before)
        if cost > 0 and room < 0:
            room += cost
            refused.append(key)
            continue
        merged[place] = value
    missing = (key for key in old if key not in new and key not in unseen)
    dropped = tuple(key for key in missing if not _is_variant(key, old))
    return merged, Revision(dropped, tuple(rewritten), tuple(refused))


def to_json(memory: Mapping[str, Any]) -> str:
    """The memory as the agent reads it."""
    return json.dumps(memory, ensure_ascii=False)


def _continues(old: Any, new: Any) -> bool:
    if isinstance(old, str) and isinstance(new, str):
        return new.startswith(old)
    if isinstance(old, list) and isinstance(new, list):
        return new[: len(old)] == old
    if isinstance(old, dict) and isinstance(new, dict):
        return all(key in new and _continues(value, new[key]) for key, value in old.items())
    return bool(old == new) and type(old) is type(new)


def _variant(key: str, count: int) -> str:
    return f"{key} ({count})"


def _free_key(memory: Mapping[str, Any], key: str) -> str:
    count = 2
    while _variant(key, count) in memory:
        count += 1
    return _variant(key, count)


def _stands_beside(memory: Mapping[str, Any], key: str, value: Any) -> bool:
    """Whether an earlier rewrite already put this value beside the key."""
    count = 2
    while (variant := _variant(key, count)) in memory:
        if memory[variant] == value:
            return True
        count += 1
    return False


def _is_variant(key: str, memory: Mapping[str, Any]) -> bool:
    """Whether the key is one that a rewrite made; its absence from a reply is no news."""
    base, separator, count = key.rpartition(" (")
    return bool(separator) and count[:-1].isdecimal() and base in memory
