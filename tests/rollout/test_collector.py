"""The collector by itself: real HTTP to a browser server, a model and a judge that stand in."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import threading
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from benchmarks.stand_ins import TOKEN
from tests.rollout.running import SECONDS, Model, Run, World, books, half_of, outcomes, until

from webgym.core.errors import LeaseLost, ServerUnreachable
from webgym.core.task import LEVELS
from webgym.results.rates import Successes
from webgym.rollout.config import AttemptConfig
from webgym.rollout.lockstep import Lockstep
from webgym.rollout.sessions import Places
from webgym.server.client import BrowserClient
from webgym.server.config import ClientLimits
from webgym.store.files import TRAJECTORIES, Log

# --- schedules ------------------------------------------------------------------------------------------


def together(log: list[tuple[str, str]]) -> list[int]:
    """How many sessions were opened between two moments without any."""
    groups, living, opened = [], 0, 0
    for what, _ in log:
        living += 1 if what == "open" else -1
        opened += what == "open"
        if not living:
            groups.append(opened)
            opened = 0
    return groups


@pytest.mark.parametrize(
    ("schedule", "refills"),
    [("async", True), ("step_barrier", True), ("step_barrier", False), ("episode_barrier", True)],
)
async def test_every_schedule_makes_every_attempt_once(
    tmp_path: Path, world: World, schedule: str, refills: bool
) -> None:
    collector = {"schedule": schedule, "refills": refills, "order": "hardest_first"}
    config = world.config(tmp_path, 10, collector, samples=2)
    summary = await Run().start(config, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 20}
    assert world.browsers.opened == world.judge.asked == 20
    assert world.browsers.most <= 4
    assert not world.browsers.sessions
    assert summary["pass_at"] == {"1": {"value": 1.0, "tasks": 10}, "2": {"value": 1.0, "tasks": 10}}
    if schedule == "episode_barrier" or not refills:
        assert together(world.browsers.log) == [4, 4, 4, 4, 4]


async def test_without_a_barrier_an_attempt_that_hangs_holds_up_no_other(
    tmp_path: Path, world: World
) -> None:
    lets = asyncio.Event()
    model = world.model = Model(steps=1)
    reply, numbers = model._reply, itertools.count()

    async def first_hangs(request: Any) -> Any:
        if next(numbers) == 0:
            await lets.wait()
        return await reply(request)

    model._reply = first_hangs  # type: ignore[method-assign]
    await world.restart("model")
    run = Run().start(world.config(tmp_path, 12), tmp_path / "run")
    await until(lambda: run.progress.done == 11)
    lets.set()
    await run.end()
    assert outcomes(tmp_path / "run") == {"success": 12}


class Member:
    """Asks so often, and tells what it does."""

    def __init__(self, name: str, lockstep: Lockstep, told: list[str]) -> None:
        self.name, self.lockstep, self.told = name, lockstep, told

    async def play(self, turns: int) -> None:
        try:
            for _ in range(turns):
                async with self.lockstep.turn(self):
                    self.told.append(f"{self.name} asks")
                    await asyncio.sleep(0)
                self.told.append(f"{self.name} acts")
                await asyncio.sleep(0)
        finally:
            self.lockstep.leave(self)


async def test_in_lockstep_all_ask_in_one_batch_and_act_after_its_last_reply() -> None:
    """The first is there before the others, which join when they are ready."""
    lockstep, told = Lockstep(), list[str]()
    async with asyncio.timeout(100), asyncio.TaskGroup() as group:
        for name, turns in (("a", 4), ("b", 1), ("c", 2)):
            group.create_task(Member(name, lockstep, told).play(turns))
    batches = [(what, len(list(them))) for what, them in itertools.groupby(told, lambda line: line[2:])]
    assert [what for what, _ in batches] == ["asks", "acts"] * 4, told
    assert [size for _, size in batches] == [1, 1, 3, 3, 2, 2, 1, 1], told
    assert lockstep.rounds == 4


@pytest.mark.parametrize("turns", range(1, 8))
async def test_who_is_cancelled_in_lockstep_holds_up_nobody(turns: int) -> None:
    lockstep, told = Lockstep(), list[str]()
    players = [asyncio.create_task(Member(name, lockstep, told).play(4)) for name in "abc"]
    for _ in range(turns):
        await asyncio.sleep(0)
    players[1].cancel()
    async with asyncio.timeout(100):
        await asyncio.gather(*players, return_exceptions=True)
    assert told.count("a acts") == told.count("c acts") == 4


# --- judging off the critical path ----------------------------------------------------------------------


@pytest.mark.parametrize("limits", [{"judges": 2}, {"judges": 1, "backlog": 0, "sessions": 6}])
async def test_who_waits_for_a_verdict_is_recorded_without_one_and_judged_when_the_run_goes_on(
    tmp_path: Path, world: World, limits: dict[str, int]
) -> None:
    """Be it in line for the judge, or for a place in that line."""
    world.judge.lets.clear()
    run = Run().start(world.config(tmp_path, 6, limits), tmp_path / "run")
    await until(
        lambda: world.browsers.opened == 6 and not world.browsers.sessions
    )  # none waits for the judge
    await run.stop()
    assert outcomes(tmp_path / "run") == {"judge_error": 6}
    for each in books(tmp_path / "run"):
        assert each.judge_failure is not None
        assert "stopped before there was a verdict" in each.judge_failure.message
    world.judge.lets.set()
    await Run().start(None, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 6}
    assert world.browsers.opened == 6, "what the browsers did was not done again"


async def test_who_ended_and_whose_browser_is_being_given_back_is_recorded_too(
    tmp_path: Path, world: World
) -> None:
    asked, lets, close = asyncio.Event(), asyncio.Event(), world.browsers._close

    async def hangs(request: Any) -> Any:
        asked.set()
        await lets.wait()
        return await close(request)

    world.browsers._close = hangs  # type: ignore[method-assign]
    await world.restart("browsers")
    run = Run().start(world.config(tmp_path, 1), tmp_path / "run")
    await asyncio.wait_for(asked.wait(), SECONDS)
    await run.stop()
    assert outcomes(tmp_path / "run") == {"judge_error": 1}
    lets.set()
    await Run().start(None, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 1}
    assert world.browsers.opened == 1


class SlowDisk:
    """Writes trajectories when it is let."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.lets = threading.Event()
        self.asked = 0
        writes = Log.append

        def append(log: Log, data: bytes, *, durable: bool) -> None:
            if log.path.parent.name == TRAJECTORIES:
                self.asked += 1
                assert self.lets.wait(SECONDS)
            writes(log, data, durable=durable)

        monkeypatch.setattr(Log, "append", append)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[SlowDisk]:
    disk = SlowDisk(monkeypatch)
    yield disk
    disk.lets.set()


