"""The objective once more, written from its formula: numbers, loops, and gradients by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass
class Token:
    """Log-probabilities of a token."""

    new: float
    proximal: float
    behaviour: float
    start: float
    advantage: float = 0.0


@dataclass
class Run:
    """An attempt: its steps, each a list of tokens."""

    reward: float
    score: float | None = None
    ended: bool = True
    steps: list[list[Token]] = field(default_factory=list)


def set_advantages(
    groups: list[list[Run]], *, baseline: str, std: bool, soft: float, divisor: float
) -> list[Run]:
    """The runs that are trained on."""
    kept: list[Run] = []
    for group in groups:
        rewards = [
            1.0 if run.reward == 1 else soft * (run.score if run.score is not None else 0.0) for run in group
        ]
        n = len(rewards)
        mean = sum(rewards) / n
        spread = sum((r - mean) ** 2 for r in rewards)
        if baseline != "none" and (spread == 0 or any(not run.ended for run in group)):
            continue
        for index, run in enumerate(group):
            advantage = rewards[index]
            if baseline == "mean":
                advantage -= mean
            if baseline == "leave_one_out":
                advantage -= sum(r for other, r in enumerate(rewards) if other != index) / (n - 1)
            if std:
                advantage /= math.sqrt(spread / (n - 1))
            advantage /= divisor
            if advantage != 0:
                kept.append(run)
                for step in run.steps:
                    for token in step:
                        token.advantage = advantage
    return kept


def loss_and_gradient(
    runs: list[Run],
    *,
    ratio: str,
    low: float,
    high: float,
    dual: float | None,
    largest: float | None,
    kl: float,
) -> tuple[float, list[float]]:
    """The mean loss over tokens, and its derivative by each token's ``new``, in their order."""
    count = sum(len(step) for run in runs for step in run.steps)
    total, slopes = 0.0, []
    for run in runs:
        units: list[list[Token]] = []
        for step in run.steps:
            if ratio in ("none", "token"):
                units += [[token] for token in step]
            elif ratio == "step":
                units.append(step)
        if ratio == "sequence":
            units = [[token for step in run.steps for token in step]]
        for unit in units:
            n, a = len(unit), unit[0].advantage
            q = math.exp(sum(t.new - t.proximal for t in unit) / n)
            w = math.exp(sum(t.proximal - t.behaviour for t in unit) / n)
            if largest is not None and w > largest:
                w = 0.0
            # The loss of the unit is n times the same value; dq/dnew = q / n for each of its tokens.
            value, slope = -a * q, -a
            held = min(max(q, 1 - low), 1 + high)
            if -a * held > value:
                value, slope = -a * held, 0.0
            if dual is not None and a < 0 and value > dual * -a:
                value, slope = dual * -a, 0.0
            for t in unit:
                d = t.start - t.new
                if ratio == "none":
                    total += -a * t.new
                    by_new = -a
                else:
                    total += w * value
                    by_new = n * w * slope * q / n
                total += kl * (math.exp(d) - d - 1)
                by_new += kl * (1 - math.exp(d))
                slopes.append(by_new / count)
    return total / count, slopes
