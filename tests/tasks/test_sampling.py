"""Samplers: shares, passes, seeds, states, shards, blocked websites, weights."""

from __future__ import annotations

import json
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from tests.tasks.making import task

from webgym.core.errors import ConfigError, NothingToDraw
from webgym.core.task import LEVELS, Level, Task
from webgym.tasks.sampling import Sampler, SamplerConfig, near_success, parse_ratio, spread_websites

FACTS = {"easy": 1, "medium": 4, "hard": 7}


def tasks_of(easy: int = 0, medium: int = 0, hard: int = 0) -> list[Task]:
    counts = {"easy": easy, "medium": medium, "hard": hard}
    return [
        task(f"{level}/{number}", f"https://site{number % 7}.example/", FACTS[level])
        for level in LEVELS
        for number in range(counts[level])
    ]


def ids(tasks: list[Task]) -> list[str]:
    return [each.id for each in tasks]


@given(st.integers(1, 40), st.lists(st.integers(0, 25), max_size=8), st.integers(0, 3))
def test_nothing_comes_twice_until_everything_has_come(size: int, draws: list[int], seed: int) -> None:
    tasks = tasks_of(easy=size)
    sampler = Sampler(tasks, SamplerConfig(seed=seed))
    drawn = [name for count in draws for name in ids(sampler.draw(count))]
    assert len(drawn) == sum(draws)
    counts = Counter({each.id: 0 for each in tasks})
    counts.update(drawn)
    assert max(counts.values()) - min(counts.values()) <= 1


def test_every_pass_is_shuffled_anew_and_the_seed_decides() -> None:
    tasks = tasks_of(easy=50)
    one, same, other = (Sampler(tasks, SamplerConfig(seed=seed)) for seed in (1, 1, 2))
    first, second = ids(one.draw(50)), ids(one.draw(50))
    assert sorted(first) == sorted(second) == sorted(ids(tasks))
    assert first != second
    assert (ids(same.draw(50)), ids(same.draw(50))) == (first, second)
    assert ids(other.draw(50)) != first


RATIOS = st.fixed_dictionaries({level: st.integers(0, 5) for level in LEVELS}).filter(
    lambda each: any(each.values())
)


@given(RATIOS, st.lists(st.integers(0, 40), max_size=8))
def test_the_shares_are_kept_to_one_task(ratio: dict[Level, float], draws: list[int]) -> None:
    sampler = Sampler(tasks_of(9, 5, 3), SamplerConfig(ratio=ratio))
    drawn = [each.level for count in draws for each in sampler.draw(count)]
    counts, total = Counter(drawn), sum(ratio.values())
    assert len(drawn) == sum(draws)
    for level, share in ratio.items():
        assert abs(counts[level] - len(drawn) * share / total) < 2
        if not share:
            assert not counts[level]


def test_two_to_one_to_one() -> None:
    sampler = Sampler(tasks_of(3_000, 400, 300), SamplerConfig(ratio=parse_ratio("2:1:1")))
    for _ in range(3):
        batch = sampler.draw(1_024)
        assert Counter(each.level for each in batch) == {"easy": 512, "medium": 256, "hard": 256}
        # Levels are mixed, not one after the other.
        assert sum(one.level != other.level for one, other in pairwise(batch)) > 400


def test_an_empty_stratum_is_an_error_that_says_so() -> None:
    with pytest.raises(NothingToDraw, match=r"no hard task to draw.*there are 5 easy, 2 medium, 0 hard"):
        Sampler(tasks_of(5, 2), SamplerConfig(ratio=parse_ratio("2:1:1")))
    assert Sampler(tasks_of(5, 2), SamplerConfig(ratio=parse_ratio("2:1:0"))).draw(3)
    with pytest.raises(NothingToDraw, match="there is no task to draw among 0"):
        Sampler([])


