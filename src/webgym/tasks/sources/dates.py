"""Whether a text contains a date that has passed (SOURCES.md, pitfall 6).

A year has passed if it is before that of the reference date; within that year, a day or a month may have,
where it is written with its year. A number that may be a year counts as one, unless it is part of another
number, of a name or of a price: the flag is for a person to look at. Digits may be of any script.
"""

from __future__ import annotations

import re
from calendar import monthrange
from datetime import date

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_YEAR = re.compile(
    r"(?<![a-z0-9_$€£¥₹#@.,:])(?<!\d-)((?:19|20)\d\d)(?:s?(?![\w%$€£]|[.,:]\d)|(?=[年년]))", re.IGNORECASE
)
"""A year by itself, also with the sign of a year."""
_NUMERIC = re.compile(
    r"(?<!\d)(?:(\d{4})([-/.])\s?(\d{1,2})\2\s?(\d{1,2})|(\d{1,2})([-/.])(\d{1,2})\6(\d{4}))(?!\d)"
)
_WRITTEN = re.compile(
    rf"\b(?:(\d{{1,2}})(?:st|nd|rd|th)?\s+(?:of\s+)?)?({'|'.join(_MONTHS)})[a-z]*\.?"
    r"(?:\s+(\d{1,2})(?:st|nd|rd|th)?)?(?:\s*(?:-|–|to|and)\s*(?:[a-z]+\s+)?\d{1,2}(?:st|nd|rd|th)?)?"
    r"(?:,?\s+(?:of\s+)?|,)(\d{4})\b",
    re.IGNORECASE,
)
"""Day and month, or month and day, with an English name and a year."""


def contains_past_date(text: str, today: date) -> bool:
    """Whether the text contains a day, a month or a year that ended before ``today``."""
    return any(year < today.year for year in years(text)) or any(
        last < today for last in _last_days(_ascii_digits(text))
    )


def years(text: str) -> set[int]:
    """The years in the text, alone or in a date."""
    text = _ascii_digits(text)
    return {
        *(int(match[1]) for match in _YEAR.finditer(text)),
        *(int(match[1] or match[8]) for match in _NUMERIC.finditer(text)),
        *(int(match[4]) for match in _WRITTEN.finditer(text)),
    }


def _ascii_digits(text: str) -> str:
    """The text with the digits of every script as 0 to 9."""
    if text.isascii():
        return text
    return "".join(str(int(each)) if each.isdecimal() else each for each in text)


def _last_days(text: str) -> list[date]:
    """The last day of every date in the text: of a month without a day, the last of the month; of a date that
    can be read with the day or the month first, the later one."""
    found = []
    for match in _NUMERIC.finditer(text):
        if match[1]:
            readings = [_last_day(match[1], match[3], match[4])]
        else:
            readings = [_last_day(match[8], match[5], match[7]), _last_day(match[8], match[7], match[5])]
        found += [max(days)] if (days := [day for day in readings if day]) else []
    for match in _WRITTEN.finditer(text):
        month = _MONTHS.index(match[2].casefold()) + 1
        if last := _last_day(match[4], month, match[1] or match[3]):
            found.append(last)
    return found


def _last_day(year: str, month: str | int, day: str | None) -> date | None:
    if not (1900 <= int(year) <= 2099 and 1 <= int(month) <= 12):
        return None
    last = monthrange(int(year), int(month))[1]
    if day is not None and not 1 <= int(day) <= last:
        return None
    return date(int(year), int(month), int(day or last))
