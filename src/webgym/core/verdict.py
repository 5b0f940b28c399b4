"""A judge's verdict on a trajectory (paper §3.4)."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec


class Judgement(msgspec.Struct, frozen=True, omit_defaults=True):
    """One yes-or-no finding and why.

    Attributes:
        passed: the finding; ``None`` where the judge gave none that can be read, and the outcome did not hang
            on it.
        reason: one sentence that a person can check; of an unread one, why it could not be read.
        steps: indices of the steps whose observations it rests on.
    """

    passed: bool | None
    reason: str
    steps: tuple[int, ...] = ()


def all_hold(judgements: Iterable[Judgement]) -> bool | None:
    """Whether all hold: they do not as soon as one does not; ``None`` if that hangs on an unread one."""
    found = {judgement.passed for judgement in judgements}
    return False if False in found else None if None in found else True


class FactJudgement(msgspec.Struct, frozen=True):
    """Criterion A for one fact."""

    group: int
    index: int
    fact: str
    judgement: Judgement


class Cost(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a verdict took of models.

    Attributes:
        calls: replies that models gave, those from the cache included.
        cached: how many of them came from the cache and cost nothing.
        repeats: how many were asked for because the reply before held no clear verdict.
        prompt_tokens, completion_tokens: as the endpoints counted them, without cached replies.
        dollars: by the price table; 0 where no price is known.
    """

    calls: int = 0
    cached: int = 0
    repeats: int = 0
    prompt_tokens: int = 0
    completion_tokens: int = 0
    dollars: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(*(getattr(self, name) + getattr(other, name) for name in self.__struct_fields__))


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """A whole judgement.

    Attributes:
        judge: who judged, and by which rules (name and version).
        reward: 1 if every fact and the response pass, else 0; a reference answer overrides by the judge's
            rule. ``None`` only for a blocked attempt.
        facts: criterion A, in rubric order; a judge that stops early leaves out what it did not look at.
            One that was unread is among them only if the reward was decided without it.
        response: criterion B, every claim in the answer is visible; ``None`` if there was no answer.
        reference: the answer against the reference answer; ``None`` where there is none. It overrides.
        blocked: whether the website kept the agent out.
        score: share of the facts that hold, 0 to 1, for shaping and for reading; beside the reward, never
            in its place. ``None`` where not every fact was judged.
        confidence: share of several judges or samples that found this reward, 0 to 1; ``None`` from one.
        keypoints: indices of the observations whose screenshots were judged by; ``None`` if all.
        cost: of model calls; ``None`` from a judge that asks no model.
    """

    judge: str
    reward: int | None
    facts: tuple[FactJudgement, ...]
    blocked: Judgement
    response: Judgement | None = None
    reference: Judgement | None = None
    score: float | None = None
    confidence: float | None = None
    keypoints: tuple[int, ...] | None = None
    cost: Cost | None = None
