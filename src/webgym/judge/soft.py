"""Rubrics as soft guidance (paper's own future work): how much of a task was done."""

from __future__ import annotations

from collections.abc import Sequence

from webgym.core.task import Rubric
from webgym.core.verdict import FactJudgement


def score_of(rubric: Rubric, facts: Sequence[FactJudgement]) -> float | None:
    """The share of the rubric's facts that hold, 0 to 1; ``None`` unless every fact was judged and read.

    A shaped score beside the binary reward. It never stands in for it: facts say nothing of whether the
    answer is right.
    """
    found = {(fact.group, fact.index): fact.judgement.passed for fact in facts}
    wanted = [(group.id, index) for group, index, _ in rubric.facts()]
    if any(found.get(place) is None for place in wanted):
        return None
    return sum(found[place] is True for place in wanted) / len(wanted)
