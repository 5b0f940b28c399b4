from __future__ import annotations

import pytest
from tests.fuzz.fuzz_parser import attempt


@pytest.mark.parametrize("start", range(0, 4000, 1000))
def test_nearly_good_replies_mean_what_they_state_or_nothing(start: int) -> None:
    found = set()
    for seed in range(start, start + 1000):
        name, wrong, _ = attempt(seed)
        assert not wrong, f"seed {seed}: {wrong}"
        found.add(name)
    assert "action" in found
    assert len(found) >= 8  # of the ways to hold no action
