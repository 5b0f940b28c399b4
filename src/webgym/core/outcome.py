"""Every attempt ends in exactly one outcome, and this is the one place that decides which."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from enum import StrEnum
from typing import Any

from webgym.core.errors import JudgeError, PolicyError, SiteRefused
from webgym.core.verdict import Verdict


class Outcome(StrEnum):
    """How an attempt ended. Only the first three carry a reward."""

    SUCCESS = "success"
    FAILURE = "failure"
    TRUNCATED = "truncated"
    BLOCKED = "blocked"
    ENVIRONMENT_ERROR = "environment_error"
    POLICY_ERROR = "policy_error"
    JUDGE_ERROR = "judge_error"
    CANCELLED = "cancelled"

    @property
    def is_rewarded(self) -> bool:
        """Whether the attempt may enter a success rate and training."""
        return self in (Outcome.SUCCESS, Outcome.FAILURE, Outcome.TRUNCATED)

    @property
    def reward(self) -> float | None:
        """1.0 or 0.0; ``None`` for an outcome without a reward, which never counts as 0."""
        return float(self is Outcome.SUCCESS) if self.is_rewarded else None

    @property
    def is_error(self) -> bool:
        """Whether something failed that is not the attempt."""
        return self in (Outcome.ENVIRONMENT_ERROR, Outcome.POLICY_ERROR, Outcome.JUDGE_ERROR)

    @property
    def is_retried(self) -> bool:
        """Whether the task is attempted again: the attempt ended for a reason that is not the policy's."""
        return self in (Outcome.ENVIRONMENT_ERROR, Outcome.POLICY_ERROR, Outcome.CANCELLED)


def outcomes_line(counts: Mapping[Any, int]) -> str:
    """The number of attempts by outcome, on one line, but for those that did not happen."""
    return "".join(f"{counts[each]} {each}   " for each in Outcome if counts.get(each))


class Ending(StrEnum):
    """Why an episode stopped, before it is judged."""

    ANSWERED = "answered"
    BUDGET_SPENT = "budget_spent"
    STRAGGLER = "straggler"  # ended by the collector after its grace period
    SITE_REFUSED = "site_refused"  # the start page, asked for twice by the environment
    ENVIRONMENT_FAILED = "environment_failed"
    POLICY_FAILED = "policy_failed"
    CANCELLED = "cancelled"

    @property
    def is_regular(self) -> bool:
        """Whether the agent ended it, or its budget did, so that it is judged."""
        return self in (Ending.ANSWERED, Ending.BUDGET_SPENT)


def ending_of(error: BaseException) -> Ending:
    """The ending of an episode that this error stopped.

    Every error that is not the policy's counts as the environment's, bugs of WebGym included: an attempt that
    ran into a bug must not count as the policy's failure.
    """
    if isinstance(error, asyncio.CancelledError):
        return Ending.CANCELLED
    if isinstance(error, SiteRefused):
        return Ending.SITE_REFUSED
    return Ending.POLICY_FAILED if isinstance(error, PolicyError) else Ending.ENVIRONMENT_FAILED


def outcome_of(ending: Ending, verdict: Verdict | JudgeError | None) -> Outcome:
    """The outcome of an episode.

    Args:
        ending: why the episode stopped.
        verdict: the judge's verdict, or its failure; ``None`` for an episode that was not judged because it
            was interrupted.

    Raises:
        ValueError: an episode that must be judged was not.
    """
    match ending:
        case Ending.SITE_REFUSED:
            return Outcome.BLOCKED
        case Ending.ENVIRONMENT_FAILED:
            return Outcome.ENVIRONMENT_ERROR
        case Ending.POLICY_FAILED:
            return Outcome.POLICY_ERROR
        case Ending.CANCELLED | Ending.STRAGGLER:
            return Outcome.CANCELLED
        case Ending.ANSWERED | Ending.BUDGET_SPENT:
            if verdict is None:
                raise ValueError(f"an episode that ended as {ending} must be judged")
            if isinstance(verdict, JudgeError):
                return Outcome.JUDGE_ERROR
            if verdict.blocked.passed:
                return Outcome.BLOCKED
            if verdict.reward is None:  # from a user's own judge: a missing reward is never a reward of 0
                return Outcome.JUDGE_ERROR
            if ending is not Ending.ANSWERED:
                return Outcome.TRUNCATED
            return Outcome.SUCCESS if verdict.reward == 1 else Outcome.FAILURE
