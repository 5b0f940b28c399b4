"""Whether a text contains a date that has passed (SOURCES.md, pitfall 6).

A year has passed if it is before that of the reference date; within that year, a month or a day may have.
Numbers that are prices, amounts or measures do not count as years. Digits may be of any script, and a date in
numbers has any marks between them: of a language, only the English names of months are known.
"""

from __future__ import annotations

import re
from calendar import monthrange
from datetime import date

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH = r"(?P<month>jan|feb|mar|apr|may|june?|july?|aug|sept?|oct|nov|dec)[a-z]*\.?"
_DAY = r"(?P<day>\d{1,2})(?:st|nd|rd|th)?"
_UNITS = (
    r"calories|kcal|cal|miles?|mi|km|kilomet|met(?:er|re)s?|m|mm|cm|ft|feet|foot|inch|sq|square|dollars?|bucks|usd|eur"
    r"|euros?|pounds?|gbp|yen|rupees|inr|lbs?|kg|grams?|g|mg|ml|lit(?:er|re)s?|mah|wh|watts?|w|hz|mhz|rpm|dpi|reviews?"
    r"|ratings?|people|persons?|employees|students|words|characters|items|pieces|pcs|pixels?|px|hours?|minutes?"
    r"|seconds?|steps|points?|stars|votes|likes|downloads|followers|subscribers|citations|players|results|pages|btus?"
)
_YEAR = re.compile(
    r"(?<![a-z0-9_$€£¥₹#@.,:])(?<!\d-)(?<!under )(?<!below )(?<!over )(?<!above )(?<!least )(?<!than )"
    r"(?<!up to )"
    r"(?P<year>(?:19|20)\d\d)(?:s?(?![\w%$€£]|[.,:]\d)|(?=[年년]|[QH][1-4]\b))"
    rf"(?!(?:\s*(?:-|–|to|and|or)\s*[\d,]+)?[\s-]*(?:{_UNITS})\b)",
    re.IGNORECASE,
)
_FISCAL = re.compile(r"(?<![a-z0-9])[FC]Y ?'?(?P<year>(?:19|20)?\d\d)(?!\d|[.,]\d)", re.IGNORECASE)
_NUMERIC = re.compile(
    r"(?<!\d)(?:(\d{4})([-/.])\s?(\d{1,2})\2\s?(\d{1,2})|(\d{1,2})([-/.])(\d{1,2})\6(\d{4}))(?!\d)"
)
_SHORT = re.compile(r"(?<![\w.,/-])(?:(\d{1,2})([/-])(\d{1,2})\2|(\d\d)\.(\d\d)\.)(\d\d)(?![\w/-]|[.,]\d)")
"""A day with a year of two digits. With full stops, such as those of versions, all have two digits."""
_MARKED = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[^\x00-\x7f]\s?(\d{1,2})[^\x00-\x7f](?:\s?(\d{1,2})[^\x00-\x7f])?"
)
"""Year, month and perhaps day, each with its sign: 2024年3月3日."""
_CENTURY_AHEAD = 50
"""Years from which on a year of two digits is one of the century before."""
_WRITTEN = re.compile(
    rf"\b(?:{_DAY}\s+(?:of\s+)?)?{_MONTH}(?:\s+(?P<after>\d{{1,2}})(?:st|nd|rd|th)?)?"
    r"(?:\s*(?:-|–|to|and)\s*(?:[a-z]+\s+)?\d{1,2}(?:st|nd|rd|th)?)?(?:,?\s+(?:of\s+)?|,)(?P<year>\d{4})\b",
    re.IGNORECASE,
)


def contains_past_date(text: str, today: date) -> bool:
    """Whether the text contains a day, a month or a year that ended before ``today``."""
    text = _ascii_digits(text)
    return (
        any(int(match["year"]) < today.year for match in _YEAR.finditer(text))
        or any(_full(match["year"], today) < today.year for match in _FISCAL.finditer(text))
        or any(_short_is_past(match, today) for match in _SHORT.finditer(text))
        or any(_marked_is_past(match, today) for match in _MARKED.finditer(text))
        or any(_numeric_is_past(match, today) for match in _NUMERIC.finditer(text))
        or any(_written_is_past(match, today) for match in _WRITTEN.finditer(text))
    )


def years(text: str) -> set[int]:
    """The years in the text, alone or in a date."""
    text = _ascii_digits(text)
    return {
        *(int(match["year"]) for match in _YEAR.finditer(text)),
        *(int(match[1] or match[8]) for match in _NUMERIC.finditer(text)),
        *(int(match["year"]) for match in _WRITTEN.finditer(text)),
    }


def _ascii_digits(text: str) -> str:
    """The text with the digits of every script as 0 to 9."""
    if text.isascii():
        return text
    return "".join(str(int(each)) if each.isdecimal() else each for each in text)


def _full(year: str, today: date) -> int:
    """A year of four digits, or of two."""
    if len(year) == 4:
        return int(year)
    full = 2000 + int(year)
    return full if full < today.year + _CENTURY_AHEAD else full - 100


def _short_is_past(match: re.Match[str], today: date) -> bool:
    first, second = int(match[1] or match[4]), int(match[3] or match[5])
    return _day_is_past([(first, second), (second, first)], _full(match[6], today), today)


def _marked_is_past(match: re.Match[str], today: date) -> bool:
    return _is_past(int(match[1]), int(match[2]), int(match[3]) if match[3] else None, today)


def _day_is_past(readings: list[tuple[int, int]], year: int, today: date) -> bool:
    """Whether a day has passed, as (month, day), in every reading."""
    days = [last for month, day in readings if (last := _last_day(year, month, day))]
    return bool(days) and max(days) < today


def _numeric_is_past(match: re.Match[str], today: date) -> bool:
    if match[1]:
        return _is_past(int(match[1]), int(match[3]), int(match[4]), today)
    first, second, year = int(match[5]), int(match[7]), int(match[8])
    return _day_is_past([(first, second), (second, first)], year, today)  # day or month first


def _written_is_past(match: re.Match[str], today: date) -> bool:
    month = _MONTHS.index(match["month"][:3].casefold()) + 1
    day = match["day"] or match["after"]
    return _is_past(int(match["year"]), month, int(day) if day else None, today)


def _is_past(year: int, month: int, day: int | None, today: date) -> bool:
    last = _last_day(year, month, day)
    return last is not None and last < today


def _last_day(year: int, month: int, day: int | None) -> date | None:
    if not (1900 <= year <= 2099 and 1 <= month <= 12):
        return None
    last = monthrange(year, month)[1]
    if day is not None and not 1 <= day <= last:
        return None
    return date(year, month, day or last)
