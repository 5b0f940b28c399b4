"""The main job with everything real: offline web, server, Chromium, agent, judge, store."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from functools import cache
from pathlib import Path
from typing import Any

import psutil
import pytest
import pytest_asyncio
from pydantic import SecretStr
from tests.conftest import command_of

from webgym.agent.config import AgentConfig
from webgym.agent.policy import PolicyInput, PolicySession
from webgym.agent.scripted import ScriptedPolicy
from webgym.core.errors import ConfigError, RunFolderError, SitesError, TaskFileError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Reply, Trajectory
from webgym.core.websites import host_of
from webgym.llm.config import ChatConfig, Sampling
from webgym.offline.app import serving
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.results.summary import Summary
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.progress import Progress
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.run.collect import Show, collect, print_on_stderr, resume
from webgym.run.config import (
    PolicyChoice,
    RunConfig,
    Secrets,
    ServerChoice,
    TaskChoice,
    read_config,
    resolved,
)
from webgym.run.services import _reached, services
from webgym.store.runs import RunReader
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw
from webgym.testing.solutions import unexpected

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]

SMALL = SitesConfig(collection="small", per_family=3, latency=0)
"""What is drawn in no time: most tests are about attempts, whatever the pages are."""
LARGE = SitesConfig(per_family=3, latency=0, slow_seconds=0.5)
"""Some of these misbehave."""


def config(file: Path | None = None, **changes: Any) -> RunConfig:
    settings: dict[str, Any] = {
        "sites": SMALL,
        "tasks": TaskChoice(file=file, split="all"),
        "collector": CollectorConfig(sessions=3),
    }
    return RunConfig(**settings | changes)


Served = tuple[ServerChoice, Secrets]


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def served() -> AsyncIterator[Served]:
    """Browsers and small websites for those runs that need not start their own."""
    async with services(config(), Secrets()) as reached:
        yield reached


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def served_large() -> AsyncIterator[Served]:
    """Browsers and large websites."""
    async with services(config(sites=LARGE), Secrets()) as reached:
        yield reached


async def collect_there(
    served: Served, settings: RunConfig, out: Path, *, show: Show | None = None
) -> Summary:
    where, secrets = served
    return await collect(settings.model_copy(update={"server": where}), out, secrets=secrets, show=show)


@cache
def tasks_of(sites: SitesConfig) -> dict[str, list[Task]]:
    """All tasks by the behaviour of their website; making them takes as long as some attempts."""
    web = OfflineWeb(sites.seed, per_family=sites.per_family, collection=sites.collection)
    found: dict[str, list[Task]] = {}
    for host, spec in web.specs.items():
        found.setdefault(spec.behaviour, []).extend(web.tasks_of(host))
    return found


def task_file(
    path: Path, count: int, sites: SitesConfig = SMALL, *, behaviour: str = "good", most_moves: int = 6
) -> Path:
    """Tasks whose solutions are short, where it does not matter how long they are."""
    tasks = [
        task
        for task in tasks_of(sites)[behaviour]
        if task.truth is None or len(task.truth.moves) <= most_moves
    ]
    file = path / "tasks.jsonl"
    write_tasks(file, draw(tasks, count, 3))
    return file


def add_up(run: Path) -> list[Trajectory]:
    """The run's trajectories, after its books were checked."""
    reader = RunReader(run)
    trajectories = list(reader.trajectories())
    summary = reader.summary
    assert summary is not None
    outcomes = Counter(trajectory.outcome.value for trajectory in trajectories)
    assert summary["attempts"] == len(trajectories) == sum(summary["outcomes"].values())
    assert summary["outcomes"] == {outcome.value: outcomes[outcome.value] for outcome in Outcome}
    assert len({each.episode.attempt_id for each in trajectories}) == len(trajectories)
    assert {each.episode.task_id for each in trajectories} == set(reader.tasks)
    assert summary["steps"] == sum(len(each.episode.steps) for each in trajectories)
    for trajectory in trajectories:
        for seen in trajectory.episode.observations:
            assert reader.image(seen.screenshot).startswith(b"\x89PNG")
    return trajectories


async def test_solutions_succeed_by_marks(tmp_path: Path, served_large: Served) -> None:
    """``test_solvable.py`` has the like by coordinates, of every family."""
    file = task_file(tmp_path, 2, LARGE)
    await collect_there(
        served_large, config(file, sites=LARGE, agent=AgentConfig(mode="marks")), tmp_path / "run"
    )
    trajectories = add_up(tmp_path / "run")
    assert [each.outcome for each in trajectories] == [Outcome.SUCCESS] * 2
    assert not list(unexpected(RunReader(tmp_path / "run").tasks, trajectories))
    for each in trajectories:
        assert each.verdict is not None
        assert each.verdict.reward == 1


