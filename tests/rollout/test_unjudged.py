"""Attempts without a verdict are judged again by themselves, and what cannot be read bends no rate."""

from __future__ import annotations

import asyncio
import random
import re
from collections import Counter, defaultdict
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import httpx
import msgspec
import numpy as np
import pytest
from tests.judge.scenes import PICTURES, TASK, episode, pictures
from tests.llm.endpoint import serve
from tests.report.conftest import asking

from webgym.core.errors import JudgeError, StoreError
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS, FactGroup, Level, Rubric, Task
from webgym.core.trajectory import Episode, Trajectory
from webgym.core.verdict import Judgement, Verdict
from webgym.judge.base import Judge, Pictures
from webgym.judge.config import STAGES, JudgeConfig
from webgym.judge.rubric import RubricJudge
from webgym.llm.client import ChatClient
from webgym.llm.completion import Completion
from webgym.llm.config import ChatConfig, Sampling
from webgym.report.live import view_app
from webgym.results.summary import Summary, digest_of, summarise
from webgym.rollout.attempt import AttemptContext
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.judging import judge_again, judge_episode
from webgym.rollout.progress import Progress
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.store.runs import RunReader, RunWriter

FACTS: dict[Level, int] = {"easy": 2, "medium": 5, "hard": 9}
PER_LEVEL = 16
CHAT = ChatConfig(base_url="http://127.0.0.1:1/v1", model="m")


class Noisy:
    """A judge model that knows what holds; a share of its replies, at random, holds no verdict."""

    def __init__(self, unreadable: float) -> None:
        self.unreadable = unreadable
        self.asked: Counter[str] = Counter()

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        system, content = messages[0]["content"], messages[1]["content"]
        text = content if isinstance(content, str) else content[0]["text"]
        code = re.findall(r"<<task ([0-9a-f]+)>>", text)[0]
        self.asked[code] += 1
        drawn = random.Random(f"{code}/{self.asked[code]}").random()
        said = "It is hard to say." if drawn < self.unreadable else self.verdict(system, text, code)
        return Completion(said, "stop", 0, 0, 0.0, "m")

    def verdict(self, system: str, text: str, code: str) -> str:
        if "SCREENSHOT 1" in system:
            count = system.count("YES or NO")
            return "\n".join(f"SCREENSHOT {number} {code}: YES" for number in range(1, count + 1))
        checked = re.findall(rf"<<(?:fact|answer) {code}>>\n(.*)", text)[0]
        return f"VERDICT {code}: {'NOT SUCCESS' if 'false' in checked else 'SUCCESS'}"


def made(level: Level, number: int) -> tuple[Task, Episode, bool]:
    """An attempt: every second one succeeds, the others fail in one fact or in their answer."""
    count, rng = FACTS[level], random.Random(f"{level}/{number}")
    succeeds = number % 2 == 0
    wrong = None if succeeds else rng.randrange(count + 1)
    facts = tuple(f"{level} {number} {place} is {str(place != wrong).lower()}" for place in range(count))
    task_id = f"{level}/{number}"
    task = msgspec.structs.replace(TASK, id=task_id, rubric=Rubric((FactGroup(1, "all", facts),)))
    answer = f"{level} {number} is {str(wrong != count).lower()}"
    named = {"attempt_id": f"{task_id}#0.0", "task_id": task_id}
    return task, episode(answer=answer, **named), succeeds


def context(store: RunWriter, progress: Progress) -> AttemptContext[RunWriter]:
    nothing = cast(Any, None)
    return AttemptContext(
        client=nothing,
        agent=nothing,
        store=store,
        config=AttemptConfig(),
        progress=progress,
        site_state=None,
        seed=0,
    )


async def judged(
    path: Path, judge: Judge, config: CollectorConfig, per_level: int
) -> tuple[Summary, Summary]:
    """A run's figures before and after its attempts without a verdict are judged again."""
    attempts = [made(level, number) for level in LEVELS for number in range(per_level)]
    tasks = {task.id: task for task, _, _ in attempts}
    progress = Progress(total=len(attempts))
    async with await RunWriter.create(path, {}, list(tasks.values())) as store:
        for name, data in PICTURES.items():
            await store.put_image(name, data)
        for task, done, _ in attempts:
            found = await judge_episode(judge, task, done, pictures, 60)
            await store.append(Trajectory(done, found.outcome, found.verdict, found.failure))
            progress.ended(Trajectory(done, found.outcome))
        before = summarise(RunReader(path).trajectories(), list(tasks.values()))
        await judge_again(context(store, progress), tasks.values(), judge, pictures, config)
    after = summarise(RunReader(path).trajectories(), list(tasks.values()))
    assert {outcome.value: progress.outcomes[outcome] for outcome in Outcome} == after["outcomes"]
    return before, after


