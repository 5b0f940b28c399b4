"""Seeded randomness: the same names give the same numbers on any machine, in any order of calls."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def number(*names: object) -> int:
    """A 64-bit number that depends only on ``names``."""
    text = "\x1f".join(map(str, names))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


def stream(*names: object) -> random.Random:
    """An independent random generator for ``names``.

    Every use has its own generator, so a new feature of a website does not change existing ones.
    """
    return random.Random(number(*names))


def pick(items: Sequence[T], *names: object) -> T:
    """One of ``items``, chosen by ``names``."""
    return items[number(*names) % len(items)]
