"""Training objectives, which are an extension point.

An objective determines three things; everything else is common to all objectives:

1. which judged trajectories are trained on, and their weights (:meth:`Objective.advantages`);
2. how old they may be (:attr:`Objective.max_age`), and whether the log-probabilities of the policy that
   sampled them are needed (:attr:`Objective.off_policy`);
3. the loss of each reply token (:meth:`Objective.loss`).

:class:`PolicyGradient` is the one of this package.

The tokens of a batch are flat vectors. The update sums the loss over all reply tokens of the effective batch
and divides by their number, however they are distributed over processes and micro-batches.
"""

from __future__ import annotations

import importlib
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from statistics import fmean, stdev
from typing import Any, Final, Literal, Protocol, TypeAlias, runtime_checkable

import msgspec
import torch
from pydantic import Field, ValidationError, model_validator

from webgym.core.errors import ConfigError
from webgym.core.settings import Settings, first_problem
from webgym.train.config import ObjectiveConfig

_LARGEST_LOG: Final = 20.0
"""Largest logarithm of a ratio of probabilities; a ratio is clipped far below."""


Baseline: TypeAlias = Literal["none", "mean", "leave_one_out"]
Ratio: TypeAlias = Literal["none", "token", "step", "sequence"]
Need: TypeAlias = Literal["start", "drift"]


class Attempt(msgspec.Struct, frozen=True):
    """A judged trajectory, as seen by an objective.

    Attributes:
        id: unique among the attempts that are given together.
        task_id: attempts at the same task form a group.
        reward: 0 or 1.
        score: share of the rubric's facts that hold, 0 to 1; ``None`` if the judge did not judge them all.
        is_whole: whether all attempts of its group ended. One that a clock cut off, or that goes on, may have
            failed more often than the others, so that the mean of the rest is no baseline.
    """

    id: str
    task_id: str
    reward: float
    score: float | None = None
    is_whole: bool = True


@dataclass(frozen=True, slots=True)
class Tokens:
    """The reply tokens of a batch, as vectors of equal length.

    Attributes:
        new: log-probabilities under the weights that are being trained; carries gradients.
        advantage: of the step that a token belongs to.
        behaviour: log-probabilities when the token was sampled; ``None`` unless ``off_policy`` is set.
        proximal: log-probabilities under the weights at the start of the update; ``None`` likewise.
        start: log-probabilities under the weights that learning started from; ``None`` unless needed.
        drift, lag: means of new - proximal, and of proximal - behaviour, over all tokens of a trajectory,
            without gradients; likewise.
        step: a number for each token, equal for the tokens of one step; ``None`` for one step of one token.
    """

    new: torch.Tensor
    advantage: torch.Tensor
    behaviour: torch.Tensor | None = None
    proximal: torch.Tensor | None = None
    start: torch.Tensor | None = None
    drift: torch.Tensor | None = None
    lag: torch.Tensor | None = None
    step: torch.Tensor | None = None


@dataclass(frozen=True, slots=True)
class Loss:
    """The loss of each token, and figures for the log.

    Attributes:
        tokens: the losses.
        sums: over tokens, which are divided by the number of tokens.
        maxima: over tokens.
    """

    tokens: torch.Tensor
    sums: dict[str, torch.Tensor] = field(default_factory=dict)
    maxima: dict[str, torch.Tensor] = field(default_factory=dict)


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