async def test_what_waits_for_a_slow_disk_with_its_verdict_is_written_before_a_run_ends(
    tmp_path: Path, world: World, disk: SlowDisk
) -> None:
    run = Run().start(world.config(tmp_path, 4), tmp_path / "run")
    await until(lambda: world.judge.asked == 4 and disk.asked == 1)
    await until(lambda: run.progress.calls["judge"].load.done == 4)
    run.task.cancel()
    await asyncio.sleep(0)
    run.task.cancel()  # whoever stops it is impatient
    disk.lets.set()
    with pytest.raises(asyncio.CancelledError):
        await run.end()
    assert outcomes(tmp_path / "run") == {"success": 4}
    assert run.progress.outcomes.total() == 4


@pytest.mark.parametrize("what", ["judge", "disk"])
async def test_a_slow_judge_or_disk_holds_browsers_back_before_memory_grows(
    tmp_path: Path, world: World, disk: SlowDisk, what: str
) -> None:
    slow = disk if what == "disk" else world.judge
    (world.judge if what == "disk" else disk).lets.set()
    slow.lets.clear()
    limits = {"sessions": 3, "judges": 2, "backlog": 1}
    run = Run().start(world.config(tmp_path, 20, limits), tmp_path / "run")
    await until(lambda: len(world.browsers.log) == 2 * (2 + 1 + 3))
    await asyncio.sleep(0.3)  # time enough for another to begin
    assert world.browsers.opened == 2 + 1 + 3
    slow.lets.set()
    await run.end()
    assert outcomes(tmp_path / "run") == {"success": 20}


# --- ends -----------------------------------------------------------------------------------------------


async def test_a_run_that_is_to_finish_ends_what_it_has_begun_and_begins_nothing(
    tmp_path: Path, world: World
) -> None:
    run = await half_of(world, world.config(tmp_path, 16), tmp_path / "run")
    begun = world.browsers.opened
    run.finishing.set()
    world.model.may = math.inf
    await run.end()
    assert outcomes(tmp_path / "run") == {"success": begun}
    assert world.browsers.opened == begun < 16
    await Run().start(None, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 16}
    assert world.browsers.opened == 16


