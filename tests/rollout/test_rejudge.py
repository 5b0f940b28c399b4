"""A stored run judged again: idempotent, resumable, beside what was recorded."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from webgym.core.errors import JudgeError, RunFolderError, StoreLocked
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Cost, Judgement, Verdict
from webgym.judge.base import Pictures
from webgym.rollout.rejudge import RejudgeConfig, compare_judges, judge_run
from webgym.store.runs import RECORDED, RunReader, RunWriter, recorded, verdicts_of
from webgym.store.verdicts import VerdictLog, read_verdicts, verdicts_path


class Counting:
    """Passes every answered episode; fails on those that it is told to; counts how often it was asked."""

    def __init__(
        self, name: str = "counting/1", *, failing: frozenset[str] = frozenset(), reward: int = 1
    ) -> None:
        self.name = name
        self.failing = failing
        self.reward = reward
        self.asked: Counter[str] = Counter()

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        self.asked[episode.attempt_id] += 1
        assert task.id == episode.task_id
        assert (await pictures(episode.observations[0].screenshot)).startswith(b"\x89PNG")
        if episode.attempt_id in self.failing:
            raise JudgeError("it is hard to say \ud800")
        return Verdict(self.name, self.reward, (), Judgement(False, "no"), cost=Cost(calls=2, dollars=0.5))


async def test_each_attempt_is_judged_once_per_judge(run: Path) -> None:
    judge = Counting()
    state = await judge_run(run, judge)
    assert (state.total, state.done, state.earlier) == (len(judge.asked), len(judge.asked), 0)
    assert state.skipped == 12 - state.total > 0
    assert set(judge.asked.values()) == {1}
    assert state.cost == Cost(calls=2 * state.total, dollars=0.5 * state.total)
    again = await judge_run(run, judge)
    assert set(judge.asked.values()) == {1}
    assert (again.earlier, again.cost, again.spent) == (state.total, state.cost, Cost())
    assert again.outcomes == state.outcomes
    other = await judge_run(run, Counting("counting/2", reward=0))
    assert set(read_verdicts(run)) == {"counting/1", "counting/2"}
    assert other.outcomes[Outcome.SUCCESS] == 0
    anew = await judge_run(run, judge, RejudgeConfig(again=True))
    assert set(judge.asked.values()) == {2}
    assert anew.done == state.total
    assert anew.earlier == 0


async def test_an_attempt_without_a_verdict_is_tried_again(run: Path) -> None:
    first = next(iter(recorded(run)))
    judge = Counting(failing=frozenset({first}))
    state = await judge_run(run, judge)
    assert state.outcomes[Outcome.JUDGE_ERROR] == 1
    assert state.done == state.total
    held = read_verdicts(run)["counting/1"][first]
    assert held.verdict is None
    assert held.failure is not None
    assert held.failure.code == "judge_error"
    assert judge.asked[first] == 3  # by itself, when all others were done
    judge.failing = frozenset()
    mended = await judge_run(run, judge)
    assert judge.asked[first] == 4
    assert mended.outcomes[Outcome.JUDGE_ERROR] == 0
    assert mended.done == mended.total


async def test_an_attempt_that_gets_its_verdict_later_is_counted_once(run: Path) -> None:
    class Hesitant(Counting):
        """No verdict at the first time of asking."""

        async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
            self.failing = frozenset() if self.asked[episode.attempt_id] else frozenset({episode.attempt_id})
            return await super().judge(task, episode, pictures)

    state = await judge_run(run, Hesitant(), RejudgeConfig(judges=1))
    assert state.done == state.total == state.outcomes.total()
    assert state.outcomes[Outcome.JUDGE_ERROR] == state.failures.total() == 0


async def test_a_verdict_without_a_reward_is_none_unless_it_says_blocked(run: Path) -> None:
    class Undecided(Counting):
        async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
            self.asked[episode.attempt_id] += 1
            return Verdict(self.name, None, (), Judgement(False, "no"))

    judge = Undecided()
    for rounds in (1, 2):
        state = await judge_run(run, judge, RejudgeConfig(judge_again=0))
        assert set(judge.asked.values()) == {rounds}
        assert state.outcomes == {Outcome.JUDGE_ERROR: state.total}
        (why,) = state.failures
        assert "no reward" in why
    assert all(judged.verdict is None for judged in read_verdicts(run)[judge.name].values())


async def test_a_judge_that_fails_when_asked_anew_leaves_its_earlier_verdicts(run: Path) -> None:
    judge = Counting()
    await judge_run(run, judge)
    kept = read_verdicts(run)[judge.name]
    judge.failing = frozenset(judge.asked)
    state = await judge_run(run, judge, RejudgeConfig(again=True, judge_again=1))
    assert set(judge.asked.values()) == {3}
    assert state.outcomes[Outcome.JUDGE_ERROR] == state.failures.total() == state.done == state.total
    assert read_verdicts(run)[judge.name] == kept
    judge.failing, judge.reward = frozenset(), 0
    anew = await judge_run(run, judge, RejudgeConfig(again=True))
    assert anew.done == anew.total
    verdicts = [judged.verdict for judged in read_verdicts(run)[judge.name].values()]
    assert {verdict and verdict.reward for verdict in verdicts} == {0}


async def test_a_part_at_a_time(run: Path) -> None:
    judge = Counting()
    state = await judge_run(run, judge, RejudgeConfig(limit=2))
    assert (state.done, len(judge.asked)) == (2, 2)
    rest = await judge_run(run, judge, RejudgeConfig(judges=2))
    assert (rest.earlier, rest.done) == (2, rest.total)
    assert set(judge.asked.values()) == {1}


async def test_torn_and_changed_lines_do_not_count_and_are_judged_again(run: Path) -> None:
    judge = Counting()
    await judge_run(run, judge)
    path = verdicts_path(run, judge.name)
    lines = path.read_bytes().splitlines(keepends=True)
    changed = lines[0].replace(b'"reward":1', b'"reward":0')
    assert changed != lines[0]
    path.write_bytes(b"".join([changed, *lines[1:], lines[0][:40]]))
    state = await judge_run(run, judge)
    assert sorted(judge.asked.values())[-2:] == [1, 2]
    assert state.outcomes == (await judge_run(run, Counting())).outcomes
    assert path.read_bytes().endswith(b"}\n")


async def test_one_process_at_a_time_writes_a_judges_verdicts(run: Path) -> None:
    with VerdictLog(run, "counting/1"):
        with pytest.raises(StoreLocked):
            await judge_run(run, Counting())
        await judge_run(run, Counting("counting/2"))


async def test_a_run_with_verdicts_goes_on(run: Path) -> None:
    await judge_run(run, Counting())
    async with await RunWriter.reopen(run) as writer:
        assert len(writer.attempts) == 12


async def test_a_judge_that_always_fails_is_not_asked_for_ever(run: Path) -> None:
    judge = Counting(failing=frozenset(recorded(run)))
    with pytest.raises(JudgeError, match="3 attempts in a row had no verdict: it is hard to say"):
        await judge_run(run, judge, RejudgeConfig(judges=1, give_up_after=3))
    assert len(judge.asked) == len(read_verdicts(run)["counting/1"]) == 3
    judge.failing = frozenset()
    assert (await judge_run(run, judge)).outcomes[Outcome.JUDGE_ERROR] == 0


async def test_a_judge_that_hangs_is_given_up_on(run: Path) -> None:
    class Hanging(Counting):
        async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
            await asyncio.Event().wait()
            raise AssertionError

    state = await judge_run(run, Hanging(), RejudgeConfig(judge_seconds=0.01))
    assert state.outcomes == {Outcome.JUDGE_ERROR: state.total}


def test_kill_9_loses_nothing_that_was_counted(run: Path) -> None:
    """A judging is killed again and again, and in the end every attempt was judged, once in the file."""
    code = f"""