def rubric(unreadable: float, tries: int) -> RubricJudge:
    config = JudgeConfig(chat=CHAT, tries=tries)
    model = Noisy(unreadable)
    return RubricJudge(config, dict.fromkeys(STAGES, model))


@pytest.mark.parametrize(
    ("behaviour", "told"), [("silent", "/v1 is silent for 1 s"), ("html", "/v1 sent a web page: <!doctype")]
)
async def test_a_judge_without_a_verdict_in_time_names_what_its_endpoint_did(
    behaviour: str, told: str
) -> None:
    async with serve() as endpoint:
        chat = ChatConfig(base_url=endpoint.url("changing"), model="tiny-1")
        async with ChatClient(chat) as client:
            await client.complete([{"role": "user", "content": "Hello"}])
            endpoint.behaviour = behaviour
            judge = RubricJudge(JudgeConfig(chat=chat), dict.fromkeys(STAGES, client))
            found = await judge_episode(judge, TASK, episode(), pictures, 1)
    assert found.failure is not None
    assert found.failure.message.startswith("no verdict within 1 s: the endpoint http://127.0.0.1:")
    assert told in found.failure.message


class Faulty:
    name = "faulty"

    def __init__(self, said: Verdict | BaseException | None) -> None:
        self.said = said

    async def judge(self, task: Task, made: Episode, shots: Pictures) -> Verdict:
        if isinstance(self.said, BaseException):
            raise self.said
        if self.said is None:
            await asyncio.Event().wait()
        return cast(Verdict, self.said)


@pytest.mark.parametrize(
    "said",
    [
        asyncio.CancelledError(),  # nobody cancelled the run: a task of the judge's own was
        Verdict("faulty", 1, (), cast(Judgement, False)),
        Verdict("faulty", 1, (), Judgement(cast(bool, np.bool_(False)), "")),
        Verdict("faulty", 1, (), Judgement(False, ""), score=cast(float, "1")),
    ],
)
async def test_a_judge_that_cancels_itself_or_returns_what_no_record_can_hold_gives_no_verdict(
    said: Verdict | BaseException,
) -> None:
    found = await judge_episode(Faulty(said), TASK, episode(), pictures, 1)
    assert (found.outcome, found.verdict) == (Outcome.JUDGE_ERROR, None)


async def test_judging_can_be_cancelled() -> None:
    judging = asyncio.create_task(judge_episode(Faulty(None), TASK, episode(), pictures, 60))
    await asyncio.sleep(0.01)
    judging.cancel()
    with pytest.raises(asyncio.CancelledError):
        await judging


@pytest.mark.parametrize("tries", [2, 3])
async def test_unreadable_replies_do_not_bend_the_success_rate(tmp_path: Path, tries: int) -> None:
    """One reply in ten is unreadable: rates by difficulty are what they are, and nothing is left unjudged."""
    before, after = await judged(tmp_path / "run", rubric(0.1, tries), CollectorConfig(), PER_LEVEL)
    left = before["outcomes"]["judge_error"]
    assert (left > 0) == (tries == 2)  # 3 tries leave one in a hundred or fewer
    assert after["outcomes"]["judge_error"] == 0
    assert after["success_rate"] == dict.fromkeys(("overall", *LEVELS), 0.5)
    for task, done, succeeds in (made(level, number) for level in LEVELS for number in range(PER_LEVEL)):
        trajectory = RunReader(tmp_path / "run").trajectory(done.attempt_id)
        assert (trajectory.outcome is Outcome.SUCCESS) == succeeds, task.id


async def test_what_would_be_left_without_tries_bends_it(tmp_path: Path) -> None:
    """Why attempts without a verdict are judged again: the more facts, the more successes would be lost."""
    once = CollectorConfig(judge_again=0)
    _, after = await judged(tmp_path / "run", rubric(0.1, 1), once, PER_LEVEL)
    assert after["outcomes"]["judge_error"] > 10
    rates = [after["success_rate"][level] or 0.0 for level in LEVELS]
    assert rates[0] > 0.4
    assert rates[-1] < 0.3


# --- judging again ------------------------------------------------------------------------------------


class Doubtful:
    """No verdict so many times about each attempt, then this one."""

    name = "doubtful/1"

    def __init__(self, times: float, *, blocked: bool = False) -> None:
        self.times = times
        self.verdict = Verdict(self.name, None if blocked else 1, (), Judgement(blocked, "as told"))
        self.asked: Counter[str] = Counter()

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        self.asked[episode.attempt_id] += 1
        if self.asked[episode.attempt_id] <= self.times:
            raise JudgeError("it is hard to say")
        return self.verdict


