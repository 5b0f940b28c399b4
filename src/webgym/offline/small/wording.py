"""The wording of the small websites' tasks, and its vocabulary."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from importlib import resources

import msgspec

from webgym.core.truth import DONE
from webgym.offline.parts import Wording
from webgym.offline.small.signs import numbers, sign_data

PHRASES = ("board.toml", "desk.toml", "market.toml", "signpost.toml", "trail.toml")
"""Files with the phrases of each family's tasks."""

KEYS = ("sign", "page", "note")
"""Words of memory keys, in addition to names of things and numbers of parts."""


def _instruct(brand: str, asks: Sequence[str]) -> str:
    del brand
    first, *others = asks
    joined = (f", {'and' if nth == len(others) else 'then'} {ask}" for nth, ask in enumerate(others, start=1))
    return first + "".join(joined)


WORDING = Wording("small", _instruct, form="small", separator=", ", keeps_count=True)
"""Clauses in lower case; the answer is the values of the parts, separated by commas."""


@lru_cache(maxsize=1)
def small_vocabulary() -> tuple[str, ...]:
    """Every word of the small websites' instructions, answers, memory and page elements, and the comma."""
    signs = sign_data()
    words = {",", DONE, "then", "and", "from", *KEYS, *numbers()}
    words |= {*signs.colors, *signs.icons, *signs.controls, *signs.words}
    for file in PHRASES:
        raw = resources.files("webgym.offline.small").joinpath(file).read_bytes()
        for phrases in msgspec.toml.decode(raw, type=dict[str, list[str]]).values():
            words.update(word for phrase in phrases for word in words_of(re.sub(r"\{\w+\}", "", phrase)))
    words |= {"number", "word", "sign", "signs", "first"}  # names of fields and places
    return tuple(sorted(words))


def words_of(text: str) -> list[str]:
    """Split a text into words of the vocabulary; a comma is a word."""
    return re.findall(r"[a-z0-9]+|[^\sa-z0-9]", text)
