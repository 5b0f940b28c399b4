"""Whatever fails around a collector, outcomes add up and nothing is done twice."""

from __future__ import annotations

import asyncio
import itertools
import math
import os
import random
import shutil
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from aiohttp import web
from benchmarks.stand_ins import TOKEN, StandInBrowsers, refusal, serving_app
from tests.rollout.running import HALF, SECONDS, Run, World, books, half_of, outcomes, until, until_half
from tests.soak.disk import small_disk

from webgym.core.errors import (
    BrowserCrashed,
    BrowserLaunchFailed,
    NoCapacity,
    PolicyError,
    ServerUnreachable,
    SitesError,
    StoreFull,
    Unauthorized,
    WebGymError,
    WorkerLost,
)
from webgym.core.outcome import Outcome
from webgym.llm.config import Retry
from webgym.rollout.attempt import Attempt
from webgym.rollout.collector import Collector
from webgym.rollout.config import CollectorConfig
from webgym.rollout.live_file import read_feed
from webgym.rollout.sessions import KeptLeases, patiently
from webgym.server.client import BrowserClient
from webgym.server.messages import SessionGrant, SessionOptions
from webgym.store.runs import RunReader
from webgym.testing.environments import StandInBrowsers as StandInPages


async def test_a_policy_that_is_away_for_longer_than_its_tries_costs_no_attempt(
    tmp_path: Path, world: World
) -> None:
    config = world.config(tmp_path, 16, {"give_up_after": 2}, retries=0)
    assert config.policy.chat is not None
    retry = Retry(tries=2, first_seconds=0.05, longest_seconds=0.2)
    chat = config.policy.chat.model_copy(update={"retry": retry})
    config = config.model_copy(update={"policy": config.policy.model_copy(update={"chat": chat})})
    run = await half_of(world, config, tmp_path / "run")
    await world.stop("model")
    await until(lambda: "cannot be reached" in " ".join(run.progress.warnings))
    await asyncio.sleep(1)
    world.model.may = math.inf
    await world.start("model")
    await run.end()
    assert outcomes(tmp_path / "run") == {"success": 16}


async def test_a_model_that_is_replaced_in_the_midst_of_a_run_is_no_failure_of_the_first(
    tmp_path: Path, world: World
) -> None:
    soon = {"give_up_after": 2, "judges": 1, "backlog": 0}  # however slow the disk is
    config = world.config(tmp_path, 24, soon, retries=0)
    assert config.policy.chat is not None
    chat = config.policy.chat.model_copy(update={"retry": Retry(tries=2, first_seconds=0.05)})
    config = config.model_copy(update={"policy": config.policy.model_copy(update={"chat": chat})})
    world.model.name, world.model.may = "first", HALF
    run = Run().start(config, tmp_path / "run")
    await until_half(run, world)
    world.model.name, world.model.may = "second", HALF + 4  # their second tries wait
    await until(lambda: "as the model 'second'" in " ".join(run.progress.warnings))
    world.model.may = math.inf
    with pytest.raises(BaseExceptionGroup) as stopped:
        await run.end()
    assert "'second', and replied as 'first' before" in _whole(stopped.value)
    assert outcomes(tmp_path / "run").keys() <= {"success", "policy_error", "cancelled"}
    with pytest.raises(BaseExceptionGroup) as stopped:
        await Run().start(None, tmp_path / "run").end()
    assert "'second', and replied as 'first' before" in _whole(stopped.value)


def test_attempts_that_fail_together_stop_the_run_with_one_error() -> None:
    collector: Any = object.__new__(Collector)
    collector._config, collector._failed_in_a_row = CollectorConfig(give_up_after=2), 0
    failure = SimpleNamespace(code="policy_unreachable", message="no answer")

    def records(started: float, ended: float) -> None:
        collector._watch(SimpleNamespace(failure=failure, started=started), ended)

    records(0.0, 1.0)
    records(0.5, 1.5)  # one event ended both
    with pytest.raises(PolicyError, match="2 attempts in a row failed"):
        records(1.5, 2.0)
    records(1.5, 2.0)  # its task had gone on before it was cancelled


