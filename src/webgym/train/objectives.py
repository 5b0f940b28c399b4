"""Training objectives, which are an extension point.

An objective determines three things; everything else is common to all objectives:

1. which judged trajectories are trained on, and their weights (:meth:`Objective.advantages`);
2. how old they may be (:attr:`Objective.max_age`), and whether the log-probabilities of the policy that
   sampled them are needed (:attr:`Objective.off_policy`);
3. the loss of each reply token (:meth:`Objective.loss`).

The tokens of a batch are flat vectors. The update sums the loss over all reply tokens of the effective batch
and divides by their number, however they are distributed over processes and micro-batches.
"""

from __future__ import annotations

import importlib
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, Protocol, runtime_checkable

import msgspec
import torch
from pydantic import Field, ValidationError

from webgym.core.errors import ConfigError
from webgym.core.settings import Settings, first_problem
from webgym.train.config import ObjectiveConfig

_LARGEST_LOG: Final = 20.0
"""Largest logarithm of a ratio of probabilities; a ratio is clipped far below."""


class Attempt(msgspec.Struct, frozen=True):
    """A judged trajectory, as seen by an objective.

    Attributes:
        id: unique in the iteration.
        task_id: attempts at the same task form a group.
        reward: 0 or 1.
    """

    id: str
    task_id: str
    reward: float


@dataclass(frozen=True, slots=True)
class Tokens:
    """The reply tokens of a batch, as vectors of equal length.

    Attributes:
        new: log-probabilities under the weights that are being trained; carries gradients.
        advantage: of the step that a token belongs to.
        behaviour: log-probabilities when the token was sampled; ``None`` unless ``off_policy`` is set.
        proximal: log-probabilities under the weights at the start of the update; ``None`` likewise.
    """

    new: torch.Tensor
    advantage: torch.Tensor
    behaviour: torch.Tensor | None = None
    proximal: torch.Tensor | None = None


@dataclass(frozen=True, slots=True)
class Loss:
    """The loss of each token, and sums over tokens for the log, which are divided by the number of tokens."""

    tokens: torch.Tensor
    sums: dict[str, torch.Tensor] = field(default_factory=dict)


@runtime_checkable
class Objective(Protocol):
    """A training objective."""

    @property
    def off_policy(self) -> bool:
        """Whether :attr:`Tokens.behaviour` and :attr:`Tokens.proximal` are needed."""
        ...

    @property
    def max_age(self) -> int | None:
        """Most updates by which a step's weights may be older than the newest; ``None`` for any number."""
        ...

    def advantages(self, attempts: Iterable[Attempt]) -> Mapping[str, float]:
        """The advantage of each trajectory that is trained on, by attempt id; others are omitted.

        Args:
            attempts: all attempts of an iteration that have a reward.
        """
        ...

    def loss(self, tokens: Tokens) -> Loss:
        """The loss of each token."""
        ...


class FilteredBC(Settings):
    """The paper's objective (§5): the likelihood of the actions in successful trajectories.

    REINFORCE with a 0/1 reward and no baseline: failures have weight 0. The
    log-likelihood of a reply is the sum over its tokens, so every token has the same weight.
    """

    off_policy: ClassVar[bool] = False
    max_age: ClassVar[int | None] = None

    def advantages(self, attempts: Iterable[Attempt]) -> Mapping[str, float]:
        """1 for every success."""
        return {attempt.id: 1.0 for attempt in attempts if attempt.reward == 1}

    def loss(self, tokens: Tokens) -> Loss:
        """The negative log-likelihood, weighted."""
        return Loss(-tokens.advantage * tokens.new)