class PolicyGradient(Settings):
    """The one objective of this package; :class:`FilteredBC` and :class:`GroupIS` are choices of its options.

    With the rewards r of a group (the attempts at one task in an iteration), the advantage of each is

        A = (r - baseline) / (standard deviation of the group, or 1) / step_divisor

    and groups whose rewards are equal carry no signal and are left out. Every token of every step of an
    attempt has its advantage: dividing by the number of steps instead of a constant would give each step of
    a short success more weight than a step of a long failure.

    With the probabilities of a token under the weights that are trained (new), those at the start of the
    update (proximal), and those that sampled it (behaviour), its loss is

        w * min(max(-A q, -A clip(q, 1 - clip_low, 1 + clip_high)), dual_clip |A|) + kl * K

        q = new / proximal    w = proximal / behaviour, or 0 above largest_weight
        K = e**d - d - 1, d = log(start / new)    (an estimate of the KL divergence of new from the start)

    Trust region (q) and correction (w) are decoupled, so stale data are corrected without being clipped
    away (AReaL, arXiv 2505.24298). Without ratios the loss is the likelihood, ``-A log(new)``.
    """

    baseline: Baseline = "mean"
    """``mean`` of the group, mean of the other attempts (``leave_one_out``), or ``none``: then failures have
    no advantage."""

    std: bool = True
    """Divide by the group's standard deviation (of a sample: n - 1)."""

    soft: float = Field(default=0.0, ge=0, lt=1)
    """Reward of a failed attempt whose rubric held in full; in proportion if it held in part."""

    step_divisor: float = Field(default=10.0, gt=0)
    """The constant that advantages are divided by. AdamW is invariant to it unless gradients are clipped
    (``learn.update.max_grad_norm``) or there is a KL term, whose weight it sets."""

    ratio: Ratio = "token"
    """What shares q and w: each ``token`` has its own; the tokens of a ``step``, or of all steps of a
    trajectory (``sequence``), share the geometric means (as in GSPO, arXiv 2507.18071). ``none``: no ratios,
    and data need no log-probabilities."""

    clip_low: float = Field(default=0.2, gt=0, le=1)
    """q is clipped to 1 - clip_low from below."""

    clip_high: float = Field(default=0.2, gt=0)
    """q is clipped to 1 + clip_high from above."""

    dual_clip: float | None = Field(default=3.0, gt=1)
    """Most loss of a token with negative advantage, as a multiple of the advantage; ``None`` for any."""

    largest_weight: float | None = Field(default=5.0, gt=1)
    """Tokens with a larger importance weight w are left out; ``None`` for none."""

    kl: float = Field(default=0.0, ge=0)
    """Weight of the KL divergence from the weights that learning started from."""

    staleness: int | None = Field(default=2, ge=0)
    """Most updates by which a step's weights may be older than the newest; ``None`` for any number."""

    @model_validator(mode="after")
    def _check_options(self) -> PolicyGradient:
        if self.std and self.baseline == "none":
            raise ValueError("std needs a baseline: a group with equal rewards has no deviation")
        return self

    @property
    def off_policy(self) -> bool:
        """Whether there are ratios."""
        return self.ratio != "none"

    @property
    def max_age(self) -> int | None:
        """The value of :attr:`staleness`."""
        return self.staleness

    @property
    def needs(self) -> frozenset[Need]:
        """Whether :attr:`Tokens.start`, and the means over trajectories, are needed. An objective without
        this attribute gets neither."""
        names: dict[Need, bool] = {"start": self.kl > 0, "drift": self.ratio == "sequence"}
        return frozenset(name for name, is_needed in names.items() if is_needed)

    def advantages(self, attempts: Iterable[Attempt]) -> Mapping[str, float]:
        """As in the class's formula; with a baseline, none for groups with equal rewards or cut-off
        attempts."""
        groups: defaultdict[str, list[Attempt]] = defaultdict(list)
        for attempt in attempts:
            groups[attempt.task_id].append(attempt)
        found: dict[str, float] = {}
        for group in groups.values():
            rewards = [max(attempt.reward, self.soft * (attempt.score or 0.0)) for attempt in group]
            scale = self.step_divisor
            if self.baseline != "none":
                if len(set(rewards)) == 1 or not all(attempt.is_whole for attempt in group):
                    continue
                centre, count = fmean(rewards), len(rewards)
                scale *= stdev(rewards) if self.std else 1.0
                scale *= (count - 1) / count if self.baseline == "leave_one_out" else 1.0
                rewards = [reward - centre for reward in rewards]
            found |= {
                attempt.id: reward / scale for attempt, reward in zip(group, rewards, strict=True) if reward
            }
        return found

    def loss(self, tokens: Tokens) -> Loss:
        """As in the class's formula."""
        found = self._surrogate(tokens) if self.off_policy else Loss(-tokens.advantage * tokens.new)
        if not self.kl:
            return found
        assert tokens.start is not None
        to_start = divergence(tokens.start - tokens.new)
        sums = found.sums | {"kl_start": to_start.detach().sum()}
        return Loss(found.tokens + self.kl * to_start, sums, found.maxima)

    def _surrogate(self, tokens: Tokens) -> Loss:
        assert tokens.behaviour is not None
        assert tokens.proximal is not None
        advantage = tokens.advantage
        each = tokens.new - tokens.proximal
        # The tokens that share a mean each have their own gradient: they add up to that of the mean times
        # the number of tokens. Bounded, because that of an infinite number times 0 is not a number.
        log_ratio = self._shared(each.detach(), tokens, tokens.drift) + (each - each.detach())
        ratio = torch.exp(log_ratio.clamp(max=_LARGEST_LOG))
        plain = -advantage * ratio
        clipped = torch.maximum(plain, -advantage * ratio.clamp(1 - self.clip_low, 1 + self.clip_high))
        bounded = clipped
        if self.dual_clip is not None:
            bounded = torch.minimum(clipped, self.dual_clip * advantage.abs())
        log_weight = self._shared(tokens.proximal - tokens.behaviour, tokens, tokens.lag)
        largest = math.log(self.largest_weight) if self.largest_weight is not None else _LARGEST_LOG
        usable = log_weight <= (largest if self.largest_weight is not None else math.inf)
        weight = torch.exp(log_weight.clamp(max=largest))
        with torch.no_grad():
            is_clipped = clipped > plain
            sums = {
                "clipped_low": (is_clipped & (advantage < 0)).float().sum(),
                "clipped_high": (is_clipped & (advantage > 0)).float().sum(),
                "clipped_dual": (bounded < clipped).float().sum(),
                "dropped": (~usable).float().sum(),
                "importance_weight": weight.sum(),
                "ratio": ratio.sum(),
                "kl_behaviour": divergence((tokens.new - tokens.behaviour)[usable]).sum(),
            }
        return Loss(torch.where(usable, bounded * weight, 0.0), sums, {"ratio_max": ratio.detach().max()})

    def _shared(self, each: torch.Tensor, tokens: Tokens, of_trajectory: torch.Tensor | None) -> torch.Tensor:
        """The value of each token, or the mean over its step or its trajectory."""
        if self.ratio == "step":
            assert tokens.step is not None
            _, place, count = tokens.step.unique(return_inverse=True, return_counts=True)
            return (torch.zeros_like(each[: len(count)]).index_add(0, place, each) / count)[place]
        if self.ratio == "sequence":
            assert of_trajectory is not None
            return of_trajectory
        return each


def divergence(log_ratio: torch.Tensor) -> torch.Tensor:
    """An estimate of the KL divergence q from p for each token that p sampled, from log(q / p): never
    negative, and without bias (Schulman's k3)."""
    bounded = log_ratio.clamp(-_LARGEST_LOG, _LARGEST_LOG)
    return torch.expm1(bounded) - bounded


class FilteredBC(PolicyGradient):
    """The paper's objective (§5): the likelihood of the actions in successful trajectories.

    REINFORCE with a 0/1 reward and no baseline: failures have weight 0. The
    log-likelihood of a reply is the sum over its tokens, so every token has the same weight.
    """

    baseline: Baseline = "none"
    std: bool = False
    step_divisor: float = Field(default=1.0, gt=0)
    ratio: Ratio = "none"
    staleness: int | None = Field(default=None, ge=0)


class GroupIS(PolicyGradient):
    """Groups with a baseline, trained on off-policy (AsyncWebRL, arXiv 2606.05597): the defaults."""


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
