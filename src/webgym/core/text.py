"""Text comparison that ignores case, white space and typographic variants.

Truths are compared by this rule wherever they are: by the judge with what was visible, by a script with
what is visible.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache

_QUOTES = str.maketrans({"’": "'", "‘": "'", "“": '"', "”": '"', "–": "-", "—": "-", "−": "-"})


def plain(text: str) -> str:
    """A text of others on one line, without characters that a terminal would obey."""
    return "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}"
        for character in " ".join(text.split())
    )


def fold(text: str) -> str:
    """Compatibility forms, typographic quotes and dashes, case and white space made one."""
    return " ".join(unicodedata.normalize("NFKC", text).translate(_QUOTES).casefold().split())


@lru_cache(maxsize=20_000)
def _whole(phrase: str) -> re.Pattern[str]:
    before = r"(?<!\w)" if phrase[0].isalnum() else ""
    after = r"(?!\w)" if phrase[-1].isalnum() else ""
    if phrase[0].isdecimal():
        before += r"(?<!\d[.,:])"  # 5 does not stand in 2.5
    if phrase[-1].isdecimal():
        after += r"(?![.,:]\d)"  # 12 does not stand in 12.50
    return re.compile(before + re.escape(phrase) + after)


def says(folded: str, phrase: str) -> bool:
    """Whether ``phrase`` stands in the folded text as whole words and whole numbers."""
    wanted = fold(phrase)
    return bool(wanted) and wanted in folded and _whole(wanted).search(folded) is not None


def mentions(folded: str, phrases: Iterable[str]) -> list[str]:
    """Which of ``phrases`` stand in the folded text, folded, in the order in which they stand there.

    A phrase inside a longer one does not count on its own: ``"red star"`` is no mention of ``"red"``.
    """
    wanted = {fold(phrase) for phrase in phrases} - {""}
    found = sorted(
        (match.start(), -match.end(), phrase)
        for phrase in wanted
        if phrase in folded
        for match in _whole(phrase).finditer(folded)
    )
    told, end = [], 0
    for start, minus_end, phrase in found:
        if start >= end:
            told.append(phrase)
            end = -minus_end
    return told