class GroupIS(Settings):
    """Groups with a baseline, trained on off-policy (AsyncWebRL, arXiv 2606.05597).

    The attempts at a task in an iteration form a group. The advantage of an attempt is its reward minus the
    group's mean, divided by a constant: dividing by the number of steps instead would give each step of a
    short success more weight than a step of a long failure. Groups whose attempts all pass or all fail carry
    no signal and are left out, and so is every task that was attempted only once.

    The loss is the clipped surrogate against the proximal policy (the weights at the start of the update),
    times the importance weight of the proximal over the behaviour policy, which sampled the tokens: trust
    region and correction are decoupled, so stale data are corrected without being clipped away. No KL term.
    """

    off_policy: ClassVar[bool] = True

    clip: float = Field(default=0.2, gt=0)
    """The ratio of new to proximal probability is clipped to 1 - clip and 1 + clip."""

    dual_clip: float = Field(default=3.0, gt=1)
    """Most loss of a token with negative advantage, as a multiple of the advantage."""

    largest_weight: float = Field(default=5.0, gt=1)
    """Tokens with a larger importance weight are left out."""

    step_divisor: float = Field(default=10.0, gt=0)
    """The constant that advantages are divided by."""

    staleness: int = Field(default=2, ge=0)
    """Most updates by which a step's weights may be older than the newest."""

    @property
    def max_age(self) -> int | None:
        """The value of :attr:`staleness`."""
        return self.staleness

    def advantages(self, attempts: Iterable[Attempt]) -> Mapping[str, float]:
        """Reward minus the group's mean, divided by the constant; none for groups with equal rewards."""
        groups: defaultdict[str, list[Attempt]] = defaultdict(list)
        for attempt in attempts:
            groups[attempt.task_id].append(attempt)
        advantages_by_id: dict[str, float] = {}
        for group in groups.values():
            mean = sum(attempt.reward for attempt in group) / len(group)
            if len({attempt.reward for attempt in group}) > 1:
                advantages_by_id |= {
                    attempt.id: (attempt.reward - mean) / self.step_divisor for attempt in group
                }
        return advantages_by_id

    def loss(self, tokens: Tokens) -> Loss:
        """The decoupled, clipped surrogate."""
        assert tokens.behaviour is not None
        assert tokens.proximal is not None
        advantage = tokens.advantage
        # Bounded, because the gradient of an infinite number times 0 is not a number.
        ratio = torch.exp((tokens.new - tokens.proximal).clamp(max=_LARGEST_LOG))
        clipped = ratio.clamp(1 - self.clip, 1 + self.clip)
        surrogate = torch.maximum(-advantage * ratio, -advantage * clipped)
        bounded = torch.minimum(surrogate, self.dual_clip * advantage.abs())
        log_weight = tokens.proximal - tokens.behaviour
        largest = math.log(self.largest_weight)
        usable = log_weight <= largest
        weight = torch.exp(log_weight.clamp(max=largest))
        with torch.no_grad():
            sums = {
                "clipped": (surrogate > -advantage * ratio).float().sum(),
                "dropped": (~usable).float().sum(),
                "importance_weight": weight.sum(),
                "ratio": ratio.sum(),
            }
        return Loss(torch.where(usable, bounded * weight, 0.0), sums)


OBJECTIVES: Final = {"filtered_bc": FilteredBC, "group_is": GroupIS}


def make_objective(config: ObjectiveConfig) -> Objective:
    """Create the configured objective: one of :data:`OBJECTIVES`, or ``module:attribute``.

    The imported attribute is called with the options and must return an :class:`Objective`.

    Raises:
        ConfigError: there is no such objective, or it does not accept the options.
    """
    maker: Any = OBJECTIVES.get(config.name) or _imported(config.name)
    try:
        made = maker(**config.options)
    except (ValidationError, TypeError) as error:
        reason = first_problem(error, maker) if isinstance(error, ValidationError) else str(error)
        raise ConfigError(f"the objective {config.name} does not take its options: {reason}") from error
    if not isinstance(made, Objective):
        raise ConfigError(
            f"{config.name} is not an objective",
            hint="see webgym.train.objectives.Objective for the interface",
        )
    return made


def _imported(name: str) -> Any:
    module, colon, attribute = name.partition(":")
    if not colon:
        known = ", ".join(OBJECTIVES)
        raise ConfigError(f"unknown objective {name!r}", hint=f"one of {known}, or module:attribute")
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(f"cannot import the objective {name}: {error}") from error