async def test_an_attempt_is_judged_again_so_often_and_recorded_once(tmp_path: Path) -> None:
    judge = Doubtful(2)
    before, after = await judged(tmp_path / "run", judge, CollectorConfig(), 2)
    assert before["outcomes"]["judge_error"] == after["outcomes"]["success"] == 6
    assert set(judge.asked.values()) == {3}
    reader = RunReader(tmp_path / "run")
    assert len(reader.attempts) == 6
    assert not reader.skipped
    trajectories = list(reader.trajectories())
    assert all(each.verdict and each.judge_failure is None for each in trajectories)
    shards = (tmp_path / "run/trajectories").glob("*.jsonl")
    assert sum(len(path.read_bytes().splitlines()) for path in shards) == 12  # the first ones stay


async def test_a_judge_that_never_has_a_verdict_is_given_up_on(tmp_path: Path) -> None:
    judge = Doubtful(float("inf"))
    config = CollectorConfig(judges=1, give_up_after=4)
    _, after = await judged(tmp_path / "run", judge, config, 2)
    assert after["outcomes"]["judge_error"] == 6
    assert judge.asked.total() == 6 + 4
    assert all(each.judge_failure for each in RunReader(tmp_path / "run").trajectories())


async def test_a_run_that_is_resumed_judges_again_what_has_no_verdict(tmp_path: Path) -> None:
    run, judge = tmp_path / "run", Doubtful(2, blocked=True)
    await judged(run, judge, CollectorConfig(judge_again=0), 1)
    tasks, progress = RunReader(run).tasks, Progress(total=3)
    kept = SiteHealth(HealthConfig(file=tmp_path / "sites.jsonl"))
    for trajectory in RunReader(run).trajectories():
        progress.recorded(digest_of(trajectory))
    for outcome in (Outcome.JUDGE_ERROR, Outcome.BLOCKED):
        async with await RunWriter.reopen(run) as store:
            config = CollectorConfig(judge_again=1)
            await judge_again(context(store, progress), tasks.values(), judge, pictures, config, kept)
        assert {entry.outcome for entry in RunReader(run).attempts.values()} == {outcome}
    assert list(kept.blocked()) == ["mugs.example"]
    assert +progress.outcomes == {Outcome.BLOCKED: 3}


async def test_only_an_attempt_without_a_verdict_may_be_recorded_again(tmp_path: Path) -> None:
    task, done, _ = made("easy", 0)
    verdict = Doubtful(0).verdict
    done = msgspec.json.decode(msgspec.json.encode(done), type=Episode)  # as the store reads it
    unjudged, success = Trajectory(done, Outcome.JUDGE_ERROR), Trajectory(done, Outcome.SUCCESS, verdict)
    async with await RunWriter.create(tmp_path / "run", {}, [task]) as store:
        for name, data in PICTURES.items():
            await store.put_image(name, data)
        await store.append(unjudged)
        other = msgspec.structs.replace(done, answer="another")
        with pytest.raises(StoreError, match="with other content"):
            await store.append(Trajectory(other, Outcome.SUCCESS, verdict))
        await store.append(success)
        await store.append(success)
        for trajectory in (unjudged, Trajectory(done, Outcome.FAILURE, verdict)):
            with pytest.raises(StoreError, match="with other content"):
                await store.append(trajectory)
    assert list(RunReader(tmp_path / "run").trajectories()) == [success]


@pytest.fixture
async def client(tmp_path: Path) -> AsyncIterator[httpx.AsyncClient]:
    await judged(tmp_path / "run", Doubtful(1), CollectorConfig(judge_again=0), 1)
    async with asking(view_app(tmp_path / "run")) as client:
        yield client


async def test_the_viewer_shows_the_verdict_that_came_later(
    client: httpx.AsyncClient, tmp_path: Path
) -> None:
    async def news(**known: Any) -> dict[str, Any]:
        reply = await client.get("/api/news", params=known)
        assert reply.status_code == 200
        return dict(reply.json())

    async def outcomes() -> dict[str, int]:
        await news(known=0)
        rows = (await client.get("/api/rows", params={"count": 10})).json()["rows"]
        found: dict[str, int] = defaultdict(int)
        for row in rows:
            found[row["outcome"]] += 1
        return found

    assert await outcomes() == {"judge_error": 3}
    known = {"known": 3, "whole": "false", "version": (await news(known=0))["version"]}
    assert not (await news(**known))["overview"]
    async with await RunWriter.reopen(tmp_path / "run") as store:
        held = context(store, Progress(total=3))
        await judge_again(
            held, RunReader(tmp_path / "run").tasks.values(), Doubtful(0), pictures, CollectorConfig()
        )
    assert "100.0%" in (await news(**known))["overview"]  # though there are no more attempts than before
    assert await outcomes() == {"success": 3}