@pytest.mark.parametrize("text", ["", "2:1", "2:1:1:1", "a:b:c"])
def test_what_is_no_ratio(text: str) -> None:
    with pytest.raises(ConfigError, match="is not a ratio"):
        parse_ratio(text)


@pytest.mark.parametrize("text", ["0:0:0", "-1:1:1", "nan:1:1", "inf:1:1"])
def test_a_ratio_that_makes_no_sense(text: str) -> None:
    with pytest.raises(ValidationError, match="a ratio needs a share"):
        SamplerConfig(ratio=parse_ratio(text))


def test_domains_and_subdomains_are_chosen_and_left_out() -> None:
    tasks = [
        task(f"{subdomain}/{number}", "a.example", subdomain=subdomain)
        for subdomain in ("News", "Music", "Shopping", "Food & Cooking")
        for number in range(5)
    ] + [task("strange", "a.example", domain="Electronics", subdomain="Phones")]

    def found(**settings: tuple[str, ...]) -> set[str]:
        sampler = Sampler(tasks, SamplerConfig(**settings))  # type: ignore[arg-type]
        return {each.subdomain for each in sampler.draw(40)}

    assert found(domains=("Lifestyle & Leisure",)) == {"Shopping", "Food & Cooking"}
    assert found(domains=("Lifestyle & Leisure",), without=("Shopping",)) == {"Food & Cooking"}
    assert found(without=("Misc.", "Music", "Electronics")) == {"Shopping", "Food & Cooking"}
    with pytest.raises(ConfigError, match="unknown domain 'Cooking'"):
        found(without=("Cooking",))
    with pytest.raises(NothingToDraw, match="there is no task to draw among 21"):
        found(domains=("Real Estate",))


@given(
    st.integers(1, 30),
    st.lists(st.integers(0, 20), max_size=5),
    st.lists(st.integers(0, 20), max_size=5),
    st.booleans(),
    st.booleans(),
)
def test_a_restored_sampler_goes_on_the_same(
    size: int, before: list[int], after: list[int], levels: bool, anew: bool
) -> None:
    tasks = tasks_of(size, size, size)
    config = SamplerConfig(seed=3, ratio=parse_ratio("3:1:1") if levels else None)
    weigh = near_success({"easy/0": (0, 9)})
    sampler = Sampler(tasks, config, weigh=weigh, anew=anew)
    sampler.block("site0.example", "https://www.site3.example/x")
    if size == 1:
        sampler.unblock("site0.example")
    for count in before:
        sampler.draw(count)
    state = json.loads(json.dumps(sampler.state()))
    restored = Sampler(tasks, config, weigh=weigh, anew=anew)
    restored.restore(state)
    assert restored.blocked == sampler.blocked
    assert [ids(sampler.draw(count)) for count in after] == [ids(restored.draw(count)) for count in after]
    assert len(json.dumps(state)) < 400


def test_a_state_of_something_else_is_refused() -> None:
    state = Sampler(tasks_of(5)).state()
    for other in (Sampler(tasks_of(6)), Sampler(tasks_of(5), SamplerConfig(seed=1))):
        with pytest.raises(ConfigError, match="belongs to other tasks or settings"):
            other.restore(state)
    with pytest.raises(ConfigError):
        Sampler(tasks_of(5)).restore({})


@given(st.integers(1, 25), st.integers(1, 6), st.booleans())
def test_shards_are_disjoint_and_complete(size: int, shards: int, levels: bool) -> None:
    tasks = tasks_of(size + shards, size + shards, size + shards)
    ratio = parse_ratio("1:1:1") if levels else None
    parts = []
    for shard in range(shards):
        sampler = Sampler(tasks, SamplerConfig(shard=shard, shards=shards, ratio=ratio))
        own = set(ids(sampler.draw(9 * len(tasks))))
        parts.append(own)
    assert sorted(name for part in parts for name in part) == sorted(ids(tasks))
    assert max(map(len, parts)) - min(map(len, parts)) <= 3