async def test_websites_that_misbehave_end_as_they_should(tmp_path: Path, served_large: Served) -> None:
    web = OfflineWeb(LARGE.seed, per_family=LARGE.per_family)
    picked = []
    ends = {
        "blocks": "blocked",
        "down": "environment_error",
        "nags": "success",
        "forgets": "judge_error",
        "slow": "success",
    }
    for behaviour, end in ends.items():
        host = next(host for host, spec in web.specs.items() if spec.behaviour == behaviour)
        fitting = [task for task in web.tasks_of(host) if task.truth and task.truth.expects == end]
        picked.append(min(fitting, key=lambda task: len(task.truth.moves) if task.truth else 0))
    write_tasks(tmp_path / "tasks.jsonl", picked)
    kept = HealthConfig(file=tmp_path / "sites.jsonl")
    settings = config(tmp_path / "tasks.jsonl", sites=LARGE, retries=0, health=kept)
    await collect_there(served_large, settings, tmp_path / "run")
    trajectories = add_up(tmp_path / "run")
    assert not list(unexpected(RunReader(tmp_path / "run").tasks, trajectories))
    summary = RunReader(tmp_path / "run").summary
    assert summary is not None
    assert summary["blocked_hosts"] == {host_of(picked[0].website): 1}
    assert set(SiteHealth(kept).blocked()) == {host_of(picked[0].website)}
    assert {each.outcome for each in trajectories} == {
        Outcome.BLOCKED,
        Outcome.ENVIRONMENT_ERROR,
        Outcome.SUCCESS,
        Outcome.JUDGE_ERROR,
    }


async def test_an_error_is_attempted_again_and_both_are_counted(tmp_path: Path, served_large: Served) -> None:
    file = task_file(tmp_path, 1, LARGE, behaviour="down")
    summary = await collect_there(served_large, config(file, sites=LARGE, retries=2), tmp_path / "run")
    assert summary["outcomes"]["environment_error"] == summary["attempts"] == 3
    assert summary["success_rate"]["overall"] is None
    assert [each.episode.retry for each in add_up(tmp_path / "run")] == [0, 1, 2]


async def test_every_mistake_is_data(tmp_path: Path, served: Served) -> None:
    file = task_file(tmp_path, 14, most_moves=5)
    short = AttemptConfig(budget_easy=6, budget_medium=6, budget_hard=6)
    mistaken = config(file, policy=PolicyChoice(mistakes=1.0), retries=0, attempt=short)
    await collect_there(served, mistaken, tmp_path / "run")
    trajectories = add_up(tmp_path / "run")
    by_mistake: dict[str, Counter[Outcome]] = {}
    for each in trajectories:
        mistake = each.episode.steps[0].reply.sampling["mistake"] if each.episode.steps else "raises"
        by_mistake.setdefault(mistake, Counter())[each.outcome] += 1
    for mistake in ("wrong_answer", "unseen_answer", "gives_up"):
        assert set(by_mistake.get(mistake, {Outcome.FAILURE: 0})) == {Outcome.FAILURE}
    assert set(by_mistake.get("dawdle", {Outcome.TRUNCATED: 0})) == {Outcome.TRUNCATED}
    assert set(by_mistake.get("raises", {Outcome.POLICY_ERROR: 0})) == {Outcome.POLICY_ERROR}
    assert len(by_mistake) >= 4


async def test_a_browser_that_is_killed_costs_its_attempt_and_nothing_else(tmp_path: Path) -> None:
    file = task_file(tmp_path, 4)
    others = {child.pid for child in psutil.Process().children()}

    class Killer:
        """Kills one browser once three steps were taken."""

        def __init__(self, progress: Progress) -> None:
            self.progress = progress

        async def __aenter__(self) -> None:
            self.task = asyncio.create_task(self.kill())

        async def kill(self) -> None:
            while self.progress.steps < 3:
                await asyncio.sleep(0.01)
            children = [child for child in psutil.Process().children() if child.pid not in others]
            browsers = [
                child for child in children if any("--headless" in part for part in command_of(child))
            ]
            browsers[0].kill()

        async def __aexit__(self, *_: object) -> None:
            await self.task

    await collect(config(file, retries=2), tmp_path / "run", show=Killer)
    trajectories = add_up(tmp_path / "run")
    outcomes = Counter(each.outcome for each in trajectories)
    assert outcomes[Outcome.SUCCESS] == 4
    assert outcomes[Outcome.ENVIRONMENT_ERROR] <= 1
    assert outcomes.total() == 4 + outcomes[Outcome.ENVIRONMENT_ERROR]
    lost = [each for each in trajectories if each.outcome is Outcome.ENVIRONMENT_ERROR]
    assert all(each.episode.failure and "browser" in each.episode.failure.code for each in lost)