async def test_what_a_judge_that_is_down_did_not_judge_is_judged_later_and_not_made_again(
    tmp_path: Path, world: World
) -> None:
    run = await half_of(world, world.config(tmp_path, 16), tmp_path / "run")
    await world.stop("judge")
    world.model.may = 44  # of 48: two attempts, at least, end when it is back
    await until(lambda: run.progress.outcomes[Outcome.JUDGE_ERROR] >= 3)
    await world.start("judge")
    world.model.may = math.inf
    await run.end()
    assert outcomes(tmp_path / "run") == {"success": 16}
    assert world.browsers.opened == 16


async def test_a_judge_that_hangs_stops_the_run_and_judges_when_it_goes_on(
    tmp_path: Path, world: World
) -> None:
    world.judge.lets.clear()
    limits = {"judges": 2, "judge_seconds": 0.05, "give_up_after": 2, "backlog": 0}
    with pytest.raises(BaseExceptionGroup) as stopped:
        await Run().start(world.config(tmp_path, 12, limits), tmp_path / "run").end()
    assert "2 attempts in a row had no verdict: no verdict within 0.05 s" in _whole(stopped.value)
    assert world.browsers.opened < 12
    assert outcomes(tmp_path / "run").keys() <= {"judge_error", "cancelled"}
    world.judge.lets.set()
    settings = tmp_path / "run/config.yaml"  # it is given time, or a slow machine would be a judge that hangs
    settings.write_text(settings.read_text().replace("judge_seconds: 0.05", "judge_seconds: 60"))
    await Run().start(None, tmp_path / "run").end()
    ended = outcomes(tmp_path / "run")
    assert ended["success"] == 12
    assert ended.keys() <= {"success", "cancelled"}


async def test_a_server_that_is_lost_and_comes_back_costs_what_was_in_flight(
    tmp_path: Path, world: World
) -> None:
    run = await half_of(world, world.config(tmp_path, 16, retries=3), tmp_path / "run")
    await world.stop("browsers")
    world.browsers.sessions.clear()
    world.model.may = math.inf
    await until(lambda: run.progress.states["opening"])
    await world.start("browsers")
    await run.end()
    ended = outcomes(tmp_path / "run")
    assert ended["success"] == 16
    assert 1 <= ended["environment_error"] <= 4  # who was about to answer needs no browser any more
    assert ended.keys() == {"success", "environment_error"}


async def test_garbage_in_place_of_steps_for_a_moment_uses_up_one_try_of_each_attempt(
    tmp_path: Path, world: World
) -> None:
    step, until_ = world.browsers._step, [float("inf")]

    async def garbled(request: web.Request) -> web.Response:
        if time.monotonic() < until_[0] and world.browsers.opened > 4:
            until_[0] = min(until_[0], time.monotonic() + 0.3)
            return web.json_response({})
        return await step(request)

    world.browsers._step = garbled  # type: ignore[method-assign]
    await world.restart("browsers")
    config = world.config(tmp_path, 8, {"server_retry_seconds": 0.1, "give_up_after": 100}, retries=1)
    await Run().start(config, tmp_path / "run").end()
    assert outcomes(tmp_path / "run")["success"] == 8


async def test_one_restart_of_the_server_is_one_failure_however_many_attempts_it_ends(
    tmp_path: Path, world: World
) -> None:
    world.browsers._step_seconds = lambda: 1000.0
    config = world.config(tmp_path, 16, {"sessions": 8, "give_up_after": 3})
    run = Run().start(config, tmp_path / "run")
    await until(lambda: world.browsers.most_of["navigate"] == 8)
    await world.stop("browsers")
    world.browsers.sessions.clear()
    world.browsers._step_seconds = lambda: 0.0
    await until(lambda: run.progress.states["opening"])
    await world.start("browsers")
    await run.end()
    assert outcomes(tmp_path / "run") == {"success": 16, "environment_error": 8}


