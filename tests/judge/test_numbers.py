"""Reading numbers."""

from __future__ import annotations

from decimal import Decimal

from hypothesis import given
from hypothesis import strategies as st

from webgym.judge.numbers import numbers


def test_numbers_are_read_as_numbers() -> None:
    assert numbers("1,234.50 and 1234.5, 7 of 12") == {Decimal("1234.5"), Decimal(7), Decimal(12)}
    assert numbers("14:30") == {Decimal(14), Decimal(30)}
    assert numbers("2026.05.11") == {Decimal(2026), Decimal(5), Decimal(11)}
    assert numbers("none") == set()


@given(st.text())
def test_any_text_has_numbers_or_none(text: str) -> None:
    assert all(number.is_finite() for number in numbers(text))
