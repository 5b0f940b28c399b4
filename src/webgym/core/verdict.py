"""What a judge says about a trajectory (paper §3.4)."""

from __future__ import annotations

import msgspec


class Judgement(msgspec.Struct, frozen=True, omit_defaults=True):
    """One yes-or-no finding and why.

    Attributes:
        passed: the finding.
        reason: one sentence that a person can check.
        steps: indices of the steps whose observations it rests on.
    """

    passed: bool
    reason: str
    steps: tuple[int, ...] = ()


class FactJudgement(msgspec.Struct, frozen=True):
    """Criterion A for one fact."""

    group: int
    index: int
    fact: str
    judgement: Judgement


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """A whole judgement.

    Attributes:
        judge: who judged, and by which rules (name and version).
        reward: 1 if every fact and the response pass and the reference answer, if any, is met; else 0.
            ``None`` only for a blocked attempt.
        facts: criterion A, in rubric order.
        response: criterion B, every claim in the answer is visible; ``None`` if there was no answer.
        reference: the answer against the reference answer; ``None`` where there is none. It overrides.
        blocked: whether the website kept the agent out.
    """

    judge: str
    reward: int | None
    facts: tuple[FactJudgement, ...]
    blocked: Judgement
    response: Judgement | None = None
    reference: Judgement | None = None