@pytest.mark.parametrize(
    "refuses",
    [
        lambda: web.HTTPBadGateway(text="<h1>502 Bad Gateway</h1>", content_type="text/html"),
        lambda: refusal(BrowserLaunchFailed("chromium did not start")),
        lambda: refusal(BrowserCrashed("the browser is gone")),
        lambda: refusal(WorkerLost("the worker is gone")),
        lambda: refusal(WebGymError("internal error in the server: KeyError()")),
        lambda: web.HTTPNotFound(text="<h1>404</h1>", content_type="text/html"),
        lambda: web.HTTPInternalServerError(text="Internal Server Error"),
        lambda: web.HTTPFound("/login"),
    ],
    ids=["proxy", "launch", "crash", "worker", "internal", "404", "500", "302"],
)
async def test_a_browser_that_cannot_be_had_for_a_while_is_waited_for(
    tmp_path: Path, world: World, refuses: Callable[[], web.HTTPException]
) -> None:
    """Nothing has begun: no attempt is recorded for it."""
    run = await half_of(world, world.config(tmp_path, 16, retries=0), tmp_path / "run")
    world.browsers.refuses, world.model.may = refuses, math.inf
    await until(lambda: run.progress.browser_problem)
    assert "wait for a browser" in " ".join(run.progress.warnings)
    await asyncio.sleep(0.3)
    world.browsers.refuses = None
    await run.end()
    assert outcomes(tmp_path / "run") == {"success": 16}
    assert not run.progress.browser_problem


async def test_a_token_that_is_refused_stops_the_run_at_once(tmp_path: Path, world: World) -> None:
    run = await half_of(world, world.config(tmp_path, 16), tmp_path / "run")
    world.browsers.refuses = lambda: refusal(Unauthorized("the token is invalid"))
    world.model.may = math.inf
    with pytest.raises(BaseExceptionGroup) as stopped:
        await run.end()
    assert stopped.group_contains(Unauthorized)
    assert not run.progress.browser_problem


async def test_a_browser_that_cannot_be_given_back_costs_no_attempt(tmp_path: Path, world: World) -> None:
    """Its lease expires by itself, whatever the server answers."""

    async def fails(_: web.Request) -> web.Response:
        raise refusal(WebGymError("internal error in the server: KeyError()"))

    world.browsers._close = fails  # type: ignore[assignment, method-assign]
    await world.restart("browsers")
    await Run().start(world.config(tmp_path, 4), tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 4}


