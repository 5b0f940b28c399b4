"""Objectives that should teach nothing about success: what they gain, any other row gains without it."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping

import msgspec

from webgym.train.objectives import Attempt, FilteredBC


class AllAttempts(FilteredBC):
    """Cloning without the filter: every attempt with a reward is imitated, right or wrong."""

    def advantages(self, attempts: Iterable[Attempt]) -> Mapping[str, float]:
        """1 for all."""
        return {attempt.id: 1.0 for attempt in attempts}


class ShuffledRewards(FilteredBC):
    """Filtered cloning of as many attempts as succeeded, drawn at random."""

    def advantages(self, attempts: Iterable[Attempt]) -> Mapping[str, float]:
        """1 for those that the others' rewards fall to."""
        attempts = sorted(attempts, key=lambda attempt: attempt.id)
        rewards = [attempt.reward for attempt in attempts]
        random.Random(" ".join(attempt.id for attempt in attempts)).shuffle(rewards)
        shuffled = zip(attempts, rewards, strict=True)
        return super().advantages(msgspec.structs.replace(one, reward=reward) for one, reward in shuffled)
