"""Comparing texts."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.text import fold, says


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("The Blue Mug costs $12.50 today", "$12.50"),
        ("The Blue Mug costs $12.50 today", "12.50"),
        ("The Blue\n  Mug", "blue mug"),
        ("It's 14:30.", "14:30"),
        ("total: 5", "5"),
        ("Ｆｕｌｌ width ５", "full width 5"),
        ("Fernhill’s “best”", 'fernhill\'s "best"'),
        ("10–12 May", "10-12 may"),
        ("3 items, 4 left.", "4"),
        ("日本語 の 本", "日本語"),
        ("Die Do\xadnau\xaddampf\xadfahrt", "Donaudampffahrt"),
    ],
)
def test_says(text: str, phrase: str) -> None:
    assert says(fold(text), phrase)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("12.50", "12"),
        ("12.50", "50"),
        ("112.50", "12.50"),
        ("1,250", "250"),
        ("14:30", "30"),
        ("mugs", "mug"),
        ("smug", "mug"),
        ("", "mug"),
        ("mug", ""),
        ("mug", "  "),
    ],
)
def test_does_not_say(text: str, phrase: str) -> None:
    assert not says(fold(text), phrase)


@given(st.text())
def test_folding_twice_changes_nothing_and_nothing_raises(text: str) -> None:
    once = fold(text)
    assert " ".join(once.split()) == once
    says(once, text)


@given(st.text(alphabet="abcdef0123456789.,:$ ", min_size=1))
def test_a_text_says_itself(text: str) -> None:
    if fold(text):
        assert says(fold(text), text)


@given(st.text(), st.text())
def test_what_is_said_is_there(text: str, phrase: str) -> None:
    if says(fold(text), phrase):
        assert fold(phrase) in fold(text)
