"""A judge's verdict on a trajectory (paper §3.4)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, TypeAlias

import msgspec

Fault: TypeAlias = Literal["form", "wrong value", "no evidence", "state"]
"""Why an answered attempt failed, the first that holds: its answer has not the form that the task asks for,
or gives a wrong value; what proves a fact was not seen; the website's server is not in the wanted state."""


class Judgement(msgspec.Struct, frozen=True, omit_defaults=True):
    """The answer to one yes-or-no question, with the reason.

    Attributes:
        passed: the answer; ``None`` if the judge's reply could not be parsed and the outcome did not depend
            on it.
        reason: one sentence that a person can check; where ``passed`` is ``None``, why the reply could not
            be parsed.
        steps: indices of the steps whose observations support it.
    """

    passed: bool | None
    reason: str
    steps: tuple[int, ...] = ()


def all_hold(judgements: Iterable[Judgement]) -> bool | None:
    """``True`` if all passed, ``False`` if any failed, else ``None``: at least one could not be parsed."""
    answers = {judgement.passed for judgement in judgements}
    return False if False in answers else None if None in answers else True


class FactJudgement(msgspec.Struct, frozen=True):
    """The judgement of one fact (criterion A)."""

    group: int
    index: int
    fact: str
    judgement: Judgement


class Cost(msgspec.Struct, frozen=True, omit_defaults=True):
    """The cost of the model calls for one verdict.

    Attributes:
        calls: number of replies, cached ones included.
        cached: how many of them came from the cache and cost nothing.
        repeats: how many were requested because the previous reply contained no clear verdict.
        prompt_tokens, completion_tokens: as the endpoints counted them, without cached replies.
        dollars: by the price table; 0 for a model without a known price.
    """

    calls: int = 0
    cached: int = 0
    repeats: int = 0
    prompt_tokens: int = 0
    completion_tokens: int = 0
    dollars: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(*(getattr(self, name) + getattr(other, name) for name in self.__struct_fields__))

    def __str__(self) -> str:
        if not self.calls:
            return "no model was called"
        parts = [f"{self.calls:,} replies"]
        if self.cached:
            parts.append(f"{self.cached:,} from the cache")
        if self.repeats:
            parts.append(f"{self.repeats:,} repeated")
        parts.append(f"{self.prompt_tokens:,} + {self.completion_tokens:,} tokens")
        parts.append(f"${self.dollars:.4f}" if self.dollars else "price unknown")
        return ", ".join(parts)


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """A judge's verdict on one episode.

    Attributes:
        judge: name and version of the judge.
        reward: 1 if every fact and the response pass, else 0; a reference answer overrides by the judge's
            rule. ``None`` only for a blocked attempt.
        fault: why an answered attempt failed; ``None`` if it did not, or if the judge does not say.
        facts: criterion A, in rubric order; facts that a judge skipped because it stopped early are missing.
            A judgement that could not be parsed is included only if the reward was decided without it.
        response: criterion B, every claim in the answer is visible; ``None`` if there was no answer.
        reference: comparison with the reference answer, which overrides; ``None`` if the task has none.
        blocked: whether the website kept the agent out.
        score: share of the facts that hold, 0 to 1, for analysis, and for shaping a reward that also depends
            on the answer, as a wrong one can have 1.0; it never replaces the reward. ``None`` if not every
            fact was judged.
        confidence: share of several judges or samples that gave this reward, 0 to 1; ``None`` from a single
            one.
        keypoints: indices of the observations whose screenshots the judge saw; ``None`` for all.
        cost: cost of the model calls; ``None`` from a judge that calls no model.
        prompts: SHA-256 of the prompts' fixed texts; empty from a judge that calls no model.

    Raises:
        ValueError: the reward is not the integer 0 or 1, or ``None``.
    """

    judge: str
    reward: int | None
    facts: tuple[FactJudgement, ...]
    blocked: Judgement
    response: Judgement | None = None
    reference: Judgement | None = None
    score: float | None = None
    fault: Fault | None = None
    confidence: float | None = None
    keypoints: tuple[int, ...] | None = None
    cost: Cost | None = None
    prompts: str = ""

    def __post_init__(self) -> None:
        # What is neither, such as NaN from a judge of a user's own, would count as a reward of 0.
        if self.reward is not None and (type(self.reward) is not int or self.reward not in (0, 1)):
            raise ValueError(f"a verdict's reward is the integer 0 or 1, or None, not {self.reward!r}")
