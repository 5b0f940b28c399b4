"""Whether a text contains a date that has passed (SOURCES.md, pitfall 6).

A year has passed if it is before that of the reference date; within that year, a month or a day may have.
Numbers that are prices, amounts or measures do not count as years.
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
    r"(?<![\w$€£¥₹#@.,:])(?<!\d-)(?<!under )(?<!below )(?<!over )(?<!above )(?<!least )(?<!than )(?<!up to )"
    r"(?P<year>(?:19|20)\d\d)s?(?![\w%$€£]|[.,:]\d)"
    rf"(?!(?:\s*(?:-|–|to|and|or)\s*[\d,]+)?[\s-]*(?:{_UNITS})\b)",
    re.IGNORECASE,
)
_NUMERIC = re.compile(
    r"(?<!\d)(?:(\d{4})([-/.])(\d{1,2})\2(\d{1,2})|(\d{1,2})([-/.])(\d{1,2})\6(\d{4}))(?!\d)"
)
_WRITTEN = re.compile(
    rf"\b(?:{_DAY}\s+(?:of\s+)?)?{_MONTH}(?:\s+(?P<after>\d{{1,2}})(?:st|nd|rd|th)?)?"
    r"(?:\s*(?:-|–|to|and)\s*(?:[a-z]+\s+)?\d{1,2}(?:st|nd|rd|th)?)?(?:,?\s+(?:of\s+)?|,)(?P<year>\d{4})\b",
    re.IGNORECASE,
)


def contains_past_date(text: str, today: date) -> bool:
    """Whether the text contains a day, a month or a year that ended before ``today``."""
    if "19" not in text and "20" not in text:
        return False
    return (
        any(int(match["year"]) < today.year for match in _YEAR.finditer(text))
        or any(_numeric_is_past(match, today) for match in _NUMERIC.finditer(text))
        or any(_written_is_past(match, today) for match in _WRITTEN.finditer(text))
    )


def years(text: str) -> set[int]:
    """The years in the text, alone or in a date."""
    return {
        *(int(match["year"]) for match in _YEAR.finditer(text)),
        *(int(match[1] or match[8]) for match in _NUMERIC.finditer(text)),
        *(int(match["year"]) for match in _WRITTEN.finditer(text)),
    }


def _numeric_is_past(match: re.Match[str], today: date) -> bool:
    if match[1]:
        return _is_past(int(match[1]), int(match[3]), int(match[4]), today)
    first, second, year = int(match[5]), int(match[7]), int(match[8])
    # Day first or month first: it has passed only if it has in both readings.
    readings = [_last_day(year, month, day) for month, day in ((first, second), (second, first))]
    days = [day for day in readings if day is not None]
    return bool(days) and max(days) < today


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
