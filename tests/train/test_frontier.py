"""The frontier sampler, on simulated success rates."""

from __future__ import annotations

import json
import random
from collections import Counter

import msgspec
import pytest
from tests.train.making import task

from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks.sampling import Sampler, SamplerConfig
from webgym.train.config import FrontierConfig
from webgym.train.frontier import Frontier

CHANCE = {"never": 0.0, "sometimes": 0.5, "always": 1.0}


def tasks() -> list[Task]:
    """90 websites with two tasks each, a third of each kind."""
    return [
        msgspec.structs.replace(task(f"{kind}-{number}"), id=f"t/{kind}/{number}/{each}")
        for kind in CHANCE
        for number in range(30)
        for each in range(2)
    ]


def simulated(
    frontier: Frontier, iterations: int, seed: int = 0, chance: dict[str, float] = CHANCE
) -> list[Counter[str]]:
    """How often each kind was drawn in each iteration."""
    rng = random.Random(seed)
    sampler = Sampler(tasks(), SamplerConfig(seed=seed), weigh=frontier.weigh, anew=True)
    found = []
    for _ in range(iterations):
        drawn = sampler.draw(60)
        found.append(Counter(each.id.split("/")[1] for each in drawn))
        frontier.take([(each, float(rng.random() < chance[each.id.split("/")[1]])) for each in drawn])
    return found


@pytest.mark.parametrize("by", ["task", "website", "website_level"])
def test_tasks_that_succeed_sometimes_come_first_and_none_is_forgotten(by: str) -> None:
    found = simulated(Frontier(FrontierConfig.model_validate({"by": by, "decay": 1.0})), 25)
    assert all(12 <= number <= 28 for number in found[0].values())  # nothing is known yet
    late = sum(found[-8:], Counter[str]())
    assert late["sometimes"] > 1.6 * max(late["always"], late["never"])
    assert min(late["always"], late["never"]) > 0


def test_a_lower_floor_explores_less() -> None:
    shares = []
    for floor in (0.02, 0.9):
        frontier = Frontier(FrontierConfig(by="website", floor=floor, decay=1.0))
        shares.append(sum(simulated(frontier, 25)[-8:], Counter[str]())["sometimes"])
    assert shares[0] > 1.3 * shares[1]


def test_what_is_mastered_later_loses_its_weight_and_old_results_fade() -> None:
    one = task()
    frontier = Frontier(FrontierConfig(by="task", decay=0.5))
    frontier.take([(one, 1.0), (one, 0.0)] * 4)
    assert frontier.weight(one) == pytest.approx(1.0)
    for _ in range(4):
        frontier.take([(one, 1.0)] * 8)
    assert frontier.rate(one) > 0.9
    assert frontier.weight(one) < 0.4


def test_what_was_never_attempted_is_taken_for_what_its_level_is_like() -> None:
    hard = Rubric((FactGroup(1, "all", tuple("abcdefg")),))
    seen, unseen = (msgspec.structs.replace(task(name), rubric=hard) for name in "ab")
    easy = task("c")
    frontier = Frontier(FrontierConfig())
    assert frontier.rate(unseen) == 0.5
    frontier.take([(seen, 0.0)] * 20)
    assert frontier.rate(unseen) < 0.1
    assert frontier.rate(seen) < frontier.rate(unseen)
    assert frontier.rate(easy) == 0.5


def test_the_rate_is_the_posterior_mean() -> None:
    frontier = Frontier(FrontierConfig(by="level", prior=(2.0, 6.0)))
    assert frontier.rate(task()) == pytest.approx(0.25)
    frontier.take([(task(), 1.0)] * 4)
    assert frontier.rate(task()) == pytest.approx(6 / 12)
    assert frontier.weight(task()) == pytest.approx(1.0)


def test_the_same_seed_draws_the_same_also_from_a_saved_state() -> None:
    config = FrontierConfig()
    assert simulated(Frontier(config), 4, seed=3) == simulated(Frontier(config), 4, seed=3)
    one, other = Frontier(config), Frontier(config)
    simulated(one, 3)
    other.restore(json.loads(json.dumps(one.state())))
    assert [one.weight(each) for each in tasks()] == [other.weight(each) for each in tasks()]
