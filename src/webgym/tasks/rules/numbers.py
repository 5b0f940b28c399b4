"""The numbers that a text states, in digits or in words, in all forms that may be used for them.

A task says "two weeks", "half", "7 pm" or "the 1990s"; its rubric says "14 days", "50 %", "19:00" or "1990 to
1999". A number counts as stated if the text has it in another form.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

_UNITS: Final = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen "
    "sixteen seventeen eighteen nineteen twenty"
).split()
_TENS: Final = "thirty forty fifty sixty seventy eighty ninety".split()
_ORDINALS: Final = (
    "first second third fourth fifth sixth seventh eighth ninth tenth eleventh twelfth thirteenth fourteenth "
    "fifteenth sixteenth seventeenth eighteenth nineteenth twentieth"
).split()
MONTHS: Final = (
    "january february march april may june july august september october november december".split()
)
_MONTH_OF: Final = {
    name: number for number, month in enumerate(MONTHS, 1) for name in (month, month[:3], month[:4])
}
_WORD_VALUES: Final[dict[str, int]] = (
    {word: value for value, word in enumerate(_UNITS)}
    | {word: value for value, word in zip(range(30, 100, 10), _TENS, strict=True)}
    | {word: value for value, word in enumerate(_ORDINALS, start=1)}
    | {"a dozen": 12, "dozen": 12}
)
_POWERS: Final = {"hundred": 100, "thousand": 1_000, "million": 10**6, "billion": 10**9}
_LARGEST: Final = 10**18
"""Largest number that is read from words, as in "million million"."""
_IMPLIED: Final[dict[str, tuple[float, ...]]] = {
    **dict.fromkeys(("both", "couple", "pair", "twice", "double", "twin", "duo"), (2,)),
    **dict.fromkeys(("another", "other", "alternative", "backup", "next", "runner"), (2,)),
    **dict.fromkeys(("triple", "trio", "thrice", "podium"), (3,)),
    "half": (0.5, 50, 2),
    "quarter": (0.25, 25, 4),
    "quarters": (0.75, 75, 4),
    "third": (0.33, 33, 33.3),
    "thirds": (0.67, 67, 66.7, 3),
    "noon": (12,),
    "midnight": (12, 24),
}
"""Words that imply a number without being one."""

_WORD: Final = "|".join(sorted((*_WORD_VALUES, *_POWERS), key=len, reverse=True))
_SPELLED: Final = re.compile(rf"\b(?:{_WORD})(?:[\s-]+(?:and\s+)?(?:{_WORD}))*\b")
_DIGITS: Final = re.compile(r"(?<![A-Za-z\d.,])\d+(?:[.,]\d+)*")
_SCALED: Final = re.compile(r"(?<![a-z\d.,])(\d+(?:[.,]\d+)*)\s?(k|m|bn|thousand|million|billion)\b")
_SCALES: Final = {"k": 10**3, "thousand": 10**3, "m": 10**6, "million": 10**6, "bn": 10**9, "billion": 10**9}
_FRACTION: Final = re.compile(r"(?<![\d/])(\d{1,3})[/⁄](\d{1,3})(?![\d/])")
_PERCENT: Final = re.compile(r"(\d+(?:\.\d+)?)\s?(?:%|percent|per cent)")
_AFTERNOON: Final = re.compile(r"\b(1[0-2]|0?[1-9])(?:[:.]\d\d)?\s?p\.?m\b")
_CLOCK: Final = re.compile(r"\b(1[3-9]|2[0-3])[:.]\d\d\b")
_DECADE: Final = re.compile(r"\b((?:1[5-9]|20)\d)0'?s\b")
_CENTURY: Final = re.compile(r"\b(\d\d?)(?:st|nd|rd|th)? centur")
_ROMAN: Final = re.compile(r"\b(?=[IVXLC]{2,}\b)(?:XC|XL|L?X{0,3})(?:IX|IV|V?I{0,3})\b")
_ROMAN_VALUES: Final = {"I": 1, "V": 5, "X": 10, "L": 50, "C": 100}
_PEOPLE: Final = re.compile(
    r"\b(\d+) (?:[a-z-]+ )?(?:adults?|child(?:ren)?|kids?|infants?|seniors?|teens?|students?)\b"
)

_DAY: Final = 86_400
_MEASURES: Final[tuple[dict[str, float], ...]] = (
    {
        **dict.fromkeys(("second", "sec"), 1),
        **dict.fromkeys(("minute", "min"), 60),
        **dict.fromkeys(("hour", "hr"), 3_600),
        **{"day": _DAY, "weekend": 2 * _DAY, "week": 7 * _DAY, "fortnight": 14 * _DAY},
        **{"month": 30 * _DAY, "year": 365 * _DAY},
    },
    {"month": 1, "year": 12, "decade": 120, "century": 1_200, "centurie": 1_200},
    {"mm": 1, "cm": 10, "meter": 1_000, "metre": 1_000, "km": 10**6, "kilometer": 10**6, "kilometre": 10**6},
    {"inch": 1, "inche": 1, "feet": 12, "foot": 12, "ft": 12, "yard": 36, "mile": 63_360},
    {"mg": 1, "g": 1_000, "gram": 1_000, "kg": 10**6, "kilo": 10**6, "kilogram": 10**6},
    {"oz": 1, "ounce": 1, "lb": 16, "pound": 16},
    {"ml": 1, "cl": 10, "litre": 1_000, "liter": 1_000},
    {"kb": 1, "mb": 10**3, "gb": 10**6, "tb": 10**9},
)
"""Units by measure, each with its size in the smallest unit of the measure."""
_UNIT: Final = "|".join(sorted({unit for units in _MEASURES for unit in units}, key=len, reverse=True))
_START: Final = r"(?<!\d)(?<!\d[.,])"
_QUANTITY: Final = re.compile(
    rf"(?:{_START}(\d+(?:[.,]\d+)*)[\s-]?)?\b({_UNIT})s?\b|{_START}(\d+(?:[.,]\d+)*)({_UNIT})s?\b"
)
_HALF: Final = re.compile(r"\b(half|quarter)(?: of)?(?: an?)?(?=[\s-])")
_AND_A_HALF: Final = re.compile(r"(\d+)(?: and a half| 1/2|½)")


def plain(number: str) -> str:
    """The normal form of a number, for comparison: ``1,400.50`` gives ``1400.5``, ``0`` an empty string."""
    number = re.sub(r",(?=\d{3}(?:\D|$))", "", number).replace(",", ".")
    if number.count(".") == 1:
        number = number.rstrip("0").rstrip(".")
    return number.lstrip("0") or ""


def in_digits(raw: str) -> frozenset[str]:
    """The numbers that a text states in digits, in normal form (:func:`plain`)."""
    return frozenset(map(plain, _DIGITS.findall(raw))) - {""}


def stated(raw: str, folded: str) -> frozenset[str]:
    """The numbers that a text states in digits or in words, in every form that may be used for them."""
    implied = {plain(f"{value:.6f}") for value in _values(raw, folded) if math.isfinite(value)}
    return in_digits(raw) | implied | {"1"}


def _values(raw: str, folded: str) -> Iterator[float]:
    for run in _SPELLED.findall(folded):
        yield _value(run)
        yield from (_WORD_VALUES[word] for word in re.split(r"[\s-]+", run) if word in _WORD_VALUES)
    for word in set(re.findall(r"[a-z]+", folded)):
        yield from _IMPLIED.get(word, ())
        if word in _MONTH_OF:
            yield _MONTH_OF[word]
    for number, scale in _SCALED.findall(folded):
        yield from (value * _SCALES[scale] for value in _number(number))
    for above, below in _FRACTION.findall(folded):
        yield from ((int(above) / int(below), 100 * int(above) / int(below)) if int(below) else ())
    yield from (float(number) / 100 for number in _PERCENT.findall(folded))
    yield from (100 * float(number) for number in re.findall(r"(?<![\d.])0?\.\d+", folded))
    yield from (int(hour) + 12 for hour in _AFTERNOON.findall(folded))
    yield from (int(hour) - 12 for hour in _CLOCK.findall(folded))
    yield from (10 * int(decade) + 9 for decade in _DECADE.findall(folded))
    for century in map(int, _CENTURY.findall(_spelled_out(folded))):
        yield from (100 * (century - 1), 100 * (century - 1) + 1, 100 * century - 1, 100 * century)
    yield from (_roman(numeral) for numeral in _ROMAN.findall(raw))
    yield sum(map(float, _PEOPLE.findall(_spelled_out(folded))))
    yield from (float(number) + 0.5 for number in _AND_A_HALF.findall(_spelled_out(folded)))


def _number(digits: str) -> Iterator[float]:
    number = plain(digits)
    if number and number.count(".") <= 1:
        yield float(number)


def _value(run: str) -> int:
    """The value of number words: "two hundred and fifty" is 250."""
    total = part = 0
    for word in re.split(r"[\s-]+", run):
        if word == "hundred":
            part = max(part, 1) * 100
        elif word in _POWERS:
            total, part = total + max(part, 1) * _POWERS[word], 0
        elif word == "dozen":
            part = max(part, 1) * 12
        else:
            part += _WORD_VALUES.get(word, 0)
    return min(total + part, _LARGEST)


def _roman(numeral: str) -> int:
    values = [_ROMAN_VALUES[letter] for letter in numeral]
    return sum(-value if value < following else value for value, following in pairwise([*values, 0]))


def _spelled_out(folded: str) -> str:
    """A folded text with its number words in digits."""
    digits = _SPELLED.sub(lambda run: str(_value(run.group())), folded)
    digits = _AND_A_HALF.sub(r"\1.5", digits)
    return _HALF.sub(lambda found: "0.5" if found[1] == "half" else "0.25", digits)


def quantities(folded: str) -> frozenset[tuple[int, int]]:
    """The quantities that a text states: index of the measure, and amount in its smallest unit, rounded.

    A unit without a number ("next week", "per day") counts as one.
    """
    return frozenset(
        amount
        for number, unit in _numbers_with_units(_spelled_out(folded))
        for amount in _amounts(number, unit)
    )


def _amounts(number: str, unit: str) -> Iterator[tuple[int, int]]:
    for value in _number(number) if number else (1.0,):
        for measure, units in enumerate(_MEASURES):
            if unit in units and math.isfinite(amount := units[unit] * value):
                yield measure, round(amount)


def _numbers_with_units(text: str) -> Iterator[tuple[str, str]]:
    for before, unit, joined, joined_unit in _QUANTITY.findall(text):
        yield before or joined, unit or joined_unit


def stated_in_other_units(folded: str, stated_quantities: frozenset[tuple[int, int]]) -> frozenset[str]:
    """The numbers of a text whose quantities are among those given, possibly in other units."""
    return frozenset(
        plain(number)
        for number, unit in _numbers_with_units(folded)
        if number and not stated_quantities.isdisjoint(_amounts(number, unit))
    )
