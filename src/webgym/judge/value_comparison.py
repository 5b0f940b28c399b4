"""Whether two values, or two texts of words and values, mean the same."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from enum import StrEnum
from typing import Final

from webgym.judge.units import CURRENCY_SIGNS, CURRENCY_WORDS, UNITS
from webgym.judge.values import Text, Token, Value


class Match(StrEnum):
    """The result of a comparison."""

    SAME = "same"
    DIFFERENT = "different"
    UNSURE = "unsure"


def same(one: Value, other: Value, asked: frozenset[tuple[str, str]] = frozenset()) -> Match:
    """Whether two values are equal; unsure where a spelling has several readings.

    Args:
        one: what is right.
        other: what is said.
        asked: units that the task asks for (see :func:`units_of`): only in those a bare 17 may be given.
    """
    if one.readings == other.readings:
        return Match.SAME
    if common := one.readings & other.readings:
        # Pounds of money or of mass: the other side says which. Days and times may be either.
        return Match.UNSURE if {kind for kind, _, _ in common} & {"date", "clock"} else Match.SAME
    if one.kinds == {"number"} and one.amount is not None and one.amount == other.amount:
        return Match.SAME if _unit(other) in asked else Match.UNSURE
    if one.kinds & other.kinds and not (_partial(one, other) or _rounded(one, other) or _alike(one, other)):
        return Match.DIFFERENT
    return Match.UNSURE


def _unit(value: Value) -> tuple[str, str]:
    """Kind, and currency or size."""
    kind, unit, _ = min(value.readings)
    return kind, unit or str(value.factor)


def units_of(told: Text) -> frozenset[tuple[str, str]]:
    """The units that a task asks for: their names without an amount."""
    found = {("money", CURRENCY_SIGNS[sign]) for sign in told.signs if sign in CURRENCY_SIGNS}
    words = [token.word for token in told.tokens]
    for before, word, after in zip(["", *words], words, [*words[1:], ""], strict=False):
        if before in _SIZED or after == "per" or len(word) < 2 or word in ("in", "second"):
            continue
        if word in UNITS:
            kind, factor = UNITS[word]
            found.add((kind, str(factor)))
        elif word in CURRENCY_WORDS:
            found.add(("money", CURRENCY_WORDS[word][0]))
        elif word == "percentage":
            found.add(("percent", "1"))
    return frozenset(found)


_SIZED: Final = frozenset("square cubic nautical light fluid metric per".split())
"""Words that make another unit of the one behind them."""


def _partial(one: Value, other: Value) -> bool:
    """Whether a date lacks what the other has and agrees in the rest, or a number its country's prefix."""
    if one.kinds == {"identifier"}:
        (a,), (b,) = one.readings, other.readings
        return a[2].lstrip("+").endswith(b[2].lstrip("+")[-7:])
    return any(
        all(x == y or "?" in (x, y) for x, y in zip(a.split("-"), b.split("-"), strict=True))
        for kind, _, a in one.readings
        for other_kind, _, b in other.readings
        if kind == other_kind == "date"
    )


def _rounded(one: Value, other: Value) -> bool:
    """Whether two amounts differ by no more than one of them is rounded by.

    In different units by a fiftieth, as conversions are; in one unit by half of the shorter one's last
    digit: 39.19 and 39.2, or 1,234,567 and 1.2 million.
    """
    if one.amount is None or other.amount is None:
        return False
    a, b = one.amount * one.factor, other.amount * other.factor
    if one.factor != other.factor:
        return abs(a - b) * 50 <= max(abs(a), abs(b))
    places = max(int(amount.as_tuple().exponent) for amount in (one.amount, other.amount))
    return a != b and abs(one.amount - other.amount) <= Decimal(1).scaleb(places) / 2


def _alike(one: Value, other: Value) -> bool:
    """Whether what tells two amounts apart may be a slip of the pen: a sign, or which country's dollars."""
    if one.amount is None or other.amount is None or abs(one.amount) != abs(other.amount):
        return False
    units = {unit for value in (one, other) for _, unit, _ in value.readings}
    return one.amount == -other.amount or units <= _DOLLARS or units <= {"JPY", "CNY"}


_DOLLARS: Final = frozenset({"USD", "AUD", "CAD", "NZD", "HKD", "SGD"})


def equal(one: Sequence[Token], other: Sequence[Token]) -> bool:
    """Whether two texts say the same, token by token."""
    return len(one) == len(other) and all(map(one_equal, one, other))


def one_equal(one: Token, other: Token) -> bool:
    """Whether two tokens are one value or one word."""
    if one.value and other.value:
        return same(one.value, other.value) is Match.SAME
    return one.word == other.word and one.value is None and other.value is None
