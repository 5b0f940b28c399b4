"""Spellings of lists, numbers, times, days and quantities in tasks and answers.

Functions that return several spellings return the one on pages first.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from functools import lru_cache

_CURRENCIES = {"$": ("USD", "dollars"), "€": ("EUR", "euros"), "£": ("GBP", "pounds")}
"""Code and word of each currency."""
_NUMBERS = (
    "no one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen".split()
)


def listed(things: Sequence[str]) -> str:
    """``"a, b and c"``."""
    *first, last = things
    return f"{', '.join(first)} and {last}" if first else last


def the(nouns: Sequence[str]) -> str:
    """``"the price and the arrival time"``."""
    return listed([f"the {noun}" for noun in nouns])


def first_up(text: str) -> str:
    """``text`` with a capital letter first."""
    return text[:1].upper() + text[1:]


def _unique(*spellings: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(spellings))


def times(minute: int) -> tuple[str, ...]:
    """Spellings of a time of day, given in minutes since midnight."""
    hour, rest = divmod(minute % 1440, 60)
    half, twelve = ("am" if hour < 12 else "pm"), hour % 12 or 12
    clocks = [f"{twelve}:{rest:02d}", f"{twelve:02d}:{rest:02d}", *([] if rest else [str(twelve)])]
    halves = (f" {half}", half, f" {half[0]}.m.")
    return _unique(
        f"{hour:02d}:{rest:02d}", f"{hour}:{rest:02d}", *(clock + end for clock in clocks for end in halves)
    )


@lru_cache(maxsize=1 << 12)
def days(day: date) -> tuple[str, ...]:
    """Spellings of a day."""
    number, months = day.day, (f"{day:%b}", f"{day:%B}")
    ordinal = f"{number}{'th' if 10 < number < 14 else {1: 'st', 2: 'nd', 3: 'rd'}.get(number % 10, 'th')}"
    without_year = [
        text
        for month in months
        for nth in (number, ordinal)
        for text in (f"{nth} {month}", f"{month} {nth}", f"{nth} of {month}")
    ]
    with_year = [f"{text}{comma} {day.year}" for text in without_year for comma in ("", ",")]
    digits = (day.isoformat(), f"{day:%Y/%m/%d}", f"{day:%d.%m.%Y}", f"{number}.{day.month}.{day.year}")
    return _unique(f"{number} {day:%b %Y}", *with_year, *without_year, *digits)


def minutes(value: int) -> tuple[str, ...]:
    """Spellings of a duration in minutes."""
    spellings = [f"{value}{unit}" for unit in (" min", " minutes", " mins", "min", "")]
    hours, rest = divmod(value, 60)
    if hours:
        long = (" hour" if hours == 1 else " hours", " minutes")
        for hour, minute in (long, (" h", " min"), ("h", "min"), ("h", "m")):
            joints = (" ", " and ", "") if rest else ("",)
            spellings += [f"{hours}{hour}{joint}{f'{rest}{minute}' if rest else ''}" for joint in joints]
    return _unique(*spellings)


def money(value: int, sign: str) -> tuple[str, ...]:
    """Spellings of an amount in whole units of the currency with this sign."""
    numbers = _unique(f"{value:,}", str(value), f"{value:,}.00", f"{value}.00")
    units = (sign, *_CURRENCIES.get(sign, ()))
    signed = [text for number in numbers for text in (sign + number, *(f"{number} {unit}" for unit in units))]
    return _unique(*signed, *numbers)


def quantity(value: int, unit: str, *units: str) -> tuple[str, ...]:
    """Spellings of a quantity; of ``quantity(12, "g", "grams")``: "12 g", "12g", "12 grams" and "12".

    Thousands may be written out: "12,000 km" for "12 thousand km".
    """
    if unit.startswith("thousand"):
        rest = unit.removeprefix("thousand").strip()
        whole = money(1000 * value, "$") if rest == "dollars" else quantity(1000 * value, rest)
        return _unique(f"{value:,} {unit}", f"{value} {unit}", f"{value} thousand", *whole)
    numbers, spellings = _unique(f"{value:,}", str(value)), list[str]()
    for number in numbers:
        spellings += [
            f"{number} {unit}".strip(),
            f"{number}{unit}",
            *(f"{number} {other}" for other in units),
        ]
    if value == 1:
        spellings += [spelling.removesuffix("s") for spelling in spellings]
    return _unique(*spellings, *numbers)


def count(value: int, *nouns: str) -> tuple[str, ...]:
    """Spellings of a number of things, which ``nouns`` name."""
    words = ("zero", "no") if value == 0 else _NUMBERS[value : value + 1]
    named = [f"{number} {noun}" for number in (str(value), *words) for noun in nouns]
    return _unique(str(value), *words, *(["none"] if value == 0 else []), *named)