async def test_a_complete_run_that_is_resumed_needs_no_server(tmp_path: Path, world: World) -> None:
    await Run().start(world.config(tmp_path, 2), tmp_path / "run").end()
    made = (tmp_path / "run" / "summary.json").read_bytes()
    (tmp_path / "run" / "summary.json").unlink()
    await world.stop("browsers")
    told: list[str] = []
    await Run().start(None, tmp_path / "run", told.append).end()
    assert told == ["the run is complete: no attempt is left to make or to judge"]
    assert (tmp_path / "run" / "summary.json").read_bytes() == made


async def test_a_run_that_is_to_finish_does_not_judge_the_backlog_first(tmp_path: Path, world: World) -> None:
    await world.stop("judge")
    await Run().start(world.config(tmp_path, 6, {"judges": 1}), tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"judge_error": 6}
    world.judge.lets.clear()
    await world.start("judge")
    run = Run().start(None, tmp_path / "run")
    await until(lambda: world.judge.asked == 1)
    progress = run.progress
    assert progress.successes_of("easy").judged == 0
    assert progress.steps == sum(len(each.episode.steps) for each in books(tmp_path / "run"))
    run.finishing.set()
    world.judge.lets.set()
    await run.end()
    assert outcomes(tmp_path / "run") == {"judge_error": 5, "success": 1}
    # Figures of a resumed run are those of all its sessions; speed is this session's.
    assert +progress.outcomes == {"judge_error": 5, "success": 1}
    assert progress.successes == Successes(1, 1, 6)
    assert sum(progress.successes_of(level).planned for level in LEVELS) == 6
    assert progress.steps_per_second == 0
    await Run().start(None, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 6}


async def test_runs_share_places_and_the_stragglers_of_one_run_on_while_the_next_begins(
    tmp_path: Path, world: World
) -> None:
    """All of the first run's attempts take 3 replies; of its last one, the model holds back the third."""
    free = asyncio.Semaphore(4)
    limits = {"straggler_share": 0.8, "straggler_seconds": 0.0}
    first, second = Places(free), Places(free)
    (tmp_path / "more").mkdir()
    world.model.may = 8 * 3 - 1
    one = Run().start(world.config(tmp_path, 8, limits), tmp_path / "one", places=first)
    async with asyncio.timeout(SECONDS):
        await first.spare.wait()
        await first.enough.wait()
    await until(lambda: one.progress.done == 7 and world.model.held == 1)
    assert +one.progress.outcomes == {"success": 7}, "the straggler is not ended"
    two = Run().start(world.config(tmp_path / "more", 8, limits), tmp_path / "two", places=second)
    await until(lambda: world.model.held == 4)
    await asyncio.sleep(0.2)  # time enough for another to begin
    assert world.browsers.opened == 8 + 3, "the straggler has one of four places"
    assert not second.spare.is_set()
    world.model.may = math.inf
    await one.end()
    await two.end()
    assert outcomes(tmp_path / "one") == outcomes(tmp_path / "two") == {"success": 8}
    assert second.spare.is_set()


async def test_a_straggler_is_cancelled_by_the_collector_and_made_when_the_run_goes_on(
    tmp_path: Path, world: World
) -> None:
    numbers = itertools.count()
    world.model._reply_seconds = lambda: 1000.0 if next(numbers) == 3 else 0.0
    late = {"straggler_share": 0.8, "straggler_seconds": 0.0}  # 7 of 8: only the one that hangs is left
    await Run().start(world.config(tmp_path, 8, late), tmp_path / "run").end()
    ended = books(tmp_path / "run")
    assert outcomes(tmp_path / "run")["cancelled"] == 1
    [straggler] = [each for each in ended if each.outcome == "cancelled"]
    assert straggler.episode.ending == "straggler"
    assert straggler.episode.failure is not None
    assert straggler.episode.failure.code == "straggler"
    assert straggler.verdict is None
    await Run().start(None, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 8, "cancelled": 1}


async def test_who_begins_late_gets_as_much_time_as_the_others_needed(tmp_path: Path, world: World) -> None:
    """The last attempt begins when the end of the run has begun, and there is no grace."""
    numbers = itertools.count()
    world.model._reply_seconds = lambda: 0.7 if next(numbers) < 12 else 0.1  # 4 attempts of 3 turns
    late = {"straggler_share": 0.8, "straggler_seconds": 0.0, "sessions": 4}
    await Run().start(world.config(tmp_path, 5, late), tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 5}