async def test_a_cancelled_run_records_what_was_in_flight_and_goes_on(tmp_path: Path) -> None:
    file = task_file(tmp_path, 5)
    started = asyncio.Event()

    class Watch:
        def __init__(self, progress: Progress) -> None:
            self.progress = progress

        async def __aenter__(self) -> None:
            self.task = asyncio.create_task(self.watch())

        async def watch(self) -> None:
            states = self.progress.states
            while not self.progress.outcomes or not states["acting"] + states["thinking"]:
                await asyncio.sleep(0.01)
            started.set()

        async def __aexit__(self, *_: object) -> None:
            await self.task

    run = asyncio.create_task(collect(config(file), tmp_path / "run", show=Watch))
    await started.wait()
    run.cancel()
    with pytest.raises(asyncio.CancelledError):
        await run
    reader = RunReader(tmp_path / "run")
    assert reader.summary is not None
    before = dict(reader.summary["outcomes"])
    assert before["cancelled"] >= 1
    await resume(tmp_path / "run")
    trajectories = add_up(tmp_path / "run")
    outcomes = Counter(each.outcome for each in trajectories)
    assert outcomes[Outcome.SUCCESS] == 5
    assert outcomes[Outcome.CANCELLED] == before["cancelled"]


async def test_the_same_seed_makes_the_same_decisions(tmp_path: Path, served: Served) -> None:
    file = task_file(tmp_path, 3)
    made = []
    for name in ("a", "b"):
        await collect_there(
            served, config(file, policy=PolicyChoice(mistakes=0.5), retries=0), tmp_path / name
        )
        each = {
            trajectory.episode.task_id: [step.action for step in trajectory.episode.steps]
            for trajectory in RunReader(tmp_path / name).trajectories()
        }
        made.append(each)
    assert made[0] == made[1]


async def test_the_settings_are_all_in_the_run_and_no_secret_is(tmp_path: Path) -> None:
    file = task_file(tmp_path, 1, LARGE)
    alone = CollectorConfig(sessions=1)
    settings = config(file, sites=LARGE, attempt=AttemptConfig(budget_easy=7), collector=alone)
    await collect(settings, tmp_path / "run")
    held, run_id = read_config(RunReader(tmp_path / "run"))
    agent = AgentConfig(profile="generic", mode="coordinates")  # what the defaults came to
    assert held == settings.model_copy(update={"agent": agent})
    assert run_id
    written = (tmp_path / "run" / "config.yaml").read_text()
    assert "token" not in written.replace("max_tokens", "").replace("request_tokens", "")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["attempts"] == 1


async def test_a_run_that_cannot_start_says_so_before_it_makes_attempts(tmp_path: Path) -> None:
    with pytest.raises(TaskFileError):
        await collect(config(tmp_path / "none.jsonl"), tmp_path / "a")
    file = task_file(tmp_path, 1)
    elsewhere = ServerChoice(url="http://127.0.0.1:9", sites_url="http://127.0.0.1:9")
    with pytest.raises(ConfigError, match="token"):
        await collect(config(file, server=elsewhere), tmp_path / "b")
    with pytest.raises(ConfigError, match="elsewhere"):
        await collect(config(file, server=ServerChoice(url="http://127.0.0.1:9")), tmp_path / "c")
    with pytest.raises(RunFolderError):
        await resume(tmp_path / "nowhere")


async def test_an_oracle_that_nobody_named_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = TaskChoice(file=tmp_path / "none.jsonl")
    note = "no policy is named: the scripted policy is an oracle: it plays known solutions and uses no model"
    named = RunConfig(tasks=missing, policy=PolicyChoice(name="scripted"))
    for settings, tell, said in (
        (RunConfig(tasks=missing), print_on_stderr, f"webgym: {note}\n"),
        (RunConfig(tasks=missing), None, ""),
        (named, print_on_stderr, ""),
    ):
        with pytest.raises(TaskFileError):
            await collect(settings, tmp_path / "run", tell=tell)
        assert capsys.readouterr().err == said


