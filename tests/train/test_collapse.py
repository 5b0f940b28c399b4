"""A policy that repeats itself is noticed."""

from __future__ import annotations

from typing import Any

import pytest

from webgym.core.errors import TrainingError
from webgym.train.figures import collapse_of, watch_for_collapse


def rows(*newest: tuple[float, float, float], update: bool = True) -> list[dict[str, Any]]:
    return [
        {
            "update": {"extra": {"logprob": sure}} if update else {},
            "collect": {"reply_characters": length, "unreadable_share": lost},
        }
        for sure, length, lost in [(-0.8, 100, 0.02), (-1.0, 110, 0.0), (-0.9, 90, 0.01), *newest]
    ]


@pytest.mark.parametrize(
    ("newest", "signs"),
    [
        ((-0.8, 120, 0.03), 0),
        ((-0.3, 120, 0.03), 0),  # surer alone: it learns
        ((-0.8, 190, 0.03), 0),
        ((-0.3, 190, 0.03), 2),
        ((-0.8, 190, 0.3), 2),
        ((-0.3, 190, 0.3), 3),
    ],
)
def test_two_signs_are_a_collapse(newest: tuple[float, float, float], signs: int) -> None:
    found = collapse_of(rows(newest))
    assert found.count(" from ") == signs


def test_nothing_is_said_of_the_first_iterations_nor_without_an_update() -> None:
    assert collapse_of(rows()) == ""
    assert collapse_of([]) == ""
    assert collapse_of(rows((-0.1, 120, 0.3), update=False)) == ""


def test_it_warns_or_stops_as_set() -> None:
    told: list[str] = []
    bad = rows((-0.3, 190, 0.3))
    watch_for_collapse(bad, "warn", told.append)
    assert "the policy seems to collapse: log-probabilities rose from -0.900 to -0.300" in told[0]
    watch_for_collapse(bad, "ignore", told.append)
    watch_for_collapse(rows((-0.8, 120, 0.03)), "stop", told.append)
    assert len(told) == 1
    with pytest.raises(TrainingError, match="unreadable replies grew from 1% to 30%"):
        watch_for_collapse(bad, "stop", told.append)
