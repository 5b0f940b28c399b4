"""Representations of missing values in foreign data: null, NaN, an empty text, or a word for it."""

from __future__ import annotations

import math
import re
from typing import Final

_ABSENT: Final = frozenset({"", "none", "null", "nan", "n/a", "undefined", "**"})
_BRACKETS: Final = " \t\r\n[](){}'\""
_LONGEST_ABSENT: Final = 24
"""Characters of the longest text that counts as missing; a longer one has content."""

_NO_FACT: Final = re.compile(
    r"[\W_]*(?:(?:none|not|nothing|nil)(?: (?:applicable|available|given|mentioned|needed|provided|required"
    r"|specified|stated))?|n/?a|null|nan|undefined|unspecified|unknown|absent|empty|tbd)?[\W_]*",
    re.IGNORECASE,
)
_LONGEST_NO_FACT: Final = 32
"""Characters, including surrounding white space, of the longest text without content."""


def is_missing_value(value: object) -> bool:
    """Whether a value represents a missing one. Possible answers ("nothing", "0") do not."""
    if isinstance(value, str):
        is_short = len(value) <= _LONGEST_ABSENT or value.isspace()
        return is_short and value.strip().strip(_BRACKETS).casefold() in _ABSENT
    if isinstance(value, float):
        return math.isnan(value)
    if isinstance(value, (list, tuple)):
        return all(map(is_missing_value, value))
    return value is None or value == {}


def is_no_fact(text: str) -> bool:
    """Whether the text of a fact has no content that could be judged ("None", "N/A")."""
    return not text.strip() or (len(text) <= _LONGEST_NO_FACT and _NO_FACT.fullmatch(text) is not None)
