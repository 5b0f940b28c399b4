"""WebGym's tasks are BrowserGym's: played in its browser, judged by our judge, and a fault is no reward."""

from __future__ import annotations

import asyncio
import json
import warnings
from typing import Any
from unittest.mock import AsyncMock
from urllib.parse import urlsplit

import gymnasium
import pytest
from tests.integrations.engine import example
from tests.integrations.installed_browser import use_installed_browser

import webgym.testing
from webgym import Action, Answer, Navigate, Scroll
from webgym.core.errors import JudgeError
from webgym.core.verdict import Judgement, Verdict
from webgym.offline.web import OfflineWeb

pytest.importorskip("browsergym.core", reason="browsergym-core is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    from tests.integrations.browsergym_checks import (
        APPLICABLE,
        BUDGET,
        Adapter,
        Backend,
        checked,
        playwright_in,
    )

    from webgym.integrations import browsergym_tasks
    from webgym.integrations.browsergym import BrowserGymEnv, NoReward

pytestmark = [pytest.mark.browser, pytest.mark.filterwarnings("ignore")]  # its own

WEB = OfflineWeb(per_family=1, collection="small")
LARGE = OfflineWeb(per_family=1, collection="large")
TASKS = [task for task in WEB.tasks("train") if task.difficulty == 1]
TASK = next(task for task in TASKS if task.truth is not None and not any(f.state for f in task.truth.facts))
STATEFUL = next(task for task in TASKS if task.truth is not None and any(f.state for f in task.truth.facts))


def solution(task: webgym.Task) -> list[Action]:
    site = WEB.website(urlsplit(task.website).hostname or "")
    assert site is not None
    steps = webgym.testing.play(site, task, WEB.collection.viewport).steps
    return [step.action for step in steps if step.action is not None]


@pytest.fixture(scope="module", autouse=True)
def names() -> list[str]:
    made: list[str] = browsergym_tasks.register_tasks("small", split="train", per_family=1)
    assert len(made) == len(list(WEB.tasks("train"))) == len(set(made))
    return made


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    use_installed_browser(monkeypatch)


def played(task: webgym.Task, actions: list[Action]) -> tuple[list[float], bool, bool]:
    """Rewards of an episode, and how it ended."""
    rewards, terminated, truncated = [], False, False
    with BrowserGymEnv(browsergym_tasks.env_name(task.id), pre_observation_delay=0.1) as env:
        _, info = env.reset(seed=1)
        assert info["instruction"] == task.instruction
        for action in actions:
            _, reward, terminated, truncated, _ = env.step(action)
            rewards.append(reward)
            if terminated or truncated:
                break
    return rewards, terminated, truncated


class DropsBrowserGymsOwn(Adapter):
    """Begins an episode as a user of BrowserGym does, without WebGym's environment."""

    async def begin(self, name: str) -> Any:
        env = gymnasium.make(f"browsergym/{name}")
        await asyncio.get_running_loop().run_in_executor(self._thread, env.reset)
        return env


@pytest.mark.timeout(300)
def test_they_keep_the_environments_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    episodes: list[browsergym_tasks.WebGymTask] = []
    init, judge = browsergym_tasks.WebGymTask.__init__, webgym.OfflineJudge.judge
    right = solution(STATEFUL)

    def watched(self: browsergym_tasks.WebGymTask, seed: int, **given: Any) -> None:
        init(self, seed, **given)
        self.budget = max(BUDGET, len(right))
        episodes.append(self)

    async def judged(*given: Any) -> Verdict:
        if backend.case == "judge":
            raise JudgeError("the judge of the test fails")
        if backend.case in ("no_reward", "blocked"):
            return Verdict("test/1", None, (), Judgement(backend.case == "blocked", "a test"))
        return await judge(*given)

    def steps() -> list[int]:
        return [len(task._observations) - 1 for task in episodes]  # without the start page

    adapter = DropsBrowserGymsOwn()
    backend = Backend(browsergym_tasks.env_name(STATEFUL.id), right, steps)
    monkeypatch.setattr(browsergym_tasks.WebGymTask, "__init__", watched)
    monkeypatch.setattr(webgym.OfflineJudge, "judge", judged)
    with playwright_in(adapter, monkeypatch):
        assert checked(adapter, backend, faults=APPLICABLE) == []


@pytest.mark.parametrize("task", [TASK, STATEFUL], ids=["shown", "state"])
def test_a_solution_is_rewarded_once_at_the_end(task: webgym.Task) -> None:
    actions = solution(task)
    rewards, terminated, _ = played(task, actions)
    assert terminated
    assert rewards == [0.0] * (len(actions) - 1) + [1.0]


def test_a_wrong_answer_and_a_budget_that_is_spent_are_0(monkeypatch: pytest.MonkeyPatch) -> None:
    assert played(TASK, [Scroll("down"), Answer("no idea")]) == ([0.0, 0.0], True, False)
    init = browsergym_tasks.WebGymTask.__init__

    def short(self: browsergym_tasks.WebGymTask, seed: int, **given: Any) -> None:
        init(self, seed, **given)
        self.budget = 2

    monkeypatch.setattr(browsergym_tasks.WebGymTask, "__init__", short)
    assert played(TASK, [Scroll("down")] * 3) == ([0.0, 0.0], True, False)


