"""One reply before a run: an endpoint that cannot play is found out before anything else starts."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from tests.agent.test_agent import Parrot
from tests.conftest import Calls
from tests.llm.endpoint import Endpoint, serve
from tests.rollout.test_summary import task

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig
from webgym.agent.formats import render_reply
from webgym.agent.preflight import check_policy
from webgym.agent.profiles import choose_profile
from webgym.agent.scripted import RandomPolicy
from webgym.core.action import LeftClick, Target
from webgym.core.errors import ConfigError, JudgeError, RunFolderError, TaskFileError, WebGymError
from webgym.core.trajectory import Reply
from webgym.judge.config import JudgeChoice, JudgeConfig
from webgym.llm.config import ChatConfig, Retry
from webgym.offline.config import SitesConfig
from webgym.run import choice as task_choice
from webgym.run import collect as runs
from webgym.run import config as run_config
from webgym.run.collect import collect
from webgym.run.config import PolicyChoice, RunConfig, TaskChoice
from webgym.tasks.formats import write_tasks

SMALL = SitesConfig(per_family=1)
CLICK = render_reply(LeftClick(Target(coordinate=(90.0, 80.0))), "memory", description="Click")


@pytest.fixture
async def endpoint() -> AsyncIterator[Endpoint]:
    async with serve() as endpoint:
        endpoint.text = CLICK
        yield endpoint


@pytest.fixture(autouse=True)
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Notes that browsers or websites were to be started, and goes no further."""
    found: list[str] = []

    def refuse(*_: Any, **__: Any) -> Any:
        found.append("services")
        raise WebGymError("far enough")

    monkeypatch.setattr(runs, "open_services", refuse)
    return found


def config(endpoint: Endpoint, behaviour: str = "fine", **changes: Any) -> RunConfig:
    chat = ChatConfig(
        base_url=endpoint.url(behaviour), model="tiny", retry=Retry(tries=2, first_seconds=0.01)
    )
    settings: dict[str, Any] = {
        "tasks": TaskChoice(count=2),
        "sites": SMALL,
        "policy": PolicyChoice(chat=chat),
    }
    return RunConfig(**settings | changes)


async def test_a_model_that_acts_is_asked_once(
    endpoint: Endpoint, tmp_path: Path, started: list[str]
) -> None:
    with pytest.raises(WebGymError, match="far enough"):
        await collect(config(endpoint), tmp_path / "run")
    assert len(endpoint.requests) == 1
    assert started


def click(x: float, y: float) -> str:
    call = {"name": "computer_use", "arguments": {"action": "left_click", "coordinate": [x, y]}}
    return f"Action: Click.\n<tool_call>{json.dumps(call)}</tool_call>"


PIXELS = click(1178, 699)  # of 1280 x 768
GRID = click(920, 910)
PERCENT = click(92, 91)
SHARES = click(0.92, 0.91)


@pytest.mark.parametrize(
    ("profile", "text", "told", "hint"),
    [
        ("generic", PIXELS, "points in pixels of the picture", "--profile qwen2.5-vl"),
        ("qwen3-vl", PIXELS, "points in pixels of the picture", "--profile qwen2.5-vl"),
        ("qwen2.5-vl", GRID, "points on a 0-1000 grid", "--profile generic"),
        ("glm-v", PERCENT, "points in per cent of the picture", "--profile molmoweb"),
        ("molmoweb", GRID, "points on a 0-1000 grid", "--profile generic"),
        ("internvl3", SHARES, "points in shares of the picture from 0 to 1", "grid: unit"),
        ("fara-7b", SHARES, "points in shares of the picture from 0 to 1", "grid: unit"),
    ],
)
async def test_another_scale_than_the_profiles_stops_the_run(
    endpoint: Endpoint, tmp_path: Path, started: list[str], profile: str, text: str, told: str, hint: str
) -> None:
    endpoint.text = text
    agent = AgentConfig(profile=profile, prompt_format="official")
    with pytest.raises(ConfigError, match=told) as caught:
        await collect(config(endpoint, agent=agent), tmp_path / "run")
    assert hint in caught.value.hint
    assert len(endpoint.requests) == 1
    assert not started


