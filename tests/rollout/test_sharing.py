"""Several collectors share one task list, and no task is done twice."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import pytest
from tests.rollout.running import HALF, Run, World, books, outcomes, until, until_half
from tests.rollout.test_plan import entry
from tests.rollout.test_store import begun, made
from tests.rollout.test_summary import task
from tests.rollout.test_verify import Judge as Passing

from webgym.core.errors import ConfigError, RunFolderError, StoreError
from webgym.core.outcome import Outcome
from webgym.report.live_run import Overview
from webgym.results.summary import digest_of
from webgym.rollout.merging import merge_runs, runs_in
from webgym.rollout.plan import Plan
from webgym.rollout.rejudge import judge_run
from webgym.rollout.sharing import Claim, Claims, SharingConfig
from webgym.store.files import check_run
from webgym.store.runs import RunReader, recorded
from webgym.store.verify import verify

TASKS = [task(f"t{number}", 1) for number in range(4)]
SETTINGS = {"seed": 1, "samples": 2, "agent": {}, "judge": {}, "attempt": {}} | {
    "policy": {"chat": {"base_url": "http://one/", "model": "m"}}
}


def collector(folder: Path, name: str, dead_seconds: float = 60.0) -> Claims:
    claims = Claims(SharingConfig(folder=folder / "shared", dead_seconds=dead_seconds), name)
    claims.join(TASKS, SETTINGS, folder / name)
    return claims


def test_a_sample_is_one_collectors_until_it_is_done(tmp_path: Path) -> None:
    one, two = collector(tmp_path, "one"), collector(tmp_path, "two")
    assert one.claim("t0", 0) is Claim.OURS
    assert two.claim("t0", 0) is Claim.TAKEN
    assert two.claim("t0", 1) is Claim.OURS
    assert one.claim("t0", 0) is Claim.OURS  # made again after an error, or by a resumed run
    one.finish("t0", 0)
    assert two.claim("t0", 0) is Claim.DONE


def test_of_many_who_take_over_from_the_dead_one_wins_and_the_dead_is_told(tmp_path: Path) -> None:
    dead, *others = [collector(tmp_path, name) for name in ("dead", "a", "b", "c")]
    assert dead.claim("t0", 0) is Claim.OURS
    assert others[0].claim("t0", 0) is Claim.TAKEN
    os.utime(tmp_path / "shared/collectors/dead", (1, 1))
    found = [each.claim("t0", 0) for each in others]
    assert sorted(claim.value for claim in found) == ["ours", "taken", "taken"]
    assert not dead.holds("t0", 0)
    assert others[0].holds("t0", 0)


def test_who_leaves_is_taken_over_from_at_once(tmp_path: Path) -> None:
    one, two = collector(tmp_path, "one"), collector(tmp_path, "two")
    assert one.claim("t0", 0) is Claim.OURS
    one.leave()
    assert two.claim("t0", 0) is Claim.OURS


async def test_what_its_own_run_wants_to_attempt_again_is_no_others(tmp_path: Path) -> None:
    """Once its retries are spent a sample is done, for all others; who asks for more gets them."""
    one, two = collector(tmp_path, "one"), collector(tmp_path, "two")
    plan = Plan(TASKS[:1], samples=1, retries=0, claims=one)
    spent = await plan.take()
    assert spent is not None
    await plan.settle(spent, Outcome.ENVIRONMENT_ERROR)
    recorded = [entry(spent, Outcome.ENVIRONMENT_ERROR)]
    assert two.claim("t0", 0) is Claim.DONE
    again = Plan(TASKS[:1], samples=1, retries=0, recorded=recorded, retry_errors=True, claims=one)
    more = await again.take()
    assert more is not None
    assert more.attempt_id == "t0#0.1"
    assert two.claim("t0", 0) is Claim.TAKEN, "it is being attempted"
    await again.settle(more, Outcome.SUCCESS)
    assert two.claim("t0", 0) is Claim.DONE
    assert not again.elsewhere


async def test_what_a_dead_collector_has_on_its_disk_stays_its_own(tmp_path: Path) -> None:
    """It is another that says so for it, and it may still find that its record is lost."""
    dead, other = collector(tmp_path, "dead"), collector(tmp_path, "other")
    async with await begun(tmp_path / "dead", 0) as writer:
        for sample in range(3):
            assert dead.claim("t/1", sample) is Claim.OURS
        dead.leave()
        assert other.claim("t/1", 0) is Claim.DONE
        assert dead.claim("t/1", 0) is Claim.OURS
        dead.beat()  # it is resumed, and stopped after the record and before it is marked as done
        await writer.append(made(1))
        dead.leave()
        assert other.claim("t/1", 1) is Claim.DONE
        assert other.claim("t/1", 2) is Claim.OURS


def test_what_was_done_after_all_is_not_held_by_who_took_it_over(tmp_path: Path) -> None:
    slow, other = collector(tmp_path, "slow"), collector(tmp_path, "other")
    assert slow.claim("t0", 0) is Claim.OURS
    assert slow.holds("t0", 0)
    os.utime(tmp_path / "shared/collectors/slow", (1, 1))  # its machine sleeps before it records
    assert other.claim("t0", 0) is Claim.OURS
    slow.finish("t0", 0)
    assert not other.holds("t0", 0)
    assert slow.holds("t0", 0)


def test_collectors_of_different_lists_or_settings_do_not_share(tmp_path: Path) -> None:
    collector(tmp_path, "one")
    other = Claims(SharingConfig(folder=tmp_path / "shared"), "two")
    with pytest.raises(ConfigError, match="another list"):
        other.join(TASKS[:3], SETTINGS, tmp_path / "two")
    with pytest.raises(ConfigError, match="another list"):  # which gives other rewards
        other.join([*TASKS[:3], task(TASKS[3].id, 2)], SETTINGS, tmp_path / "two")
    elsewhere = {"policy": {"chat": {"base_url": "http://other/", "model": "m"}}}
    other.join(TASKS, SETTINGS | elsewhere, tmp_path / "two")
    random = {"policy": {"name": "random"}}
    with pytest.raises(ConfigError, match="other settings of 'policy'"):
        Claims(other.config, "three").join(TASKS, SETTINGS | random, tmp_path / "three")


def shared(tmp_path: Path, **more: Any) -> dict[str, Any]:
    times = {"beat_seconds": 0.2, "look_seconds": 0.1, "dead_seconds": 600.0}
    return {"sharing": {"folder": tmp_path / "shared"} | times | more}


async def test_three_collectors_do_every_sample_once(tmp_path: Path, world: World) -> None:
    config = world.config(tmp_path, 20, shared(tmp_path), samples=2)
    runs = [Run().start(config, tmp_path / name) for name in "abc"]
    summaries = [await run.end() for run in runs]
    made = [each for name in "abc" for each in books(tmp_path / name)]
    samples = {(each.episode.task_id, each.episode.sample) for each in made}
    assert len(made) == len(samples) == 40 == world.browsers.opened
    assert sum(summary["planned"]["overall"] for summary in summaries) == 40
    assert all(summary["success_rate_of_planned"]["overall"] in (1.0, None) for summary in summaries)
    for name, summary in zip("abc", summaries, strict=True):
        overview = Overview(RunReader(tmp_path / name))
        for each in books(tmp_path / name):
            overview.add(digest_of(each))
        shown = overview.figures().summary
        assert shown["by_level"] == summary["by_level"]
        assert shown["planned"] == summary["planned"], "the report says what summary.json says"
    merged = await merge_runs(runs_in(tmp_path / "shared"), tmp_path / "all")
    assert (merged.attempts, merged.samples, merged.missing) == (40, 40, 0)
    assert {each.episode.attempt_id for each in books(tmp_path / "all")} == {
        each.episode.attempt_id for each in made
    }
    assert merged.summary["planned"]["overall"] == 40
    assert merged.summary["success_rate_of_planned"]["overall"] == 1.0
    assert verify(tmp_path / "all").is_whole
    with pytest.raises(RunFolderError, match="a run already"):
        await merge_runs([tmp_path / "a"], tmp_path / "all")
    assert not list(tmp_path.glob(".*")), "nothing is left behind"


async def test_a_merge_that_is_cut_short_leaves_no_run_that_could_be_resumed(
    tmp_path: Path, world: World
) -> None:
    config = world.config(tmp_path, 4, shared(tmp_path))
    await Run().start(config, tmp_path / "a").end()

    def stop(done: int, _: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        await merge_runs([tmp_path / "a"], tmp_path / "all", progress=stop)
    assert not (tmp_path / "all").exists()
    assert not list(tmp_path.glob(".*"))
    half = tmp_path / "all/.unfinished.tmp"  # as kill -9 leaves it
    shutil.copytree(tmp_path / "a", half)
    with pytest.raises(RunFolderError, match="is not a run"):
        check_run(tmp_path / "all")
    assert (await merge_runs([tmp_path / "a"], tmp_path / "all")).attempts == 4
    assert not half.exists()
    assert len(books(tmp_path / "all")) == 4


async def test_what_an_abandoned_run_had_claimed_is_done_by_another_and_what_it_recorded_is_not(
    tmp_path: Path, world: World
) -> None:
    config = world.config(tmp_path, 12, shared(tmp_path))
    world.model.may = HALF
    first = Run().start(config, tmp_path / "a")
    await until_half(first, world)
    await first.stop()
    world.model.may = math.inf
    ended = {each.episode.task_id for each in books(tmp_path / "a") if not each.outcome.is_retried}
    await Run().start(config, tmp_path / "b").end()
    others = {each.episode.task_id for each in books(tmp_path / "b")}
    assert not ended & others
    assert len(ended | others) == 12
    await Run().start(None, tmp_path / "a").end()  # there is nothing left for it
    assert len(RunReader(tmp_path / "a").attempts) == len(books(tmp_path / "a"))
    again = {each.episode.task_id for each in books(tmp_path / "a") if not each.outcome.is_retried}
    assert again == ended
    main_result = merge_command(tmp_path / "shared", tmp_path / "all")
    assert f"{len(books(tmp_path / 'a')) + len(books(tmp_path / 'b'))} attempts of 2 runs" in main_result
    assert "no result" not in main_result
    ends = Counter(each.episode.task_id for each in books(tmp_path / "all") if not each.outcome.is_retried)
    assert ends == dict.fromkeys(ended | others, 1)
    by_task: defaultdict[str, dict[int, Outcome]] = defaultdict(dict)
    for each in books(tmp_path / "all"):
        by_task[each.episode.task_id][each.episode.retry] = each.outcome
    for outcomes_of in by_task.values():
        assert sorted(outcomes_of) == list(range(len(outcomes_of))), "no two attempts have one name"
        assert not outcomes_of[max(outcomes_of)].is_retried, "the one that counts comes last"
    await Run().start(None, tmp_path / "all").end()  # a run like any other, with nothing left to do
    assert len(books(tmp_path / "all")) == len(books(tmp_path / "a")) + len(books(tmp_path / "b"))


async def test_what_is_recorded_during_a_merge_is_left_out(tmp_path: Path, world: World) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    await Run().start(world.config(tmp_path, 3), one).end()
    shutil.copytree(one, two)
    shard = "trajectories/00000.jsonl"
    first, second, third = (one / shard).read_bytes().splitlines(keepends=True)
    (one / shard).write_bytes(first)
    (two / shard).write_bytes(second)

    def record(done: int, _: int) -> None:
        if done == 1:
            (two / shard).write_bytes(second + third)

    merged = await merge_runs([one, two], tmp_path / "all", progress=record)
    assert (merged.attempts, merged.missing) == (2, 1)


async def test_runs_that_did_not_share_a_list_are_not_merged(tmp_path: Path, world: World) -> None:
    (tmp_path / "other").mkdir()
    for name, folder, count in (("a", tmp_path, 2), ("b", tmp_path, 2), ("c", tmp_path / "other", 3)):
        await Run().start(world.config(folder, count), tmp_path / name).end()
    with pytest.raises(ConfigError, match="both completed sample 0"):
        await merge_runs([tmp_path / "a", tmp_path / "b"], tmp_path / "all")
    with pytest.raises(ConfigError, match="different tasks"):
        await merge_runs([tmp_path / "a", tmp_path / "c"], tmp_path / "all")
    shutil.copytree(tmp_path / "a", tmp_path / "d")
    listed = tmp_path / "d/tasks.jsonl"
    listed.write_text(listed.read_text().replace('"facts":["', '"facts":["not ', 1))
    with pytest.raises(ConfigError, match="different tasks"):
        await merge_runs([tmp_path / "a", tmp_path / "d"], tmp_path / "all")
    assert not (tmp_path / "all").exists()
    other = (tmp_path / "b/config.yaml").read_text().replace("samples: 1", "samples: 2", 1)
    (tmp_path / "b/config.yaml").write_text(other)
    with pytest.raises(ConfigError, match="differ in their settings of 'samples'"):
        await merge_runs([tmp_path / "a", tmp_path / "b"], tmp_path / "all")
    (tmp_path / "lists/collectors").mkdir(parents=True)
    (tmp_path / "lists/collectors/one").write_text(str(tmp_path / "gone"))
    with pytest.raises(RunFolderError, match="does not exist"):
        runs_in(tmp_path / "lists")


def merge_command(shared: Path, out: Path) -> str:
    """What the command prints; in a process of its own, since a loop runs here."""
    done = subprocess.run(
        [sys.executable, "-m", "webgym", "merge", str(shared), "--out", str(out)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert (out / "report.html").exists()
    return done.stdout


async def test_a_record_that_was_set_aside_is_made_again_by_whose_run_it_was(
    tmp_path: Path, world: World
) -> None:
    config = world.config(tmp_path, 6, shared(tmp_path))
    runs = [await Run().start(config, tmp_path / name).end() for name in "ab"]
    assert [run["planned"]["overall"] for run in runs] == [6, 0]
    shard = tmp_path / "a/trajectories/00000.jsonl"
    shard.write_bytes(shard.read_bytes().replace(b'"outcome":"success"', b'"outcome":"failure"', 1))
    verify(tmp_path / "a", set_aside=True)
    made = world.browsers.opened
    again = [await Run().start(None, tmp_path / name).end() for name in "ba"]
    assert world.browsers.opened == made + 1
    assert [run["planned"]["overall"] for run in again] == [0, 6]
    assert again[1]["success_rate_of_planned"]["overall"] == 1.0


async def test_what_was_taken_over_while_it_waited_for_a_verdict_has_no_reward_in_two_runs(
    tmp_path: Path, world: World
) -> None:
    world.judge.lets.clear()
    config = world.config(tmp_path, 3, shared(tmp_path, beat_seconds=600.0))
    first = Run().start(config, tmp_path / "a")
    await until(lambda: world.judge.asked == 3)
    [life] = (tmp_path / "shared/collectors").iterdir()
    os.utime(life, (1, 1))  # its host sleeps, say
    second = Run().start(config, tmp_path / "b")
    await until(lambda: world.judge.asked == 6)
    await first.stop()
    assert outcomes(tmp_path / "a") == {"judge_error": 3}
    world.judge.lets.set()
    await second.end()
    resumed = await Run().start(None, tmp_path / "a").end()
    assert (outcomes(tmp_path / "a"), outcomes(tmp_path / "b")) == ({"cancelled": 3}, {"success": 3})
    assert resumed["planned"]["overall"] == 0
    assert world.judge.asked == 6, "it is not judged twice either"
    assert recorded(tmp_path / "a") == {}
    assert (await judge_run(tmp_path / "a", Passing())).total == 0
    assert (await judge_run(tmp_path / "b", Passing())).total == 3


async def test_who_loses_sight_of_the_others_keeps_what_its_browsers_did(
    tmp_path: Path, world: World
) -> None:
    world.judge.lets.clear()
    config = world.config(tmp_path, 3, shared(tmp_path, beat_seconds=600.0))
    run = Run().start(config, tmp_path / "a")
    await until(lambda: world.judge.asked == 3)
    (tmp_path / "shared").rename(tmp_path / "away")
    world.judge.lets.set()
    with pytest.raises((StoreError, BaseExceptionGroup)):
        await run.end()
    assert outcomes(tmp_path / "a") == {"judge_error": 3}, "the folder of the run itself is whole"
    (tmp_path / "away").rename(tmp_path / "shared")
    await Run().start(None, tmp_path / "a").end()
    assert outcomes(tmp_path / "a") == {"success": 3}
    assert world.browsers.opened == 3


async def test_a_run_that_goes_on_from_another_folder_shares_with_the_same_others(
    tmp_path: Path, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    config = world.config(tmp_path, 4, shared(tmp_path, folder=Path("shared")))
    first = Run().start(config, tmp_path / "a")
    await until(lambda: first.progress.done >= 1)
    first.finishing.set()
    await first.end()
    await Run().start(config, tmp_path / "b").end()
    made = world.browsers.opened
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    await Run().start(None, tmp_path / "a").end()
    assert world.browsers.opened == made == 4
    (tmp_path / "shared").rename(tmp_path / "away")
    with pytest.raises(ConfigError, match="no longer holds them"):
        await Run().start(None, tmp_path / "a").end()
    assert not (tmp_path / "shared").exists()