def test_episodes_do_not_see_each_others_state() -> None:
    assert played(STATEFUL, solution(STATEFUL)[:-1])[0][-1] == 0.0
    assert played(STATEFUL, [solution(STATEFUL)[-1]]) == ([0.0], True, False)


@pytest.mark.parametrize(
    ("judged", "says"),
    [
        (JudgeError("the judge of the test fails"), "the judge of the test fails"),
        (Verdict("test/1", None, (), Judgement(True, "a test")), "blocked the agent"),
    ],
    ids=["judge", "blocked"],
)
def test_an_episode_that_is_not_judged_is_no_reward(
    monkeypatch: pytest.MonkeyPatch, judged: object, says: str
) -> None:
    monkeypatch.setattr(webgym.OfflineJudge, "judge", AsyncMock(side_effect=[judged]))
    with pytest.raises(NoReward, match=says):
        played(TASK, [Answer("no idea")])


def answered(task: webgym.Task, codes: list[str], answer: str) -> float:
    """Reward of an answer after code for Playwright, each of which is a step."""
    with BrowserGymEnv(browsergym_tasks.env_name(task.id), pre_observation_delay=0.1) as env:
        env.reset(seed=1)
        for code in codes:
            assert env._env.step(code)[0]["last_action_error"] == ""
        return env.step(Answer(answer))[1]


def blocking() -> webgym.Task:
    browsergym_tasks.register_tasks("large", split="test", per_family=1, count=1)
    task = next(iter(LARGE.tasks("test")))
    assert LARGE.specs[urlsplit(task.website).hostname or ""].behaviour == "blocks"
    return task


@pytest.mark.parametrize(
    "code",
    ["page.goto({website!r})", "page.evaluate('location = `/${{Math.random()}}`')"],
    ids=["open", "click"],
)
def test_a_website_that_blocks_is_no_reward(code: str) -> None:
    task = blocking()
    with pytest.raises(NoReward, match="blocked the agent"):
        answered(task, [code.format(website=task.website)] * 2, "no idea")


def test_a_blocking_page_that_reloads_by_itself_proves_nothing() -> None:
    assert answered(blocking(), ["page.evaluate('location.reload()')"] * 2, "no idea") == 0.0


def test_an_ordinary_website_opened_again_and_again_is_0() -> None:
    again = Navigate(TASK.website)
    assert played(TASK, [again, again, Answer("no idea")]) == ([0.0, 0.0, 0.0], True, False)


PARAGRAPH = "Object.assign(document.createElement(`p`), {textContent: TEXT, MORE})"


@pytest.mark.parametrize(
    "code",
    [
        "page.fill('[name=q]', TEXT)",
        f"page.evaluate('document.body.prepend({PARAGRAPH})')".replace("MORE", "contentEditable: true"),
        f"page.evaluate('document.body.prepend({PARAGRAPH})')".replace("MORE", "style: `opacity: 0`"),
    ],
    ids=["field", "editable", "transparent"],
)
def test_what_the_agent_typed_and_what_nobody_sees_is_no_evidence(code: str) -> None:
    count, task = next(
        (count, task) for count, task in enumerate(LARGE.tasks("train"), 1) if task.id.endswith("/bar-0")
    )
    browsergym_tasks.register_tasks("large", split="train", per_family=1, count=count)
    assert task.truth is not None
    evidence, [right] = task.truth.facts[0].evidence[0], task.truth.answer.required
    page = task.website.rstrip("/") + evidence.path.removesuffix(r"(?:\?|$)").replace("\\", "")
    typed = code.replace("TEXT", json.dumps(" ".join(evidence.texts)))
    assert answered(task, [f"page.goto({page!r})", typed], right[0]) == 0.0


@pytest.mark.parametrize("last", [False, True])
def test_a_website_that_is_gone_is_no_reward(last: bool) -> None:
    actions = solution(STATEFUL)

    def play() -> None:
        with BrowserGymEnv(browsergym_tasks.env_name(STATEFUL.id), pre_observation_delay=0.1) as env:
            env.reset(seed=1)
            browsergym_tasks._sites[("small", 1)].stop()
            for action in actions[-1:] if last else actions:
                env.step(action)

    try:
        with pytest.raises(NoReward, match="offline web"):
            play()
    finally:
        browsergym_tasks._sites.clear()


def test_a_website_that_fails_is_no_reward(monkeypatch: pytest.MonkeyPatch) -> None:
    with BrowserGymEnv(browsergym_tasks.env_name(TASK.id), pre_observation_delay=0.1) as env:
        env.reset(seed=1)
        sites = browsergym_tasks._sites["small", 1]
        monkeypatch.setattr(sites, "ask", lambda *_: (503, {}, b"busy"))
        with pytest.raises(NoReward, match="HTTP status 503"):
            env.step(Navigate(TASK.website))


def test_the_example(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(browsergym_tasks, "_sites", {})
    assert example("webgym_in_browsergym").main("test", pre_observation_delay=0.1) == 0.0
    first, last = capsys.readouterr().out.splitlines()
    task = next(iter(OfflineWeb(collection="small").tasks("test")))
    assert first == task.instruction
    assert last == f"{task.website}: reward 0, terminated True"
