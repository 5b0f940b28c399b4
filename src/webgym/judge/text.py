"""Comparing texts as a careful reader does: case, white space and spelling of numbers do not count."""

from __future__ import annotations

import re
import unicodedata
from decimal import Decimal
from functools import lru_cache

_NUMBER = re.compile(r"\d+(?:[.,]\d+)*")
_THOUSANDS = re.compile(r"\d{1,3}(?:,\d{3})+(?:\.\d+)?")
_QUOTES = str.maketrans({"’": "'", "‘": "'", "“": '"', "”": '"', "–": "-", "—": "-", "−": "-"})


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


def numbers(text: str) -> set[Decimal]:
    """The numbers in a text; 1,234.50 and 1234.5 are the same. 14:30 counts as 14 and 30."""
    found = set()
    for match in _NUMBER.findall(unicodedata.normalize("NFKC", text)):
        if _THOUSANDS.fullmatch(match):
            found.add(Decimal(match.replace(",", "")).normalize())
        elif match.count(".") == 1 and "," not in match:
            found.add(Decimal(match).normalize())
        else:  # a date, a version, a list: its pieces count
            found.update(Decimal(piece).normalize() for piece in re.split(r"[.,]", match))
    return found