import asyncio, os, signal
from pathlib import Path
from tests.rollout.test_rejudge import Counting
from webgym.rollout.rejudge import RejudgeConfig, judge_run

def show(state):
    if state.done > state.earlier:
        os.kill(os.getpid(), signal.SIGKILL)

asyncio.run(judge_run(Path({str(run)!r}), Counting(), RejudgeConfig(judges=1), show=show))
"""
    total = len(recorded(run))
    for _ in range(2):
        died = subprocess.run(
            [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": ":".join(sys.path)}, check=False
        )
        assert died.returncode == -signal.SIGKILL
    assert len(read_verdicts(run)["counting/1"]) == 2
    judge = Counting()
    state = asyncio.run(judge_run(run, judge))
    assert (state.earlier, state.done, sum(judge.asked.values())) == (2, total, total - 2)
    assert len(verdicts_path(run, judge.name).read_bytes().splitlines()) == total


async def test_judges_are_compared(run: Path) -> None:
    await judge_run(run, Counting())
    name, _ = verdicts_of(run, "counting")
    assert name == "counting/1"
    _, before = verdicts_of(run, RECORDED)
    found = compare_judges(run, RECORDED, name)
    successes = sum(each.outcome is Outcome.SUCCESS for each in before.values())
    assert found.both + found.unjudged == len(before)
    assert found.agreed == successes
    # One attempt was blocked and one unjudged when it was collected.
    assert found.unjudged == 2
    assert all(
        difference.one.outcome != difference.other.outcome or difference.why()
        for difference in found.differences
    )
    reasons = [
        difference.why() for difference in found.differences if difference.one.outcome is Outcome.FAILURE
    ]
    assert reasons
    assert all(reason.endswith("/ everything holds") for reason in reasons)
    await judge_run(run, Counting("counting/2"))
    for missing in ("nobody", "counting"):
        with pytest.raises(RunFolderError, match="counting/1, counting/2"):
            verdicts_of(run, missing)


def test_records_of_the_run_stay_as_they_were(run: Path) -> None:
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    asyncio.run(judge_run(run, Counting()))
    assert all(path.read_bytes() == data for path, data in before.items())
    assert RunReader(run).summary is not None