async def test_a_server_that_falls_silent_is_told(
    tmp_path: Path, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.server.client._SLOW_SECONDS", 0.3)
    steps = itertools.count()
    world.browsers._step_seconds = lambda: 0.0 if next(steps) < 12 else 1000.0
    run = Run().start(world.config(tmp_path, 8), tmp_path / "run")
    silent = f"the browser server {world.url('browsers')} leaves 4 calls without an answer, step for"
    await until(lambda: silent in " ".join(run.progress.warnings))
    await run.stop()
    assert not run.progress.problem()


async def test_a_wait_for_a_slot_is_not_told_as_a_silent_server(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.server.client._SLOW_SECONDS", 0.1)
    browsers = StandInBrowsers(open_seconds=0.8)
    async with (
        serving_app(browsers.app()) as port,
        BrowserClient(f"http://127.0.0.1:{port}", token=TOKEN) as client,
    ):
        opening = asyncio.create_task(client.open(SessionOptions(wait_seconds=60)))
        while not opening.done():
            assert not client.problem
            await asyncio.sleep(0.01)
        opening = asyncio.create_task(client.open(SessionOptions(wait_seconds=0)))
        await until(lambda: "1 call without an answer, allocate for" in client.problem)
        await opening
        assert not client.problem


async def test_a_server_whose_silence_outlasts_the_patience_is_asked_once_more() -> None:
    browsers = StandInPages()
    open_now, answers = browsers.open, iter([ServerUnreachable("no answer"), None])

    async def silent(options: Any = None) -> Any:
        if error := next(answers):
            await asyncio.sleep(0.2)
            raise error
        return await open_now(options)

    browsers.open = silent  # type: ignore[method-assign]
    config = CollectorConfig(server_patience_seconds=0.1, server_retry_seconds=0.01)
    told: list[str] = []
    await patiently(lambda: browsers.open(SessionOptions()), config, tell=told.append)
    assert told == ["no answer", ""]


async def test_a_resumed_collector_gives_back_the_leases_of_the_one_that_was_killed(tmp_path: Path) -> None:
    class Client:
        def __init__(self) -> None:
            self.grants: list[SessionGrant] = []
            self.given_back: list[SessionGrant] = []

        async def open(self, options: Any = None) -> None:
            self.grants.append(SessionGrant(f"s-{len(self.grants)}", "secret", 1, "", 60.0))

        async def give_back(self, grant: SessionGrant) -> None:
            self.given_back.append(grant)

    killed, resumed, file = Client(), Client(), tmp_path / ".leases"
    kept = KeptLeases(cast("BrowserClient", killed), file)
    await kept.open()
    await kept.open()
    assert file.stat().st_mode & 0o077 == 0
    async with KeptLeases(cast("BrowserClient", resumed), file):
        assert sorted(grant.session_id for grant in resumed.given_back) == ["s-0", "s-1"]
    assert not file.exists()
    file.write_bytes(b"[{")  # its writing was interrupted
    async with KeptLeases(cast("BrowserClient", resumed), file):
        assert len(resumed.given_back) == 2


async def test_a_browser_that_does_not_come_back_stops_the_run_and_uses_up_no_sample(
    tmp_path: Path, world: World
) -> None:
    config = world.config(tmp_path, 16, {"server_patience_seconds": 0.3}, retries=0)
    run = await half_of(world, config, tmp_path / "run")
    world.browsers.refuses = lambda: refusal(BrowserLaunchFailed("chromium did not start"))
    world.model.may = math.inf
    with pytest.raises(BaseExceptionGroup) as stopped:
        await run.end()
    assert stopped.group_contains(BrowserLaunchFailed)
    assert outcomes(tmp_path / "run").keys() <= {
        "success",
        "cancelled",
        "judge_error",
    }  # stopped while judged
    world.browsers.refuses = None
    await Run().start(None, tmp_path / "run").end()
    assert outcomes(tmp_path / "run")["success"] == 16


async def test_an_offline_web_that_is_away_is_waited_for_and_uses_up_no_sample(
    tmp_path: Path, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter([False, False, *[True] * 5])

    async def state(_: str, host: str) -> None:
        assert host == "a.test"
        if not next(answers, False):
            raise SitesError("the offline web does not respond")

    reach = Attempt.reach_site_state

    async def reach_ours(self: Attempt) -> None:
        planned = SimpleNamespace(task=SimpleNamespace(truth=SimpleNamespace(host="a.test")))
        context = SimpleNamespace(site_state=SimpleNamespace(state=state))
        ours: Any = SimpleNamespace(planned=planned, _context=context, visitor=self.visitor)
        await reach(ours)

    monkeypatch.setattr(Attempt, "reach_site_state", reach_ours)
    patience = {"server_patience_seconds": 0.2, "server_retry_seconds": 0.01, "sessions": 1}
    with pytest.raises(BaseExceptionGroup) as stopped:
        await Run().start(world.config(tmp_path, 8, patience, retries=0), tmp_path / "run").end()
    assert stopped.group_contains(SitesError)
    assert outcomes(tmp_path / "run") == {"success": 5}
    monkeypatch.undo()
    await Run().start(None, tmp_path / "run").end()
    assert outcomes(tmp_path / "run") == {"success": 8}


async def test_a_run_with_more_sessions_than_slots_waits_for_its_own(tmp_path: Path, world: World) -> None:
    world.browsers.slots = 1
    world.model._reply_seconds = lambda: 0.05  # an attempt takes 0.15 s
    config = world.config(tmp_path, 3, {"server_patience_seconds": 0.1, "server_retry_seconds": 0.01})
    told: list[str] = []
    await Run().start(config, tmp_path / "run", tell=told.append).end()
    assert outcomes(tmp_path / "run") == {"success": 3}
    assert "the server has 1 slots so far, for 3 sessions: some will wait" in told


async def test_slots_that_others_hold_are_waited_for_for_as_long_as_a_server(
    tmp_path: Path, world: World
) -> None:
    world.browsers.slots = 0
    config = world.config(tmp_path, 1, {"server_patience_seconds": 0.1, "server_retry_seconds": 0.01})
    with pytest.raises(BaseExceptionGroup) as stopped:
        await Run().start(config, tmp_path / "run").end()
    assert stopped.group_contains(NoCapacity)


async def test_a_disk_that_is_full_stops_the_run_and_once_freed_it_goes_on(
    tmp_path: Path, world: World
) -> None:
    with small_disk(16 * 1024 * 1024) as disk:
        if not disk.can_be_filled:
            pytest.skip(f"{disk.why_not}; test_store fills a file instead")
        path = disk.path / "run"
        world.model.may = HALF
        run = Run().start(world.config(tmp_path, 12), path)
        await until_half(run, world)
        await asyncio.to_thread(disk.fill)
        world.model.may = math.inf
        with pytest.raises((StoreFull, BaseExceptionGroup)) as stopped:
            await run.end()
        assert "No space left" in _whole(stopped.value) or "free some space" in _whole(stopped.value)
        whole = dict(RunReader(path).attempts)
        assert 6 <= len(whole) < 12
        disk.clear()
        await Run().start(None, path).end()
        assert {key: RunReader(path).attempts[key] for key in whole} == whole
        ended = outcomes(path)
        assert ended["success"] == 12
        assert ended.keys() <= {"success", "cancelled"}  # the records of what was in flight may still fit


async def test_a_run_whose_folder_is_deleted_says_so(tmp_path: Path, world: World) -> None:
    """The summary, which cannot be written either, is not what stopped it."""
    run = await half_of(world, world.config(tmp_path, 16), tmp_path / "run")
    # Renamed first: in a folder that is being emptied, a writer could put something new meanwhile.
    (tmp_path / "run").rename(tmp_path / "deleted")
    await asyncio.to_thread(shutil.rmtree, tmp_path / "deleted")
    world.model.may = math.inf
    with pytest.raises(BaseExceptionGroup) as stopped:
        await run.end()
    assert "cannot continue writing a" in _whole(stopped.value)
    assert "summary" not in _whole(stopped.value)


def _whole(error: BaseException) -> str:
    """What an error says, with all that it is a group of."""
    parts = error.exceptions if isinstance(error, BaseExceptionGroup) else ()
    return " ".join([str(error), *map(_whole, parts)])


# --- kill -9 --------------------------------------------------------------------------------------------


@asynccontextmanager
async def collecting(path: Path, torn: int = 0) -> AsyncIterator[asyncio.subprocess.Process]:
    """A collector as a process of its own, which stops in the midst of writing one of its records if it is
    told; killed at the end of the block."""
    script = Path(__file__).with_name("collects_until_killed.py")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(["src", ".", os.environ.get("PYTHONPATH", "")])}
    process = await asyncio.create_subprocess_exec(
        sys.executable, script, path / "run", path / "config.json", str(torn), env=environment
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


async def hold(world: World) -> None:
    """Hold an attempt while it is opened, one that acts, one that thinks, and of the others one verdict."""
    opens, verdict = world.browsers._open, world.judge._verdict

    async def opens_six(request: Any) -> Any:
        if world.browsers.opened == 6:
            await asyncio.Event().wait()
        return await opens(request)

    async def two_verdicts(request: Any) -> Any:
        if world.judge.asked == 2:
            world.judge.lets.clear()
        return await verdict(request)

    world.browsers._open = opens_six  # type: ignore[assignment, method-assign]
    world.judge._verdict = two_verdicts  # type: ignore[assignment, method-assign]
    for name in ("browsers", "judge"):
        await world.restart(name)
    acts, replies = itertools.count(), itertools.count()
    world.browsers._step_seconds = lambda: 0.0 if next(acts) else 1000.0
    world.model._reply_seconds = lambda: 0.0 if next(replies) else 1000.0
    world.browsers._open, world.judge._verdict = opens, verdict  # type: ignore[method-assign]


async def let_go(world: World) -> None:
    world.judge.lets.set()
    world.model._reply_seconds = world.browsers._step_seconds = lambda: 0.0
    await world.restart("browsers")


def states(run: Path) -> dict[str, int]:
    """How many attempts a collector says it has in each state, and how many wait for a judge's place."""
    feed = read_feed(run) if run.exists() else None
    if feed is None:
        return {}
    found = {state: count for state, count in feed["states"].items() if count}
    return found | {f"waiting for a {kind}": queue["waiting"] for kind, queue in feed["queues"].items()}


async def test_a_collector_that_is_killed_with_attempts_in_every_state_loses_only_what_was_in_flight(
    tmp_path: Path, world: World
) -> None:
    """Opening, thinking, acting, being judged, waiting for a judge, and half written."""
    config = world.config(tmp_path, 7, {"sessions": 7, "judges": 1})
    (tmp_path / "config.json").write_text(config.model_dump_json())
    await hold(world)
    run = tmp_path / "run"
    async with collecting(tmp_path, torn=2):
        every = {"opening": 1, "thinking": 1, "acting": 1, "judging": 3, "waiting for a judge": 1}
        await until(lambda: every.items() <= states(run).items())
        await until(lambda: not (run / "trajectories/00000.jsonl").read_bytes().endswith(b"\n"))
    [before] = RunReader(run).attempts
    await let_go(world)
    await Run().start(None, run).end()
    assert outcomes(run) == {"success": 7}
    assert before in RunReader(run).attempts


@pytest.mark.slow
@pytest.mark.timeout(300)
async def test_hundreds_of_episodes_with_random_kills_come_to_exactly_what_was_asked_for(
    tmp_path: Path, world: World
) -> None:
    rng = random.Random(7)
    world.browsers._step_seconds = lambda: rng.uniform(0, 0.05)
    config = world.config(tmp_path, 150, {"sessions": 12, "schedule": "async"}, samples=2)
    (tmp_path / "config.json").write_text(config.model_dump_json())
    for _ in range(6):
        goal = len(books_so_far(tmp_path / "run")) + rng.randrange(10, 40)
        async with collecting(tmp_path):
            await until(partial(has_come_to, tmp_path / "run", goal))
            await asyncio.sleep(rng.uniform(0, 0.2))
    async with asyncio.timeout(4 * SECONDS), collecting(tmp_path) as last:
        assert await last.wait() == 0
    ended = books(tmp_path / "run")
    assert {each.outcome.value for each in ended} <= {"success", "cancelled"}
    samples = [(e.episode.task_id, e.episode.sample) for e in ended if e.outcome == "success"]
    assert len(samples) == len(set(samples)) == 300


def has_come_to(run: Path, goal: int) -> bool:
    return len(books_so_far(run)) >= goal


def books_so_far(run: Path) -> set[str]:
    try:
        return set(RunReader(run).attempts)
    except WebGymError:  # it is not there yet
        return set()
