"""Each objective on a problem whose optimum is known: a bandit with contexts and a table of logits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import pytest
import torch

from webgym.core.errors import ConfigError
from webgym.train.config import ObjectiveConfig
from webgym.train.objectives import Attempt, FilteredBC, GroupIS, Loss, Objective, Tokens, make_objective

torch.set_num_threads(1)

REWARD = torch.tensor([[0.9, 0.1, 0.3, 0.0], [0.0, 0.2, 0.2, 0.8], [0.05, 0.6, 0.05, 0.05]])
"""How likely each of four actions succeeds in each of three contexts."""
CONTEXTS, ACTIONS = REWARD.shape


def success(logits: torch.Tensor) -> float:
    """The exact success rate of a policy over contexts."""
    return float((logits.softmax(-1) * REWARD).sum(-1).mean())


class Bandit:
    """Attempts: a context is a task, an action is a reply of one token."""

    def __init__(self, logits: torch.Tensor, groups: int, size: int, seed: int) -> None:
        random = torch.Generator().manual_seed(seed)
        self.contexts = torch.arange(groups).repeat_interleave(size) % CONTEXTS
        self.groups = torch.arange(groups).repeat_interleave(size)
        log_probabilities = logits.log_softmax(-1)[self.contexts]
        self.actions = torch.multinomial(log_probabilities.exp(), 1, generator=random)[:, 0]
        self.logprobs = log_probabilities.gather(1, self.actions[:, None])[:, 0]
        chance = REWARD[self.contexts, self.actions]
        self.rewards = (torch.rand(len(chance), generator=random) < chance).float()

    def learn(self, objective: Objective, logits: torch.Tensor, steps: int, rate: float) -> torch.Tensor:
        """New logits after some optimizer steps, as the update makes them."""
        attempts = [
            Attempt(str(place), str(int(group)), float(reward))
            for place, (group, reward) in enumerate(zip(self.groups, self.rewards, strict=True))
        ]
        found = objective.advantages(attempts)
        kept = torch.tensor([place for place in range(len(attempts)) if str(place) in found])
        advantage = torch.tensor([found[str(int(place))] for place in kept])

        def logprobs(table: torch.Tensor) -> torch.Tensor:
            return table.log_softmax(-1)[self.contexts[kept], self.actions[kept]]

        table = logits.clone().requires_grad_()
        optimizer = torch.optim.Adam([table], lr=rate)
        proximal = logprobs(logits)
        for _ in range(steps):
            loss = objective.loss(Tokens(logprobs(table), advantage, self.logprobs[kept], proximal))
            (loss.tokens.sum() / len(kept)).backward()
            optimizer.step()
            optimizer.zero_grad()
        return table.detach()


def test_filtered_bc_gives_the_policy_weighted_by_its_rewards() -> None:
    """Maximum likelihood over successes has a closed form: old policy times chance of success, normalised."""
    old = torch.tensor([[0.0, 1.0, 0.5, -0.5]]).repeat(CONTEXTS, 1)
    data = Bandit(old, groups=30_000, size=1, seed=0)

    new = data.learn(FilteredBC(), old, steps=80, rate=0.2).softmax(-1)

    weighted = old.softmax(-1) * REWARD
    optimum = weighted / weighted.sum(-1, keepdim=True)
    torch.testing.assert_close(new, optimum, atol=0.03, rtol=0)


def test_filtered_bc_repeated_on_its_own_attempts_finds_the_best_actions() -> None:
    logits, rates = torch.zeros_like(REWARD), []
    for seed in range(7):
        logits = Bandit(logits, groups=3000, size=1, seed=seed).learn(FilteredBC(), logits, 80, 0.2)
        rates.append(success(logits))
    assert rates == sorted(rates)
    assert rates[-1] > 0.97 * float(REWARD.max(-1).values.mean())


def test_groups_with_importance_weights_improve_in_every_iteration() -> None:
    logits, rates = torch.zeros_like(REWARD), [success(torch.zeros_like(REWARD))]
    for seed in range(10):
        logits = Bandit(logits, groups=300, size=8, seed=seed).learn(GroupIS(), logits, 8, 0.1)
        rates.append(success(logits))
    assert rates == sorted(rates)
    assert rates[-1] > 0.9 * float(REWARD.max(-1).values.mean())


def gradient(
    behaviour: torch.Tensor, policy: torch.Tensor, advantage: torch.Tensor, *, believed: torch.Tensor
) -> torch.Tensor:
    """Of the loss at the policy, from 10,000 attempts whose shares are exactly those of the behaviour."""
    counts = (behaviour * 10_000).round().long()
    actions = torch.arange(len(counts)).repeat_interleave(counts)
    logits = policy.log().requires_grad_()
    new = logits.log_softmax(-1)[actions]
    tokens = Tokens(new, advantage[actions], believed.log()[actions], policy.log()[actions])
    (GroupIS().loss(tokens).tokens.sum() / len(actions)).backward()
    assert logits.grad is not None
    return logits.grad


def test_importance_weights_remove_the_bias_of_a_stale_behaviour() -> None:
    policy, behaviour = torch.tensor([0.2, 0.3, 0.5]), torch.tensor([0.5, 0.3, 0.2])
    advantage = torch.tensor([1.0, -0.5, 0.2])
    exact = gradient(policy, policy, advantage, believed=policy)

    torch.testing.assert_close(gradient(behaviour, policy, advantage, believed=behaviour), exact)
    biased = gradient(behaviour, policy, advantage, believed=policy)
    assert (biased - exact).abs().max() > 0.1


def one_token(advantage: float, *, ratio: float = 1.0, weight: float = 1.0) -> tuple[float, float]:
    """Loss of a token, and its gradient."""
    new = torch.tensor([-1.0], requires_grad=True)
    proximal = new.detach() - torch.tensor(ratio).log()
    behaviour = proximal - torch.tensor(weight).log()
    loss = GroupIS().loss(Tokens(new, torch.tensor([advantage]), behaviour, proximal)).tokens.sum()
    loss.backward()
    assert new.grad is not None
    return float(loss.detach()), float(new.grad)


@pytest.mark.parametrize(
    ("advantage", "ratio", "weight", "loss", "slope"),
    [
        (0.5, 1.0, 1.0, -0.5, -0.5),  # on policy: the policy gradient
        (0.5, 1.1, 2.0, -1.1, -1.1),  # inside the clip, weighted
        (0.5, 1.5, 1.0, -0.6, 0.0),  # likelier than 1.2 times is not rewarded further
        (0.5, 0.5, 1.0, -0.25, -0.25),  # a good action that became unlikely still pulls
        (-0.5, 0.5, 1.0, 0.4, 0.0),
        (-0.5, 2.0, 1.0, 1.0, 1.0),
        (-0.5, 4.0, 1.0, 1.5, 0.0),  # dual clip: at most three times the advantage
        (0.5, 1.0, 4.9, -2.45, -2.45),
        (0.5, 1.0, 5.1, 0.0, 0.0),  # sampled by a policy too different: dropped
    ],
)
def test_a_token_is_clipped_and_weighted(
    advantage: float, ratio: float, weight: float, loss: float, slope: float
) -> None:
    assert one_token(advantage, ratio=ratio, weight=weight) == pytest.approx((loss, slope), abs=1e-5)


@pytest.mark.parametrize("behaviour", [-100.0, -9999.0, -math.inf])
def test_a_token_that_its_sampler_thought_impossible_is_dropped(behaviour: float) -> None:
    new = torch.tensor([-1.0, -2.0], requires_grad=True)
    tokens = Tokens(
        new, torch.tensor([0.1, 0.1]), torch.tensor([behaviour, -2.0]), torch.tensor([-1.0, -2.0])
    )
    GroupIS().loss(tokens).tokens.sum().backward()
    assert new.grad is not None
    assert new.grad.tolist() == pytest.approx([0.0, -0.1])


def test_a_token_that_became_infinitely_likelier_has_a_finite_gradient() -> None:
    new = torch.tensor([0.0, 0.0], requires_grad=True)
    old = torch.tensor([-200.0, -200.0])
    GroupIS().loss(Tokens(new, torch.tensor([-0.1, 0.1]), old, old)).tokens.sum().backward()
    assert new.grad is not None
    assert new.grad.tolist() == [0.0, 0.0]


def test_the_advantage_does_not_depend_on_how_long_a_trajectory_was() -> None:
    group = [Attempt("a", "t", 1.0), Attempt("b", "t", 0.0), Attempt("c", "t", 0.0), Attempt("d", "t", 0.0)]
    assert GroupIS().advantages(group) == pytest.approx({"a": 0.15, "b": -0.05, "c": -0.05, "d": -0.05})
    plain = GroupIS(std=False)
    assert plain.advantages(group) == pytest.approx({"a": 0.075, "b": -0.025, "c": -0.025, "d": -0.025})
    assert GroupIS().advantages([*group[:1], Attempt("e", "u", 0.0), Attempt("f", "u", 0.0)]) == {}


# --- the extension point -----------------------------------------------------------------------------------


class Halved:
    """Somebody's own."""

    off_policy = False
    max_age = None

    def __init__(self, factor: float = 0.5) -> None:
        self.factor = factor

    def advantages(self, attempts: Iterable[Attempt]) -> Mapping[str, float]:
        return {attempt.id: self.factor for attempt in attempts}

    def loss(self, tokens: Tokens) -> Loss:
        return Loss(-tokens.advantage * tokens.new)


def named(name: str, **options: Any) -> Objective:
    return make_objective(ObjectiveConfig(name=name, options=options))


def test_objectives_are_found_by_name_and_by_import_path() -> None:
    assert named("filtered_bc") == FilteredBC()
    assert named("group_is", clip_low=0.3) == GroupIS(clip_low=0.3)
    own = named(f"{__name__}:Halved", factor=0.25)
    assert own.advantages([Attempt("a", "t", 0.0)]) == {"a": 0.25}


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("filtered_cb", {}, "unknown objective 'filtered_cb'"),
        ("group_is", {"clipp": 0.3}, "does not take its options: clipp"),
        ("group_is", {"clip_low": -1}, "does not take its options: clip_low"),
        ("filtered_bc", {"std": True}, "std needs a baseline"),
        ("filtered_bc", {"clip": 0.3}, "does not take its options"),
        ("nowhere:Objective", {}, "cannot import the objective nowhere:Objective"),
        ("collections:Nothing", {}, "cannot import"),
        ("collections:Counter", {}, "is not an objective"),
    ],
)
def test_what_names_no_objective_is_one_line(name: str, options: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as error:
        named(name, **options)
    assert "\n" not in str(error.value)
