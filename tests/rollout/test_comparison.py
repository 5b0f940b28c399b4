"""Two runs over the same tasks: what is compared, what is left out, when a difference is no chance."""

from __future__ import annotations

import json
import math
from itertools import product
from operator import mul
from pathlib import Path

import numpy as np
import pytest
from tests.conftest import Calls
from tests.rollout.test_summary import attempt, task

from webgym.core.errors import UsageError
from webgym.core.outcome import Outcome
from webgym.results.evaluation import _permutation_test, _tail, _tail_by_transform, compare
from webgym.store.runs import RunWriter

LETTERS = {"s": Outcome.SUCCESS, "f": Outcome.FAILURE, "b": Outcome.BLOCKED, "j": Outcome.JUDGE_ERROR}


async def run(path: Path, easy: str, hard: str = "") -> Path:
    """A letter per task: how its attempt ended."""
    tasks = [task(f"e{nth}", 1) for nth in range(len(easy))] + [
        task(f"h{nth}", 8) for nth in range(len(hard))
    ]
    async with await RunWriter.create(path, {}, tasks) as writer:
        for each, letter in zip(tasks, easy + hard, strict=True):
            await writer.append(attempt(each.id, LETTERS[letter], steps=0))
    return path


async def test_only_tasks_with_a_reward_in_both_are_compared(tmp_path: Path) -> None:
    one = await run(tmp_path / "one", "ssffb", "ffj")
    other = await run(tmp_path / "other", "sfssj", "bsf")
    found = compare(one, other)
    easy, hard, whole = (found.rows[group] for group in ("easy", "hard", "overall"))
    assert (easy.tasks, easy.first, easy.second, easy.better, easy.worse) == (4, 0.5, 0.75, 2, 1)
    assert (hard.tasks, hard.first, hard.second) == (1, 0.0, 1.0)
    assert whole.tasks == 5
    assert whole.difference == pytest.approx(0.4)
    assert found.rows["medium"].difference is None
    assert (found.only_first, found.only_second) == (1, 1), "a task of no reward is no failure"
    with pytest.raises(UsageError, match="no task has a reward in both"):
        compare(await run(tmp_path / "none", "b"), one)


async def test_pairing_decides_what_two_rates_alone_do_not(tmp_path: Path) -> None:
    one = await run(tmp_path / "one", "s" * 40 + "f" * 40)
    other = await run(tmp_path / "other", "s" * 50 + "f" * 30)
    row = compare(one, other).rows["overall"]
    assert row.interval is not None
    assert 0 < row.interval[0] < 0.125 < row.interval[1] < 0.25, "50 % and 62.5 %, each of 80, overlap by far"
    assert row.is_decided
    same = compare(one, one).rows["overall"]
    assert (same.difference, same.interval, same.is_decided) == (0.0, None, False)
    few = await run(tmp_path / "few", "f" + "s" * 41 + "f" * 38)
    assert not compare(one, few).rows["overall"].is_decided


@pytest.mark.parametrize(
    ("before", "after", "p", "conclusion"),
    [
        ("f" * 60, "s" * 60, 2**-59, "after is better"),
        ("s" * 60, "f" * 60, 2**-59, "before is better"),
        ("ffff", "sssf", 0.25, "the difference may be chance"),
        ("fff", "sss", 0.25, "the difference may be chance"),
        ("f" * 5, "s" * 5, 2**-4, "the difference may be chance"),
        ("f" * 6, "s" * 6, 2**-5, "after is better"),
        ("fffsss", "fffsss", None, "the difference may be chance"),
    ],
)
async def test_without_an_exact_test_that_agrees_no_run_is_better(
    tmp_path: Path, calls: Calls, before: str, after: str, p: float | None, conclusion: str
) -> None:
    one, other = await run(tmp_path / "before", before), await run(tmp_path / "after", after)
    row = compare(one, other).rows["overall"]
    assert row.p_value == p
    assert (row.interval is None) == (len(before) != 4), (
        "all tasks differ alike, and resampling shows no spread"
    )
    assert row.is_decided == ("better" in conclusion)
    assert f"overall: {conclusion}" in calls.printed("compare", one, other)