def test_a_shard_without_tasks_is_an_error() -> None:
    with pytest.raises(NothingToDraw, match="shard 3 of 4 has no task"):
        Sampler(tasks_of(3), SamplerConfig(shard=3, shards=4))
    with pytest.raises(ValidationError, match="no shard 4 of 4"):
        SamplerConfig(shard=4, shards=4)


def test_blocked_websites_are_passed_over_until_they_are_not() -> None:
    tasks = tasks_of(easy=70)
    sampler = Sampler(tasks)
    sampler.draw(20)
    sampler.block("HTTPS://WWW.site1.example:443/", "site2.example", "m.site3.example")
    assert sampler.blocked == {"site1.example", "site2.example", "m.site3.example"}
    drawn = sampler.draw(100)
    assert not {each.website for each in drawn} & {"https://site1.example/", "https://site2.example/"}
    assert "https://site3.example/" in {each.website for each in drawn}
    sampler.unblock("site1.example")
    sampler.draw(70)
    assert "https://site1.example/" in {each.website for each in sampler.draw(70)}
    sampler.block(*(f"site{number}.example" for number in range(7)))
    with pytest.raises(NothingToDraw, match="all 70 in 'all' are on blocked"):
        sampler.draw(1)


def test_a_pass_that_ends_among_blocked_websites_is_no_error() -> None:
    tasks = tasks_of(easy=14)
    sampler = Sampler(tasks)
    drawn = sampler.draw(13)
    (last,) = {each.id: each for each in tasks if each.id not in ids(drawn)}.values()
    sampler.block(last.website)
    assert len(sampler.draw(5)) == 5


def test_the_curriculum_prefers_what_succeeds_about_half_the_time() -> None:
    tasks = tasks_of(easy=300)
    results = {
        each.id: ((0, 20) if place < 100 else (10, 20) if place < 200 else (20, 20))
        for place, each in enumerate(tasks)
    }
    sampler = Sampler(tasks, weigh=near_success(results), anew=True)
    drawn = Counter(results[each.id][0] for _ in range(10) for each in sampler.draw(50))
    assert drawn[10] > 380
    # Results that come in later count at once; what was never tried is worth trying.
    for each in tasks[100:200]:
        results[each.id] = (20, 20)
    for each in tasks[:100]:
        del results[each.id]
    batch = sampler.draw(60)
    assert sum(each.id not in results for each in batch) > 40
    assert len(set(ids(batch))) == 60


def test_the_target_is_a_choice() -> None:
    tasks = tasks_of(easy=200)
    results = {each.id: ((2, 10) if place % 2 else (8, 10)) for place, each in enumerate(tasks)}
    sampler = Sampler(tasks, weigh=near_success(results, target=0.2, width=0.1), anew=True)
    assert sum(results[each.id] == (2, 10) for each in sampler.draw(80)) > 70


def test_websites_are_spread() -> None:
    tasks = [task(f"c/{n}", "https://crowd.example/") for n in range(900)]
    tasks += [task(f"o/{n}", f"o{n}.example") for n in range(100)]
    plain, spread = Sampler(tasks), Sampler(tasks, weigh=spread_websites())
    assert len({each.website for each in plain.draw(90)}) < 25
    assert len({each.website for each in spread.draw(90)}) > 70
    # Nothing is lost by it: a pass is still all tasks.
    assert sorted(
        ids(spread.draw(910))[:0] + ids(Sampler(tasks, weigh=spread_websites()).draw(1_000))
    ) == sorted(ids(tasks))


def test_a_weight_of_nought_is_never() -> None:
    tasks = tasks_of(easy=10)
    sampler = Sampler(
        tasks, weigh=lambda deck: np.array([each.id != "easy/3" for each in deck.tasks], dtype=float)
    )
    assert "easy/3" not in ids(sampler.draw(100))
    with pytest.raises(NothingToDraw, match="have no weight"):
        Sampler(tasks, weigh=lambda deck: np.zeros(len(deck.tasks))).draw(1)