@pytest.mark.parametrize("viewport", [(1280, 768), (1024, 768), (1920, 1080), (768, 1280), (390, 844)])
@pytest.mark.parametrize("profile", ["generic", "qwen3-vl", "qwen2.5-vl", "glm-v", "molmoweb"])
async def test_the_right_scale_is_none_of_another(profile: str, viewport: tuple[int, int]) -> None:
    chosen = choose_profile(profile, "m")
    width, height = chosen.screen(chosen.picture_size(viewport))
    for x, y in ((0.92, 0.91), (0.88, 0.88), (0.97, 0.95), (0.5, 0.5), (0.1, 0.9)):
        agent = Agent(Parrot(Reply(click(x * width, y * height), "m")), AgentConfig(profile=profile))
        await check_policy(agent, viewport)


@pytest.mark.parametrize(
    ("behaviour", "text", "told"),
    [
        ("401", CLICK, "401"),
        ("fine", "I cannot help with that.", "replied 3 times to a test page, never with a valid action"),
        ("nothing", CLICK, "empty reply"),
    ],
)
async def test_one_that_does_not_stops_the_run_before_browsers(
    endpoint: Endpoint, tmp_path: Path, started: list[str], behaviour: str, text: str, told: str
) -> None:
    endpoint.text = text
    with pytest.raises(WebGymError, match=told):
        await collect(config(endpoint, behaviour), tmp_path / "run")
    assert not started
    assert not (tmp_path / "run").exists()


async def test_it_can_be_let_through(endpoint: Endpoint, tmp_path: Path, started: list[str]) -> None:
    given = config(endpoint)
    policy = given.policy.model_copy(update={"check": False})
    with pytest.raises(WebGymError, match="far enough"):
        await collect(given.model_copy(update={"policy": policy}), tmp_path / "run")
    assert not endpoint.requests
    assert started


def judged_by(endpoint: Endpoint, behaviour: str) -> JudgeChoice:
    chat = ChatConfig(base_url=endpoint.url(behaviour), model="judge", retry=Retry(first_seconds=60))
    return JudgeChoice(name="rubric", rubric=JudgeConfig(chat=chat))


@pytest.mark.parametrize("policy", ["openai", "scripted", "one's own"])
async def test_a_judge_that_refuses_the_key_stops_it_too(
    endpoint: Endpoint, tmp_path: Path, started: list[str], policy: str
) -> None:
    """Whoever plays."""
    given = config(endpoint, judge=judged_by(endpoint, "401"))
    if policy != "openai":
        given = given.model_copy(update={"policy": PolicyChoice(name="scripted")})
    own = RandomPolicy() if policy == "one's own" else None
    with pytest.raises(JudgeError, match=r"the judge's model does not reply: .*401"):
        await collect(given, tmp_path / "run", policy=own)
    assert not started


@pytest.mark.parametrize("who", ["policy", "judge"])
async def test_what_the_first_replies_wait_for_is_told(
    endpoint: Endpoint, tmp_path: Path, started: list[str], who: str
) -> None:
    endpoint.fails_left = 1  # 429
    given = config(endpoint, judge=judged_by(endpoint, "flaky"))
    if who == "policy":
        chat = ChatConfig(base_url=endpoint.url("flaky"), model="tiny", retry=Retry(first_seconds=60))
        given = config(endpoint, policy=PolicyChoice(chat=chat))
    told = asyncio.Queue[str]()
    waiting = asyncio.create_task(collect(given, tmp_path / "run", tell=told.put_nowait))
    async with asyncio.timeout(100):
        while "requests are sent again: " not in (line := await told.get()):
            pass
    assert "answered 429 Too Many Requests: slow down" in line
    assert not started
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)


