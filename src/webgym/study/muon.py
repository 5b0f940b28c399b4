"""The optimizer Muon, which orthogonalises the momentum of matrices before each step.

``torch.optim.Muon`` does the same, but one matrix at a time and always in bfloat16, which CPUs without native
support emulate (an optimizer step then takes a hundred times longer than the rest of an update).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch

_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
"""Coefficients of the quintic iteration (Jordan et al. 2024), which converges in five rounds."""


class Muon(torch.optim.Optimizer):
    """Muon for two-dimensional parameters.

    Args:
        params: two-dimensional parameters.
        lr: learning rate, for a square matrix; taller ones take larger steps.
        momentum: coefficient of the Nesterov momentum.
        weight_decay: decoupled weight decay.
        rounds: iterations of the orthogonalisation.
        dtype: of the orthogonalisation.
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
        defaults = {"lr": lr, "momentum": momentum, "weight_decay": weight_decay, "rounds": rounds}
        super().__init__(params, defaults)
        self._dtype = dtype

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:
        """Make a step. Matrices of the same shape are orthogonalised together."""
        del closure
        for group in self.param_groups:
            shapes: dict[torch.Size, list[torch.nn.Parameter]] = {}
            for weight in group["params"]:
                if weight.grad is not None:
                    shapes.setdefault(weight.shape, []).append(weight)
            for weights in shapes.values():
                momenta = [self._momentum(weight, group["momentum"]) for weight in weights]
                directions = orthogonal(torch.stack(momenta).to(self._dtype), group["rounds"])
                rate = group["lr"] * max(1.0, weights[0].shape[0] / weights[0].shape[1]) ** 0.5
                for weight, direction in zip(weights, directions, strict=True):
                    weight.mul_(1 - group["lr"] * group["weight_decay"]).sub_(direction, alpha=rate)

    def _momentum(self, weight: torch.nn.Parameter, momentum: float) -> torch.Tensor:
        assert weight.grad is not None
        state = self.state[weight]
        if "momentum" not in state:
            state["momentum"] = torch.zeros_like(weight)
        average: torch.Tensor = state["momentum"]
        average.lerp_(weight.grad, 1 - momentum)
        return weight.grad.lerp(average, momentum)


def orthogonal(matrices: torch.Tensor, rounds: int) -> torch.Tensor:
    """Approximately the nearest orthogonal matrices: singular values are between 0.7 and 1.2.

    Args:
        matrices: (matrices, rows, columns), float32 or bfloat16.
        rounds: number of Newton-Schulz iterations.
    """
    a, b, c = _COEFFICIENTS
    is_tall = matrices.shape[-2] > matrices.shape[-1]
    x = matrices.mT if is_tall else matrices
    x = x / (x.norm(dim=(-2, -1), keepdim=True) + 1e-7)
    for _ in range(rounds):
        square = x @ x.mT
        x = a * x + (b * square + c * square @ square) @ x
    return x.mT if is_tall else x
