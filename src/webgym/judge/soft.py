"""The score of an attempt: the share of the rubric's facts that hold (future work in the paper)."""

from __future__ import annotations

from collections.abc import Sequence

from webgym.core.task import Rubric
from webgym.core.verdict import FactJudgement


def score_of(rubric: Rubric, facts: Sequence[FactJudgement]) -> float | None:
    """The share of the rubric's facts that hold, 0 to 1; ``None`` unless every fact has a clear verdict.

    It supplements the binary reward and never replaces it: facts do not say whether the answer is right.
    """
    passed = {(fact.group, fact.index): fact.judgement.passed for fact in facts}
    expected = [(group.id, index) for group, index, _ in rubric.facts()]
    if any(passed.get(fact) is None for fact in expected):
        return None
    return sum(passed[fact] is True for fact in expected) / len(expected)
