from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.agent.strategies import JSON_OBJECTS

from webgym.agent.memory import merge
from webgym.core.trajectory import Revision


@pytest.mark.parametrize(
    ("old", "new", "merged", "revision"),
    [
        ({}, {"a": 1}, {"a": 1}, Revision()),
        ({"a": 1}, {"a": 1, "b": 2}, {"a": 1, "b": 2}, Revision()),
        ({"a": 1}, {"b": 2}, {"a": 1, "b": 2}, Revision(dropped=("a",))),
        ({"a": 1}, {"a": 2}, {"a": 1, "a (2)": 2}, Revision(rewritten=("a",))),
        ({"a": 1}, {"a": True}, {"a": 1, "a (2)": True}, Revision(rewritten=("a",))),
        ({"a": 1, "a (2)": 2}, {"a": 2}, {"a": 1, "a (2)": 2}, Revision()),
        ({"a": 1, "a (2)": 2}, {"a": 3}, {"a": 1, "a (2)": 2, "a (3)": 3}, Revision(rewritten=("a",))),
        ({"a": "one"}, {"a": "one, two"}, {"a": "one, two"}, Revision()),
        ({"a": "one"}, {"a": "two"}, {"a": "one", "a (2)": "two"}, Revision(rewritten=("a",))),
        ({"a": [1]}, {"a": [1, 2]}, {"a": [1, 2]}, Revision()),
        ({"a": [1, 2]}, {"a": [2, 1]}, {"a": [1, 2], "a (2)": [2, 1]}, Revision(rewritten=("a",))),
        ({"a": {"x": 1}}, {"a": {"x": 1, "y": 2}}, {"a": {"x": 1, "y": 2}}, Revision()),
        ({"a": {"x": 1}}, {"a": {"y": 2}}, {"a": {"x": 1}, "a (2)": {"y": 2}}, Revision(rewritten=("a",))),
        ({"a": 1}, {}, {"a": 1}, Revision(dropped=("a",))),
        ({"a": None}, {"a": 1}, {"a": None, "a (2)": 1}, Revision(rewritten=("a",))),
    ],
)
def test_merging(old: Any, new: Any, merged: Any, revision: Revision) -> None:
    assert merge(old, new, max_chars=1000) == (merged, revision)
    assert bool(revision) == (revision != Revision())


def test_what_has_no_room_is_refused_and_the_rest_is_taken() -> None:
    merged, revision = merge({"a": "x"}, {"a": "x", "big": "y" * 100, "b": 1}, max_chars=40)
    assert merged == {"a": "x", "b": 1}
    assert revision == Revision(refused=("big",))


@given(st.lists(JSON_OBJECTS, max_size=5), st.integers(2, 200))
def test_nothing_is_ever_forgotten_and_the_limit_holds(replies: list[dict[str, Any]], limit: int) -> None:
    memory: dict[str, Any] = {}
    for reply in replies:
        before = json.loads(json.dumps(memory))
        merged, revision = merge(memory, reply, max_chars=limit)
        assert memory == before
        assert all(key in merged for key in memory)
        for key, value in reply.items():
            kept = [kept for place, kept in merged.items() if place == key or place.startswith(f"{key} (")]
            assert value in kept or key in revision.refused
        for key, value in memory.items():
            if key not in reply:
                assert merged[key] == value
        assert len(json.dumps(merged, ensure_ascii=False)) <= max(limit, 2)
        memory = merged
