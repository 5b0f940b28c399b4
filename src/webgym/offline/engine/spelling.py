"""Spellings of lists, numbers, times, days and quantities in tasks and answers.

Functions that return several spellings return the one on pages first.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from functools import lru_cache

BARE_FROM = 10
"""An answer may give a number without its unit from here on; a smaller one could be there by accident."""

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


def times(minute: int) -> tuple[str, ...]:
    """Spellings of a time of day, given in minutes since midnight."""
    hour, rest = divmod(minute % 1440, 60)
    half, twelve = ("am" if hour < 12 else "pm"), hour % 12 or 12
    spellings = (
        f"{hour:02d}:{rest:02d}",
        f"{hour}:{rest:02d}",
        f"{twelve}:{rest:02d} {half}",
        f"{twelve}:{rest:02d}{half}",
    )
    return tuple(dict.fromkeys(spellings))


@lru_cache(maxsize=1 << 12)
def days(day: date) -> tuple[str, ...]:
    """Spellings of a day."""
    number = day.day
    spellings = (f"{number} {day:%b %Y}", f"{number} {day:%b}", f"{number} {day:%B}", f"{day:%B} {number}")
    return (*spellings, f"{day:%b} {number}", day.isoformat())


def minutes(value: int) -> tuple[str, ...]:
    """Spellings of a duration in minutes."""
    spellings = [f"{value} min", f"{value} minutes", f"{value} mins"]
    hours, rest = divmod(value, 60)
    if hours:
        hour = "hour" if hours == 1 else "hours"
        tail = f" {rest} minutes" if rest else ""
        spellings += [f"{hours} {hour}{tail}", f"{hours} h {rest} min" if rest else f"{hours} h"]
        spellings += [f"{hours} {hour} and {rest} minutes"] if rest else []
    return (*spellings, str(value)) if value >= BARE_FROM else tuple(spellings)


def quantity(value: str, unit: str, *units: str) -> tuple[str, ...]:
    """Spellings of a quantity; of ``quantity("12", "g", "grams")``: "12 g", "12g", "12 grams" and "12"."""
    spellings = [f"{value} {unit}", f"{value}{unit}", *(f"{value} {other}" for other in units)]
    if value == "1":
        spellings += [spelling.removesuffix("s") for spelling in spellings]
    if unit.startswith("thousand"):
        number, rest = 1000 * int(value.replace(",", "")), unit.removeprefix("thousand")
        return (
            *spellings,
            *(each for written in (f"{number:,}", str(number)) for each in (written + rest, written)),
        )
    return (*spellings, value) if float(value.replace(",", "")) >= BARE_FROM else tuple(spellings)


def count(value: int, *nouns: str) -> tuple[str, ...]:
    """Spellings of a number of things, which ``nouns`` name."""
    spellings = [str(value)]
    if 0 < value < len(_NUMBERS):
        spellings.append(_NUMBERS[value])
    elif value == 0:
        spellings += [f"{word} {noun}" for word in ("no", "zero") for noun in nouns] + ["none"]
    return tuple(spellings)
