"""Faults around a run change no reward: a short campaign, and what the command does with its result."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from benchmarks.faults import __main__ as faults
from benchmarks.faults.campaign import KINDS, Campaign, Ran, differing, rows, run
from benchmarks.reward.measure import choose
from tests.bench.conftest import Benchmark
from tests.documented import documented

from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb


@pytest.mark.browser
@pytest.mark.timeout(240)
async def test_faults_change_no_reward(tmp_path: Path) -> None:
    tasks, _ = choose(OfflineWeb(SitesConfig().seed, per_family=1), 300, 0, 3)
    easy = sorted(tasks, key=lambda task: len(task.truth.moves) if task.truth else 0)[:3]
    kinds = ("renderer", "web", "judge")
    quiet = Campaign(seed=3, kinds=(), per_family=1)
    # After a while there are no more faults, so that a slow machine comes to an end, too.
    faulty = Campaign(seed=3, kinds=kinds, per_minute=90, seconds=12, per_family=1)
    twin, ran = await asyncio.gather(
        run(quiet, easy, tmp_path / "without"), run(faulty, easy, tmp_path / "under")
    )
    assert len(twin.rewards) == len(easy)
    assert ran.rewards
    assert sum(ran.faults.values())
    assert not differing(ran, twin)


WITHOUT = Ran({("a", 0): 1.0, ("b", 0): 0.0, ("c", 0): 1.0}, {"success": 2, "failure": 1}, {})
UNDER = Ran({("a", 0): 0.0, ("b", 0): 0.0}, {"failure": 2, "environment_error": 3}, {"web": 2})


def test_a_reward_that_differs_is_named_and_a_missing_one_is_not() -> None:
    assert differing(UNDER, WITHOUT) == ["a#0: 0 under faults, 1 without"]
    table = {name: values for name, *values in rows(UNDER, WITHOUT)}
    assert table["environment_error"] == ["3", "0"]
    assert table["samples with a reward"] == ["2", "3"]
    assert table["mean reward"] == ["0.000", "0.667"]
    assert table["fault: web"] == ["2", "0"]


@pytest.mark.parametrize(("under", "code"), [(UNDER, 1), (WITHOUT, 0)])
def test_the_command_fails_if_a_reward_differs(
    benchmark: Benchmark, monkeypatch: pytest.MonkeyPatch, under: Ran, code: int
) -> None:
    async def stand_in(campaign: Campaign, *_: object) -> Ran:
        return under if campaign.kinds else WITHOUT

    monkeypatch.setattr(faults, "run", stand_in)
    ended, output = benchmark(faults.command, "--tasks", 2, "--per-family", 1, "--only", "web")
    assert ended == code
    assert ("another reward: a#0" in output) == bool(code)
    ended, output = benchmark(faults.command, "--only", "weather")
    assert ended == 2
    assert KINDS[0] in output


def test_the_command_takes_its_words(benchmark: Benchmark) -> None:
    code, output = benchmark(faults.command, *documented("python -m benchmarks.faults"), "--help")
    assert (code, "--minutes" in output) == (0, True)
