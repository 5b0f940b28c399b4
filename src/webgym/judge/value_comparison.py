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


def same(reference: Value, answer: Value, requested_units: frozenset[tuple[str, str]] = frozenset()) -> Match:
    """Whether two values are equal; unsure where a spelling has several readings.

    Args:
        reference: the value of the reference answer.
        answer: the value of the answer.
        requested_units: units that the task asks for (see :func:`units_of`); in these a number may lack its
            unit.
    """
    if reference.readings == answer.readings:
        return Match.SAME
    if common := reference.readings & answer.readings:
        # "5 pounds" may be money or mass: the other value decides. Ambiguous dates and times stay unsure.
        return Match.UNSURE if {kind for kind, _, _ in common} & {"date", "clock"} else Match.SAME
    if reference.kinds == {"number"} and reference.amount is not None and reference.amount == answer.amount:
        return Match.SAME if _unit(answer) in requested_units else Match.UNSURE
    if reference.kinds & answer.kinds and not (
        _partial(reference, answer) or _rounded(reference, answer) or _may_be_slip(reference, answer)
    ):
        return Match.DIFFERENT
    return Match.UNSURE


def _unit(value: Value) -> tuple[str, str]:
    """The kind of a value, and its currency or the size of its unit."""
    kind, unit, _ = min(value.readings)
    return kind, unit or str(value.factor)


def units_of(text: Text) -> frozenset[tuple[str, str]]:
    """The units that a task names without an amount, as kind and currency or size."""
    units = {("money", CURRENCY_SIGNS[sign]) for sign in text.signs if sign in CURRENCY_SIGNS}
    words = [token.word for token in text.tokens]
    for before, word, after in zip(["", *words], words, [*words[1:], ""], strict=False):
        if before in _UNIT_MODIFIERS or after == "per" or len(word) < 2 or word in ("in", "second"):
            continue
        if word in UNITS:
            kind, factor = UNITS[word]
            units.add((kind, str(factor)))
        elif word in CURRENCY_WORDS:
            units.add(("money", CURRENCY_WORDS[word][0]))
        elif word == "percentage":
            units.add(("percent", "1"))
    return frozenset(units)


_UNIT_MODIFIERS: Final = frozenset("square cubic nautical light fluid metric per".split())
"""Words that change the unit after them, as in "square metres"."""


def _partial(first: Value, second: Value) -> bool:
    """Whether two dates agree in the parts that both have, or two phone numbers but for the country code."""
    if first.kinds == {"identifier"}:
        (a,), (b,) = first.readings, second.readings
        return a[2].lstrip("+").endswith(b[2].lstrip("+")[-7:])
    return any(
        all(x == y or "?" in (x, y) for x, y in zip(a.split("-"), b.split("-"), strict=True))
        for kind, _, a in first.readings
        for other_kind, _, b in second.readings
        if kind == other_kind == "date"
    )


def _rounded(first: Value, second: Value) -> bool:
    """Whether two amounts differ by no more than rounding.

    In different units by 2 %, as conversions do; in the same unit by half of the last digit of the less
    precise one: 39.19 and 39.2, or 1,234,567 and 1.2 million.
    """
    if first.amount is None or second.amount is None:
        return False
    a, b = first.amount * first.factor, second.amount * second.factor
    if first.factor != second.factor:
        return abs(a - b) * 50 <= max(abs(a), abs(b))
    places = max(int(amount.as_tuple().exponent) for amount in (first.amount, second.amount))
    return a != b and abs(first.amount - second.amount) <= Decimal(1).scaleb(places) / 2


def _may_be_slip(first: Value, second: Value) -> bool:
    """Whether two amounts differ only in sign or in which country's dollars they are, which may be a slip."""
    if first.amount is None or second.amount is None or abs(first.amount) != abs(second.amount):
        return False
    units = {unit for value in (first, second) for _, unit, _ in value.readings}
    return first.amount == -second.amount or units <= _DOLLARS or units <= {"JPY", "CNY"}


_DOLLARS: Final = frozenset({"USD", "AUD", "CAD", "NZD", "HKD", "SGD"})


def equal(first: Sequence[Token], second: Sequence[Token]) -> bool:
    """Whether two texts are equal, token by token."""
    return len(first) == len(second) and all(map(equal_tokens, first, second))


def equal_tokens(first: Token, second: Token) -> bool:
    """Whether two tokens are the same word or the same value."""
    if first.value and second.value:
        return same(first.value, second.value) is Match.SAME
    return first.word == second.word and first.value is None and second.value is None
