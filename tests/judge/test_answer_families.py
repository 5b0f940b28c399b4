"""Generated answers: whatever holds the right answer among others is not it.

A sample; ``benchmarks/reference_answers.py`` runs all of it and prints a table.
"""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from benchmarks.reference_answers import Families, Known, offline_references, source_references

from webgym.judge.value_comparison import Match

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"

KNOWN = [
    Known("own", "Which animals are kept there?", "mice"),
    Known("own", "What is the capital of France?", "Paris"),
    Known("own", "Which city is named first?", "Berlin"),
    Known("own", "Which mug is the cheapest?", "Blue Mug"),
    Known("own", "Which mug is the largest?", "Old Jar"),
    Known("own", "Who wrote the first programme?", "Ada Lovelace"),
    Known("own", "How many kilometres is it to Rome?", "17"),
    Known("own", "How many albums are there?", "3"),
    Known("own", "How many copies were sold?", "43,621"),
    Known("own", "What does the mug cost?", "$12.50"),
    Known("own", "What does the jar cost?", "$9.00"),
    Known("own", "When does it open?", "May 3, 2024"),
    Known("own", "When does it close?", "16:45"),
    Known("own", "Is the mug in stock?", "Yes"),
    Known("own", "Is the jar in stock?", "No"),
    Known("own", "What is the status of the order?", "Cancelled"),
    Known("own", "What is the status of the other order?", "Completed"),
    Known("own", "Which fruits are sold?", "apples; pears"),
    Known("own", "Who is in the chair, and how many came?", "Mina Lachance; 2; 29 May"),
    Known("own", "Which grade did it get?", "B"),
    Known("own", "Which grade did the other get?", "A+"),
    Known("own", "Which novel is it?", "The Shining"),
]


def check(known: list[Known], *, rounds: int) -> float:
    """Assert that no case is judged wrong; the share of right answers that need no model."""
    families = Families(known, seed=7)
    wrong = [case for _ in range(rounds) for one in known for case in families.wrong(one)]
    assert len({case.family for case in wrong}) >= 11
    assert [case for case in wrong if case.match() is Match.SAME] == []
    right = [(case, case.match()) for one in known for case in families.right(one)]
    assert [case for case, match in right if match is Match.DIFFERENT] == []
    return sum(match is Match.SAME for _, match in right) / len(right)


def test_no_generated_answer_passes_or_fails_falsely() -> None:
    assert check(KNOWN, rounds=2) > 0.9


def test_nor_does_one_about_the_offline_web() -> None:
    found = offline_references(every=60)
    assert len(found) > 50
    assert check(random.Random(7).sample(found, 20), rounds=1) > 0.8


def test_nor_does_one_about_a_benchmark() -> None:
    found = source_references(DATA) if DATA.is_dir() else []
    if not found:
        pytest.skip(f"the source files are not at {DATA}")
    check(random.Random(7).sample(found, 20), rounds=1)
