"""The objective against an independent one (``formula.py``): loss and gradient for all of its options."""

from __future__ import annotations

import itertools
import random
from typing import Any

import pytest
import torch
from tests.train.formula import Run, Token, loss_and_gradient, set_advantages

from webgym.train.objectives import Attempt, FilteredBC, GroupIS, PolicyGradient, Tokens

BASELINES = [
    ("none", False),
    ("mean", False),
    ("mean", True),
    ("leave_one_out", False),
    ("leave_one_out", True),
]


def made() -> list[list[Run]]:
    """Groups that are mixed, all right, all wrong (but for their scores), and cut off."""
    dice = random.Random(47)

    def token(shift: float) -> Token:
        new = -dice.expovariate(1.0)
        near, far = dice.gauss(shift, 0.4), dice.gauss(shift, 1.5)
        return Token(new, new + near, new + near + far, new + dice.gauss(0, 0.5))

    def run(reward: float, score: float | None = None, *, ended: bool = True) -> Run:
        shift = dice.gauss(0, 0.8)
        steps = [[token(shift) for _ in range(dice.randint(1, 4))] for _ in range(dice.randint(1, 3))]
        return Run(reward, score, ended, steps)

    mixed = [run(1), run(0, 0.25), run(0, 1.0), run(0), run(1, 0.5)]
    wrong = [run(0, 0.5), run(0, 0.0), run(0, 0.5)]
    return [mixed, [run(1), run(1)], wrong, [run(1), run(0, ended=False)], [run(0), run(0)], [run(1)]]


def ours(objective: PolicyGradient, groups: list[list[Run]]) -> tuple[float, list[float]]:
    attempts = [
        Attempt(f"{task}/{place}", str(task), run.reward, run.score, all(each.ended for each in group))
        for task, group in enumerate(groups)
        for place, run in enumerate(group)
    ]
    found = objective.advantages(attempts)
    rows: list[tuple[float, ...]] = []
    steps = 0
    for task, group in enumerate(groups):
        for place, run in enumerate(group):
            if f"{task}/{place}" not in found:
                continue
            every = [token for step in run.steps for token in step]
            drift = sum(token.new - token.proximal for token in every) / len(every)
            lag = sum(token.proximal - token.behaviour for token in every) / len(every)
            for step in run.steps:
                steps += 1
                rows += [
                    (*(t.new, t.proximal, t.behaviour, t.start), found[f"{task}/{place}"], drift, lag, steps)
                    for t in step
                ]
    columns = torch.tensor(rows, dtype=torch.float64).unbind(-1)
    new, proximal, behaviour, start, advantage, drift_, lag_, step_ = columns
    new.requires_grad_()
    tokens = Tokens(new, advantage, behaviour, proximal, start, drift_, lag_, step_)
    loss = objective.loss(tokens).tokens.sum() / len(rows)
    loss.backward()
    assert new.grad is not None
    return float(loss.detach()), new.grad.tolist()


@pytest.mark.parametrize("ratio", ["none", "token", "step", "sequence"])
def test_loss_and_gradient_are_those_of_the_formula(ratio: str) -> None:
    losses: dict[tuple[object, ...], float] = {}
    for (baseline, std), clips, dual, largest, divisor, kl, soft in itertools.product(
        BASELINES, [(0.2, 0.2), (0.1, 0.4)], [None, 1.5], [None, 1.3], [1.0, 10.0], [0.0, 0.3], [0.0, 0.5]
    ):
        low, high = clips
        options: dict[str, Any] = {
            "baseline": baseline,
            "std": std,
            "ratio": ratio,
            "clip_low": low,
            "clip_high": high,
        }
        options |= {"dual_clip": dual, "largest_weight": largest, "step_divisor": divisor, "kl": kl}
        groups = made()
        objective = PolicyGradient.model_validate(options | {"soft": soft})
        kept = set_advantages(groups, baseline=baseline, std=std, soft=soft, divisor=divisor)
        loss, gradient = loss_and_gradient(
            kept, ratio=ratio, low=low, high=high, dual=dual, largest=largest, kl=kl
        )
        found = ours(objective, groups)
        assert found[0] == pytest.approx(loss, abs=1e-12), options
        assert found[1] == pytest.approx(gradient, abs=1e-12), options
        losses[baseline, std, clips, dual, largest, divisor, kl, soft] = round(loss, 9)
    for place, name in enumerate(("baseline", "std", "clips", "dual", "largest", "divisor", "kl", "soft")):
        others: dict[tuple[object, ...], set[float]] = {}
        for options_, loss in losses.items():
            others.setdefault(options_[:place] + options_[place + 1 :], set()).add(loss)
        matters = any(len(each) > 1 for each in others.values())
        assert matters is (ratio != "none" or name not in ("clips", "dual", "largest")), name


def test_the_presets_are_choices_of_options() -> None:
    cloning = PolicyGradient(baseline="none", std=False, step_divisor=1, ratio="none", staleness=None)
    assert cloning.model_dump() == FilteredBC().model_dump()
    assert PolicyGradient().model_dump() == GroupIS().model_dump()
