"""verifiers evaluates our agent against an endpoint, and counts what has no reward as an error."""

from __future__ import annotations

import asyncio
import importlib
import json
import os
import shutil
import sys
import types
import uuid
import warnings
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.documented import documented
from tests.integrations.engine import reply_text, texts_of
from tests.llm import endpoint

import webgym
from webgym import Action, Answer, Scroll
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool
from webgym.testing.environments import STAND_IN_TASKS

pytest.importorskip("verifiers.v1", reason="verifiers is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    from verifiers.v1 import Episode

    from webgym.integrations import verifiers as integration

pytestmark = pytest.mark.filterwarnings("ignore")  # its own

EXAMPLES = Path(__file__).parents[2] / "examples" / "integrations"
SCROLL = reply_text(Scroll("down"))


def said(text: str, ended: str = "") -> dict[str, Any]:
    ended = ended or ("stop" if text else "content_filter")
    return {"message": {"role": "assistant", "content": text}, "finish_reason": ended}


async def run(
    folder: Path,
    replies: list[str],
    count: int,
    behaviour: str = "scripted",
    usage: dict[str, int] | None = None,
    **more: Any,
) -> tuple[list[Episode], list[dict[str, Any]], Any]:
    """The example, one episode after another; its episodes, and what the endpoint was asked."""
    given = stand_in_pool(folder, 1, **more)
    with the_example(given) as example:
        async with endpoint.serve() as served:
            served.replies = [said(text, "stop" if usage else "") for text in replies]
            served.usage = usage or served.usage
            episodes = await example.main(
                served.url(behaviour),
                "tiny-1",
                str(folder / "out"),
                1,
                tasks=given["name"],
                split="all",
                count=count,
            )
    return episodes, served.requests, given["browsers"]


@contextmanager
def the_example(given: dict[str, Any]) -> Iterator[Any]:
    """On stand-ins of browsers."""
    stand_ins = {key: given[key] for key in ("browsers", "judge", "config")}

    def made(name: str, *, size: int, split: str, config: Any) -> Any:
        assert (size, split, type(config)) == (1, "all", webgym.RunConfig)
        return webgym.EnvironmentPool(name, size=size, split="all", **stand_ins)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(integration, "EnvironmentPool", made)
        patch.syspath_prepend(EXAMPLES)
        sys.modules.pop("verifiers_tasks", None)
        yield importlib.import_module("verifiers_tasks")


class Player:
    """An agent of verifiers that does not answer."""

    def __init__(self) -> None:
        self.asked = asyncio.Event()

    @asynccontextmanager
    async def interaction(self, task: Any) -> AsyncIterator[Any]:
        yield self

    async def turn(self, messages: Any) -> None:
        self.asked.set()
        await asyncio.Event().wait()


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    folder = Path(given["name"]).parent
    begun: list[integration.WebGymEnv] = []

    with the_example(given) as example:

        async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
            tasks = folder / f"{task_id}.jsonl"
            webgym.write_tasks(tasks, [task for task in STAND_IN_TASKS if task.id == task_id])
            async with endpoint.serve() as served:
                served.replies = [said(text) for text in texts_of(actions)]
                place = served.url("scripted"), "tiny-1", str(folder / "out" / uuid.uuid4().hex), 1
                (episode,) = await example.main(*place, tasks=str(tasks), split="all", count=1)
            return Told([episode.traces[0].reward] if episode.ok else [])

        async def begin(task_id: str) -> asyncio.Future[None]:
            taskset = {"id": "verifiers_tasks", "tasks": given["name"], "split": "all", "count": "all"}
            env = integration.WebGymEnv(integration.WebGymEnvConfig(taskset=taskset, browsers=1))
            begun.append(env)
            await env.start()
            task = next(task for task in env.taskset.load() if task.data.id == task_id)
            player = Player()
            running = asyncio.ensure_future(env.run(task, types.SimpleNamespace(player=player)))
            await player.asked.wait()
            return running

        yield Adapted(play, begin)
        for env in begun:
            await env.stop()


async def test_it_keeps_the_environments_promises() -> None:
    assert await check_adapter(adapter, cancels=False) == []


async def test_an_evaluation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replies = [SCROLL, reply_text(Answer("right")), SCROLL, reply_text(Answer("wrong"))]
    episodes, requests, browsers = await run(tmp_path, replies, 2)
    assert [episode.errors for episode in episodes] == [[], []]
    assert [episode.ok for episode in episodes] == [True, True]
    traces = [episode.traces[0] for episode in episodes]
    assert [trace.reward for trace in traces] == [1.0, 0.0]
    assert [trace.info["webgym"]["outcome"] for trace in traces] == ["success", "failure"]
    assert [trace.info["webgym"]["answer"] for trace in traces] == ["right", "wrong"]
    assert [len(each["messages"]) for each in requests] == [2, 4, 2, 4]
    assert [[len(each.messages) for each in trace.branches] for trace in traces] == [[5], [5]]
    assert {trace.metrics["steps"] for trace in traces} == {2}
    assert "2 of 2 episodes have a reward: success rate 0.50" in capsys.readouterr().out
    assert not browsers.open_now
    # What the model is asked is what a run asks, pictures included.
    assert len(requests) == 4
    parts = requests[0]["messages"][-1]["content"]
    pictures = [part["image_url"]["url"] for part in parts if part["type"] == "image_url"]
    assert len(pictures) == 1
    assert pictures[0].startswith("data:image/png;base64,")
    (record,) = (tmp_path / "out").glob("*/traces.jsonl")
    written = [json.loads(line) for line in record.read_text().splitlines()]
    assert [each["traces"][0]["rewards"]["webgym"]["score"] for each in written] == [1.0, 0.0]
    assert {each["task"]["key"] for each in written} <= {f"check-{number}" for number in range(12)}


@pytest.mark.parametrize("fault", [{"fails": True}, {"fault": "judge"}, {"fault": "blocked"}])
async def test_a_fault_is_an_error(
    tmp_path: Path, fault: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    episodes, _, browsers = await run(tmp_path, [SCROLL, reply_text(Answer("right"))], 1, **fault)
    assert_no_reward(episodes[0], "NoReward")
    assert "0 of 1 episodes have a reward: no success rate" in capsys.readouterr().out
    assert not browsers.open_now


async def test_a_model_that_fails_is_an_error(tmp_path: Path) -> None:
    episodes, _, browsers = await run(tmp_path, [], 1, behaviour="400")
    assert_no_reward(episodes[0], "ProviderError")
    assert not browsers.open_now


async def test_replies_without_actions_are_an_error(tmp_path: Path) -> None:
    episodes, requests, _ = await run(tmp_path, ["I would click there."] * 4, 1)
    assert_no_reward(episodes[0], "NoReward")
    assert len(requests) == 4


@pytest.mark.parametrize(
    "usage", [None, {"prompt_tokens": 12, "completion_tokens": 0, "total_tokens": 12}], ids=["filter", "void"]
)
async def test_a_reply_that_the_endpoint_withheld_is_an_error(
    tmp_path: Path, usage: dict[str, int] | None
) -> None:
    episodes, requests, _ = await run(tmp_path, [SCROLL, ""], 1, usage=usage)
    assert_no_reward(episodes[0], "NoReward")
    assert len(requests) == 2


@pytest.mark.browser
async def test_the_documented_command(tmp_path: Path) -> None:
    words = documented(
        "vf-eval verifiers-tasks --model MODEL --client.base-url http://127.0.0.1:8000/v1 --max-concurrent 8 "
        "--env.taskset.tasks offline-v2 --env.taskset.split test --env.taskset.count 50 --env.browsers 8 "
        "--no-push"
    )
    shutil.copy(EXAMPLES / "verifiers_tasks.py", tmp_path)
    path = os.pathsep.join([".", os.environ.get("PYTHONPATH", "")])
    async with endpoint.serve() as served:
        served.text = reply_text(Answer("no idea"))
        smaller = {"offline-v2": "offline-small-v2", "50": "2", "8": "1", words[4]: served.url()}
        command = await asyncio.create_subprocess_exec(
            Path(sys.executable).with_name("vf-eval"),
            *(smaller.get(word, word) for word in words),
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": path, "HOME": str(tmp_path)},
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        printed, _ = await command.communicate()
    assert command.returncode == 0, printed.decode()
    (record,) = (tmp_path / "outputs").glob("*/traces.jsonl")
    written = [json.loads(line) for line in record.read_text().splitlines()]
    assert [each["ok"] for each in written] == [True, True], printed.decode()
    assert [each["traces"][0]["rewards"]["webgym"]["score"] for each in written] == [0.0, 0.0]
    assert [each["model"] for each in served.requests] == ["MODEL"] * 2


def assert_no_reward(episode: Episode, first_error: str) -> None:
    assert not episode.ok
    assert episode.errors
    (trace,) = episode.traces
    assert not trace.ok
    assert not trace.rewards
    assert trace.errors[0].type == first_error
