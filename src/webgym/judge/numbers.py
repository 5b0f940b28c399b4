"""The numbers in a text, for finding those in an answer that no screenshot shows."""

from __future__ import annotations

import re
import unicodedata
from decimal import Decimal

_NUMBER = re.compile(r"\d+(?:[.,]\d+)*")
_THOUSANDS = re.compile(r"\d{1,3}(?:,\d{3})+(?:\.\d+)?")


def numbers(text: str) -> set[Decimal]:
    """The numbers in a text; 1,234.50 and 1234.5 are the same. 14:30 counts as 14 and 30."""
    values = set()
    for match in _NUMBER.findall(unicodedata.normalize("NFKC", text)):
        if _THOUSANDS.fullmatch(match):
            values.add(Decimal(match.replace(",", "")).normalize())
        elif match.count(".") == 1 and "," not in match:
            values.add(Decimal(match).normalize())
        else:  # a date, a version, a list: its pieces count
            values.update(Decimal(piece).normalize() for piece in re.split(r"[.,]", match))
    return values
