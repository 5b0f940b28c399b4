"""The one place that knows how tasks and answers spell lists, numbers, times, days and quantities."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date

BARE_FROM = 10
"""A number below this proves nothing without its unit."""

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
    """Ways to write a time of day."""
    hour, rest = divmod(minute % 1440, 60)
    half, twelve = ("am" if hour < 12 else "pm"), hour % 12 or 12
    ways = (
        f"{hour:02d}:{rest:02d}",
        f"{hour}:{rest:02d}",
        f"{twelve}:{rest:02d} {half}",
        f"{twelve}:{rest:02d}{half}",
    )
    return tuple(dict.fromkeys(ways))


def days(day: date) -> tuple[str, ...]:
    """Ways to write a day."""
    number = day.day
    ways = (f"{number} {day:%b %Y}", f"{number} {day:%b}", f"{number} {day:%B}", f"{day:%B} {number}")
    return (*ways, f"{day:%b} {number}", day.isoformat())


def minutes(value: int) -> tuple[str, ...]:
    """Ways to say a duration."""
    said = [f"{value} min", f"{value} minutes", f"{value} mins"]
    hours, rest = divmod(value, 60)
    if hours:
        hour = "hour" if hours == 1 else "hours"
        tail = f" {rest} minutes" if rest else ""
        said += [f"{hours} {hour}{tail}", f"{hours} h {rest} min" if rest else f"{hours} h"]
        said += [f"{hours} {hour} and {rest} minutes"] if rest else []
    return (*said, str(value)) if value >= BARE_FROM else tuple(said)


def quantity(value: str, unit: str, *units: str) -> tuple[str, ...]:
    """Ways to say a quantity: ``quantity("12", "g", "grams")`` takes "12 g", "12g", "12 grams" and "12"."""
    said = [f"{value} {unit}", f"{value}{unit}", *(f"{value} {other}" for other in units)]
    return (*said, value) if float(value.replace(",", "")) >= BARE_FROM else tuple(said)


def count(value: int, *nouns: str) -> tuple[str, ...]:
    """Ways to say how many."""
    said = [str(value)]
    if 0 < value < len(_NUMBERS):
        said.append(_NUMBERS[value])
    elif value == 0:
        said += [f"{word} {noun}" for word in ("no", "zero") for noun in nouns] + ["none"]
    return tuple(said)
