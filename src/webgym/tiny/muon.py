"""Muon: momentum whose matrices are made orthogonal before they are added.

``torch.optim.Muon`` does the same, but always in bfloat16, which processors without instructions for it
emulate (there it takes a hundred times longer than the rest of an update), and one matrix after another.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch

_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
"""Of the quintic iteration (Jordan et al. 2024): steep at 0, so that five rounds are enough."""


class Muon(torch.optim.Optimizer):
    """For matrices alone.

    Args:
        params: two-dimensional.
        lr: learning rate, for a square matrix; taller ones take larger steps.
        momentum: of the gradients, Nesterov's.
        weight_decay: decoupled.
        rounds: of the iteration that makes a matrix orthogonal.
        dtype: of the numbers in these rounds.
    """

    def __init__(
        self,
        params: Iterable[torch.nn.Parameter],
        lr: float = 0.01,
        momentum: float = 0.95,
        weight_decay: float = 0.0,
        rounds: int = 5,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        held = {"lr": lr, "momentum": momentum, "weight_decay": weight_decay, "rounds": rounds}
        super().__init__(params, held)
        self._dtype = dtype

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:
        """One update. Matrices of one shape are made orthogonal together."""
        del closure
        for group in self.param_groups:
            shapes: dict[torch.Size, list[torch.nn.Parameter]] = {}
            for weight in group["params"]:
                if weight.grad is not None:
                    shapes.setdefault(weight.shape, []).append(weight)
            for weights in shapes.values():
                found = [self._momentum(weight, group["momentum"]) for weight in weights]
                moved = orthogonal(torch.stack(found).to(self._dtype), group["rounds"])
                rate = group["lr"] * max(1.0, weights[0].shape[0] / weights[0].shape[1]) ** 0.5
                for weight, direction in zip(weights, moved, strict=True):
                    weight.mul_(1 - group["lr"] * group["weight_decay"]).sub_(direction, alpha=rate)

    def _momentum(self, weight: torch.nn.Parameter, momentum: float) -> torch.Tensor:
        assert weight.grad is not None
        state = self.state[weight]
        if "momentum" not in state:
            state["momentum"] = torch.zeros_like(weight)
        held: torch.Tensor = state["momentum"]
        held.lerp_(weight.grad, 1 - momentum)
        return weight.grad.lerp(held, momentum)


def orthogonal(matrices: torch.Tensor, rounds: int) -> torch.Tensor:
    """The nearest orthogonal matrices, about: singular values end between 0.7 and 1.2.

    Args:
        matrices: (matrices, rows, columns), float32 or bfloat16.
        rounds: of Newton's and Schulz's iteration.
    """
    a, b, c = _COEFFICIENTS
    is_tall = matrices.shape[-2] > matrices.shape[-1]
    x = matrices.mT if is_tall else matrices
    x = x / (x.norm(dim=(-2, -1), keepdim=True) + 1e-7)
    for _ in range(rounds):
        square = x @ x.mT
        x = a * x + (b * square + c * square @ square) @ x
    return x.mT if is_tall else x
