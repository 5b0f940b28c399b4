"""The agent's memory: notes that it carries from step to step beyond the screenshots that it still sees.

The window of recent screenshots is not a sufficient statistic of the past, so the agent writes a memory,
m_t = VLM(o_t, m_{t-1}, task), and reads it back (paper §5). It is append-only. Models do not always follow
this rule, so every reply's memory is merged into the previous one:

- a new key is added;
- a key that the reply leaves out is kept (*dropped*);
- a value that extends the old one replaces it: a text that begins with the old text, a list that begins with
  the old items, an object whose values all extend the old ones;
- any other new value (*rewritten*) is added under ``"key (2)"``, ``"key (3)"``, ...; the old one is kept;
- an entry that would make the memory exceed its limit is not added (*refused*).

Progress is not merged: it may be refined, so the latest statement counts.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Collection, Mapping
from typing import Any

from webgym.core.trajectory import Revision


def merge(
    old: Mapping[str, Any], new: Mapping[str, Any], *, max_chars: int, unseen: Collection[str] = ()
) -> tuple[dict[str, Any], Revision]:
    """The memory after a reply, and the corrections that the append-only rule required.

    Args:
        old: the memory before the reply; not modified.
        new: the memory in the reply.
        max_chars: largest size of the memory, in characters of JSON.
        unseen: keys that the request did not show, so that leaving them out is no violation.
    """
    merged = dict(old)
    rewritten, refused = [], []
    room = max_chars - len(to_json(old))
    for key, value in new.items():
        target = key
        if key in old and not _extends(old[key], value):
            variants = (f"{key} ({count})" for count in itertools.count(2))
            stored = list(itertools.takewhile(merged.__contains__, variants))
            if any(merged[variant] == value for variant in stored):
                continue  # an earlier rewrite already stored this value
            target = f"{key} ({len(stored) + 2})"
            rewritten.append(key)
        before = len(to_json({target: merged[target]})) if target in merged else 0
        room -= (cost := len(to_json({target: value})) - before)
        if cost > 0 and room < 0:
            room += cost
            refused.append(key)
            continue
        merged[target] = value
    missing = (key for key in old if key not in new and key not in unseen)
    dropped = tuple(key for key in missing if not _is_variant(key, old))
    return merged, Revision(dropped, tuple(rewritten), tuple(refused))


def to_json(memory: Mapping[str, Any]) -> str:
    """The memory as JSON, as prompts show it."""
    return json.dumps(memory, ensure_ascii=False)


def _extends(old: Any, new: Any) -> bool:
    if isinstance(old, str) and isinstance(new, str):
        return new.startswith(old)
    if isinstance(old, list) and isinstance(new, list):
        return new[: len(old)] == old
    if isinstance(old, dict) and isinstance(new, dict):
        return all(key in new and _extends(value, new[key]) for key, value in old.items())
    return bool(old == new) and type(old) is type(new)


def _is_variant(key: str, memory: Mapping[str, Any]) -> bool:
    """Whether a rewrite created this key, so that its absence from a reply is no violation."""
    base, separator, count = key.rpartition(" (")
    return bool(separator) and count[:-1].isdecimal() and base in memory