async def test_a_resumed_run_waits_for_services_that_it_has_reached_before() -> None:
    told: list[str] = []
    patience = CollectorConfig(server_retry_seconds=0.01)

    def call() -> Callable[[], Awaitable[int]]:
        answers = iter([SitesError("no answer"), None])

        async def answer() -> int:
            if error := next(answers):
                raise error
            return 3

        return answer

    assert await _reached(call(), (patience, told.append)) == 3
    assert told == ["waiting: no answer"]
    with pytest.raises(SitesError):
        await _reached(call(), (None, told.append))


async def test_several_samples_with_one_seed_are_refused(tmp_path: Path) -> None:
    fixed = Sampling(extra_body={"seed": 7})
    chat = ChatConfig(base_url="http://127.0.0.1:9/v1", model="tiny", sampling=fixed)
    asked = RunConfig(samples=4, policy=PolicyChoice(chat=chat))
    with pytest.raises(ConfigError, match="fixed seed") as caught:
        await collect(asked, tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert resolved(asked.model_copy(update={"samples": 1}), None, None).policy.chat is not None


async def test_every_attempt_may_be_late_at_any_moment(tmp_path: Path, served: Served) -> None:
    """The grace period is over at once, whatever the attempts are doing: opening, acting, closing."""
    file = task_file(tmp_path, 6)
    late = CollectorConfig(sessions=3, straggler_share=0.1, straggler_seconds=0.0)
    await collect_there(served, config(file, collector=late), tmp_path / "run")
    outcomes = Counter(each.outcome for each in add_up(tmp_path / "run"))
    assert outcomes[Outcome.SUCCESS] >= 1
    assert outcomes[Outcome.SUCCESS] + outcomes[Outcome.CANCELLED] == outcomes.total() == 6


class Held(ScriptedPolicy):
    """Plays solutions. All attempts wait in the middle, once, until they are let."""

    def __init__(self, attempts: int) -> None:
        super().__init__()
        self.lets = asyncio.Event()
        self.waiting = asyncio.Barrier(attempts + 1)

    def begin(self, task: Task, seed: int) -> PolicySession:  # type: ignore[override]
        return HeldPlayer(super().begin(task, seed), self)


class HeldPlayer:
    def __init__(self, player: PolicySession, policy: Held) -> None:
        self._player, self._policy = player, policy

    async def reply(self, turn: PolicyInput) -> Reply:
        if turn.index == 1 and not self._policy.lets.is_set():
            await self._policy.waiting.wait()
            await self._policy.lets.wait()
        return await self._player.reply(turn)


@pytest.mark.slow
async def test_the_offline_web_away_under_open_pages_costs_attempts_but_no_reward(tmp_path: Path) -> None:
    """Its server is really stopped while every page is open, and comes back."""
    file, policy, progress = task_file(tmp_path, 3, LARGE), Held(3), Progress(total=0)
    secrets = Secrets(sites_token=SecretStr("the-token-of-the-offline-web"))
    served = LARGE.model_copy(update={"token": secrets.sites_token})

    @asynccontextmanager
    async def show(shown: Progress) -> AsyncIterator[None]:
        nonlocal progress
        progress = shown
        yield

    async with AsyncExitStack() as away:
        sites = await away.enter_async_context(serving(served))
        settings = config(
            file,
            sites=LARGE,
            server=ServerChoice(sites_url=sites.url),
            retries=1000,
        )
        run = asyncio.create_task(
            collect(settings, tmp_path / "run", policy=policy, secrets=secrets, show=show)
        )
        async with asyncio.timeout(60):
            await policy.waiting.wait()
    policy.lets.set()
    async with asyncio.timeout(60):
        while progress.outcomes[Outcome.ENVIRONMENT_ERROR] < 3 and not run.done():
            await asyncio.sleep(0.01)
    again = served.model_copy(update={"port": int(sites.address.rpartition(":")[2])})
    async with serving(again), asyncio.timeout(90):
        await run
    outcomes = Counter(each.outcome for each in add_up(tmp_path / "run"))
    assert outcomes.keys() == {Outcome.SUCCESS, Outcome.ENVIRONMENT_ERROR}
    assert outcomes[Outcome.SUCCESS] == 3
    first = [each for each in add_up(tmp_path / "run") if each.episode.retry == 0 and each.episode.steps]
    assert Outcome.ENVIRONMENT_ERROR in {each.outcome for each in first}
