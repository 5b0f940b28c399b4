"""A little of what ``python -m tests.fuzz.fuzz_judge`` does for as long as one likes."""

from __future__ import annotations

import pytest
from tests.fuzz.judgements import Generator


@pytest.mark.parametrize("start", range(0, 4000, 1000))
def test_replies_and_answers_mean_what_they_are_known_to(start: int) -> None:
    kinds = set()
    for seed in range(start, start + 1000):
        case = Generator(seed).case()
        assert not case.is_wrong, f"seed {seed}: {case!r}"
        kinds.add(case.kind)
    assert len(kinds) == 12