async def test_a_machine_that_is_slow_is_no_failure_of_the_agents(tmp_path: Path, world: World) -> None:
    """An attempt that exceeds its time has no reward; its limit is of its own time, not of the queues'."""
    world.browsers._step_seconds = lambda: 0.1
    config = world.config(tmp_path, 2, attempt=AttemptConfig(longest_seconds=0.05), retries=0)
    await Run().start(config, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"environment_error": 2}
    codes = {each.episode.failure.code for each in books(tmp_path / "run") if each.episode.failure}
    assert codes == {"attempt_overdue"}


async def test_waits_in_the_servers_queues_are_not_the_attempts_own_time(
    tmp_path: Path, world: World
) -> None:
    """Nor do they use up the time in which a call is answered."""
    steps = itertools.count()
    world.browsers._step_seconds = lambda: 0.0 if next(steps) else 1.5
    world.browsers._queued_seconds = 1e6
    limits = ClientLimits(reply_seconds=0.5)  # enough for all other calls on a slow machine
    await Run().start(world.config(tmp_path, 2, limits=limits, retries=0), tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 2}


async def test_a_step_that_hangs_without_waiting_is_given_up(world: World) -> None:
    world.browsers._step_seconds = lambda: 3600.0
    async with BrowserClient(world.url("browsers"), token=TOKEN) as client:
        session = await client.open()
        client.limits = ClientLimits(reply_seconds=0.5)
        with pytest.raises(ServerUnreachable, match="in time"):
            await session.step()
        # The server knows better what became of a session that ended meanwhile.
        world.browsers._step_seconds = lambda: world.browsers.sessions.clear() or 3600.0  # type: ignore[func-returns-value]
        with pytest.raises(LeaseLost):
            await session.step()


# --- figures --------------------------------------------------------------------------------------------


async def test_what_calls_wait_and_take_is_recorded(tmp_path: Path, world: World) -> None:
    world.model._reply_seconds = lambda: 0.05
    limits = {"policy_calls": 1, "metrics_port": 0, "metric_seconds": 0.05, "judges": 3}
    run = Run().start(world.config(tmp_path, 6, limits), tmp_path / "run")
    await until(lambda: run.progress.calls and run.progress.calls["policy"].load.waiting >= 2)
    await run.end()
    assert world.model.most == 1
    lines = (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()
    calls = json.loads(lines[-1])["calls"]
    counts = {"allocate": 6, "navigate": 6, "execute": 12, "policy": 18, "judge": 6, "release": 6}
    assert {kind: calls[kind]["done"] for kind in counts} == counts
    assert calls["policy"]["limit"] == 1
    assert calls["policy"]["served_seconds"] >= 18 * 0.05
    assert calls["policy"]["waited_seconds"] > calls["judge"]["waited_seconds"]
    assert any(json.loads(line)["calls"]["policy"]["waiting"] for line in lines)
    assert isinstance(json.loads(lines[-1])["loop_lag_milliseconds"]["p99"], float)


@pytest.mark.parametrize("operation", ["allocate", "navigate", "execute", "release"])
async def test_operations_of_a_kind_have_a_limit_that_holds_up_no_others(
    tmp_path: Path, world: World, operation: str
) -> None:
    world.browsers._step_seconds = lambda: 0.05
    world.browsers._open_seconds = 0.05
    limits = ClientLimits.model_validate({operation: 1})
    await Run().start(world.config(tmp_path, 8, limits=limits), tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 8}
    assert world.browsers.most_of[operation] == 1
    assert max(world.browsers.most_of.values()) > 1


async def test_prometheus_reads_a_collectors_figures() -> None:
    from webgym.core.calls import call_queues
    from webgym.core.outcome import Outcome
    from webgym.rollout.live_file import exposing
    from webgym.rollout.progress import Progress

    queues = call_queues({"policy": 2})
    async with queues["policy"].turn():
        pass
    progress = Progress(total=3, calls=queues, steps=7, note="an oracle")
    progress.outcomes[Outcome.SUCCESS] = 2

    def read(port: int | None) -> str:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=30) as answer:
            return str(answer.read(), "utf-8")

    with exposing(progress, 0) as port:
        said = await asyncio.to_thread(read, port)
    assert 'webgym_collector_calls_done_total{kind="policy"} 1.0' in said
    assert 'webgym_collector_outcomes_total{outcome="success"} 2.0' in said
    assert "webgym_collector_steps_total 7.0" in said
    assert 'webgym_collector_note{note="an oracle"} 1.0' in said