async def test_a_folder_that_holds_a_run_is_refused_before_anything_is_asked(
    endpoint: Endpoint, tmp_path: Path
) -> None:
    (tmp_path / "config.yaml").touch()
    with pytest.raises(RunFolderError, match="holds a run already") as refused:
        await collect(config(endpoint), tmp_path)
    assert "--resume" in (refused.value.hint or "")
    assert not endpoint.requests


def test_an_endpoint_is_never_played_by_the_oracle() -> None:
    chat = {"base_url": "http://127.0.0.1:1/v1", "model": "m"}
    assert RunConfig.model_validate({"policy": {"chat": chat}}).policy.name == "openai"
    assert RunConfig().policy.name == "scripted"
    with pytest.raises(ValueError, match="the scripted policy uses no model"):
        PolicyChoice.model_validate({"name": "scripted", "chat": chat})


def test_a_model_without_an_endpoint_is_refused(tmp_path: Path, calls: Calls) -> None:
    code, _, said = calls.apart("rollout", "--model", "m", "--out", tmp_path / "run")
    assert code != 0
    assert "needs an endpoint and a model" in said


@pytest.mark.parametrize(("there", "drawn"), [(100, 100), (101, 20)])
async def test_a_large_file_is_drawn_from_and_that_is_told(tmp_path: Path, there: int, drawn: int) -> None:
    write_tasks(tmp_path / "tasks.jsonl", [task(f"t{number}", 1) for number in range(there)])
    given = RunConfig(
        tasks=TaskChoice(file=tmp_path / "tasks.jsonl", split="all"), judge=JudgeChoice(name="operator:eq")
    )
    assert len(task_choice.choose_tasks(given).tasks) == drawn
    told: list[str] = []
    with pytest.raises(WebGymError, match="far enough"):
        await collect(given, tmp_path / "run", tell=told.append)
    said = "20 of 101 tasks are drawn; --limit (tasks.count) takes another number, or all"
    oracle = (
        "no policy is named: the scripted policy is an oracle: it plays known solutions and uses no model"
    )
    assert told == [oracle, *([said] if drawn < there else [])]
    whole = given.model_copy(update={"tasks": given.tasks.model_copy(update={"count": "all"})})
    assert len(task_choice.choose_tasks(whole).tasks) == there


async def test_tasks_with_a_picture_of_their_own_are_counted(tmp_path: Path) -> None:
    rows = [{"instruction": "Find it.", "website": "a.example"} for _ in range(3)]
    rows[1]["image"] = "kettle.png"
    (tmp_path / "tasks.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    given = RunConfig(
        tasks=TaskChoice(file=tmp_path / "tasks.jsonl", split="all"), judge=JudgeChoice(name="operator:eq")
    )
    told: list[str] = []
    with pytest.raises(WebGymError, match="far enough"):
        await collect(given, tmp_path / "run", tell=told.append)
    assert "1 of 3 tasks have a picture of their own, which no agent is shown" in told


async def test_the_event_loop_goes_round_while_a_line_without_end_is_read(tmp_path: Path) -> None:
    path = tmp_path / "tasks.jsonl"
    path.write_bytes(b'{"website": "a.example", "instruction": "' + b"x" * 160_000_000 + b'"}\n')
    reading = asyncio.create_task(collect(RunConfig(tasks=TaskChoice(file=path)), tmp_path / "run"))
    rounds = 0
    while not reading.done():
        await asyncio.sleep(0)
        rounds += 1
    with pytest.raises(TaskFileError, match=r"contains no task; .* bytes, and at most"):
        reading.result()
    assert rounds > 20


def test_a_run_without_a_count_is_small() -> None:
    assert len(task_choice.choose_tasks(RunConfig(sites=SMALL)).tasks) == run_config.FEW
    every = task_choice.choose_tasks(RunConfig(sites=SMALL, tasks=TaskChoice(count="all"))).tasks
    assert len(every) > 100
    assert {task.split for task in every} == {"train"}
    with pytest.raises(ConfigError, match="no task"):
        task_choice.choose_tasks(RunConfig(sites=SMALL, tasks=TaskChoice(split="unsplit")))