async def test_differences_that_are_equal_but_for_rounding_show_no_spread(tmp_path: Path) -> None:
    for name, letters in (("one", ("sff", "ssf")), ("other", ("ssf", "sss"))):
        tasks = [task("low", 1), task("high", 1)]
        async with await RunWriter.create(tmp_path / name, {}, tasks) as writer:
            for each, outcomes in zip(tasks, letters, strict=True):
                for letter in outcomes:
                    await writer.append(attempt(each.id, LETTERS[letter], steps=0))
    row = compare(tmp_path / "one", tmp_path / "other").rows["overall"]
    assert row.difference == pytest.approx(1 / 3)
    assert row.better == 2
    assert (row.interval, row.p_value, row.is_decided) == (None, 0.5, False)


def test_the_permutation_test_tells_what_counting_all_signs_tells() -> None:
    for gains in (
        [0.5, 0.25, 1.0, -0.25],
        [1 / 3, 2 / 3, -1.0, 0.2, 0.0],
        [0.125] * 7 + [-1.0],
        [1.0, -1.0, 1.0],
    ):
        sums = [sum(map(mul, signs, gains)) for signs in product((1, -1), repeat=len(gains))]
        p = sum(abs(each) > abs(sum(gains)) - 1e-9 for each in sums) / len(sums)
        assert _permutation_test(gains) == pytest.approx(p)


@pytest.mark.parametrize("largest", [1, 2, 7, 840])
def test_the_transform_tells_what_counting_tells(largest: int) -> None:
    generator = np.random.default_rng(largest)
    for count in (1, 2, 5, 30, 200):
        sizes = generator.integers(1, largest + 1, count)
        total = int(sizes.sum())
        for observed in {abs(int((sizes * generator.choice([-1, 1], count)).sum())), total, total % 2}:
            assert _tail_by_transform(sizes, observed) == pytest.approx(_tail(sizes, observed), abs=1e-12)


@pytest.mark.timeout(20)  # counting takes half a minute
def test_sixteen_thousand_tasks_of_one_to_eight_attempts() -> None:
    generator = np.random.default_rng(1)
    one, other = (
        generator.binomial(attempts, rate) / attempts
        for rate, attempts in (
            (0.4, generator.integers(1, 9, 16_000)),
            (0.41, generator.integers(1, 9, 16_000)),
        )
    )
    gains = other - one
    normal = math.erfc(abs(gains.sum()) / math.sqrt((gains**2).sum() * 2))
    assert _permutation_test(list(gains)) == pytest.approx(normal, rel=0.01)


async def test_levels_that_differ_in_opposite_directions_decide_nothing(tmp_path: Path) -> None:
    one = await run(tmp_path / "one", "fff", "sss")
    other = await run(tmp_path / "other", "sss", "fff")
    row = compare(one, other).rows["overall"]
    assert (row.better, row.worse, row.interval, row.p_value) == (3, 3, None, 1.0)
    assert not row.is_decided


async def test_the_command(tmp_path: Path, calls: Calls) -> None:
    one = await run(tmp_path / "one", "s" * 40 + "f" * 40)
    other = await run(tmp_path / "other", "s" * 60 + "f" * 20)
    assert "other is better" in calls.printed("compare", one, other)
    said = calls.printed("compare", one, other, "--json")
    assert json.loads(said)["rows"]["easy"]["better"] == 20
    oracles = json.loads(said)["notes"]
    assert [note.partition(" is an oracle")[0] for note in oracles] == [
        f"{name}: the scripted policy" for name in ("one", "other")
    ]
    tutorial = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text()
    before = await run(tmp_path / "before", "s" * 12 + "f" * 48)
    after = await run(tmp_path / "after", "f" * 3 + "s" * 20 + "f" * 37)
    said = calls.printed("compare", before, after)
    [verdict] = [line for line in said.splitlines() if line.startswith("overall:")]
    assert verdict in tutorial, "11 tasks better, 3 worse, as in the tutorial"
    said = calls.printed("compare", one, other, "--markdown")
    assert "| overall | 80 | 50.0 | 75.0 | +25.0 |" in said
    assert "other: the scripted policy is an oracle" in said
    assert "is not a run" in calls.printed("compare", one, tmp_path, code=2)
