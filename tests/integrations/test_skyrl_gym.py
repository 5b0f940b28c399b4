"""SkyRL's Gym makes and steps it; an episode without a reward raises: SkyRL would train on any number."""

from __future__ import annotations

import asyncio
import base64
import io
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from tests.integrations.engine import example, reply_text, texts_of
from tests.llm import endpoint

from webgym import Action, Answer, RunConfig, Scroll, UsageError

skyrl_gym = pytest.importorskip("skyrl_gym", reason="skyrl-gym is not installed")

from webgym.integrations import skyrl_gym as integration  # noqa: E402
from webgym.integrations.skyrl_gym import ENV_CLASS, Browsers, NoReward, skyrl_rows  # noqa: E402
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool  # noqa: E402

ENTRY = "webgym.integrations.skyrl_gym:WebGymEnv"


@contextmanager
def made(folder: Path, size: int = 4, **more: Any) -> Iterator[tuple[Any, Any]]:
    """A function that makes environments by their registered name, and the stand-ins below them."""
    given = stand_in_pool(folder, **more)
    browsers = Browsers(**given | {"size": size})
    if ENV_CLASS not in skyrl_gym.registry:
        skyrl_gym.register(id=ENV_CLASS, entry_point=ENTRY)
    try:
        yield (
            lambda task_id: skyrl_gym.make(
                ENV_CLASS, env_config={}, extras={"task_id": task_id}, browsers=browsers
            ),
            given["browsers"],
        )
    finally:
        browsers.close()


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    browsers = Browsers(**given)
    if ENV_CLASS not in skyrl_gym.registry:
        skyrl_gym.register(id=ENV_CLASS, entry_point=ENTRY)

    def begin(task_id: str) -> Any:
        env = skyrl_gym.make(ENV_CLASS, env_config={}, extras={"task_id": task_id}, browsers=browsers)
        env.init([])
        return env

    def play(task_id: str, actions: Sequence[Action | str]) -> Told:
        told = Told()
        try:
            env = begin(task_id)
            for text in texts_of(actions):
                step = env.step(text)
                (told.final if step["done"] else told.early).append(step["reward"])
        except NoReward:
            pass
        return told

    try:
        yield Adapted(
            lambda task_id, actions: asyncio.to_thread(play, task_id, actions),
            lambda task_id: asyncio.to_thread(begin, task_id),
        )
    finally:
        await asyncio.to_thread(browsers.close)


async def test_it_keeps_the_environments_promises() -> None:
    def rows(name: str, config: RunConfig) -> list[str]:
        return [row["task_id"] for row in skyrl_rows(name, split="all", count=6, config=config)]

    assert await check_adapter(adapter, rows=rows, cancels=False) == []


def picture_of(message: dict[str, Any]) -> Image.Image:
    [url] = [part["image_url"]["url"] for part in message["content"] if part["type"] == "image_url"]
    return Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))


def test_an_episode_by_its_registered_name(tmp_path: Path) -> None:
    with made(tmp_path) as (make, stand_ins):
        env = make("check-3")
        messages, told = env.init([{"role": "user", "content": "of the row"}])
        assert told == {"task_id": "check-3", "instruction": "Find number 3"}
        assert [message["role"] for message in messages] == ["system", "user"]
        first = env.step(reply_text(Scroll("down")))
        assert (first["reward"], first["done"]) == (0.0, False)
        [seen] = first["observations"]
        assert seen["role"] == "user"
        assert picture_of(seen).tobytes() != picture_of(messages[-1]).tobytes()
        last = env.step(reply_text(Answer("right")))
        assert (last["reward"], last["done"], last["observations"]) == (1.0, True, [])
        assert last["metadata"] == {"outcome": "success"}
        assert not stand_ins.open_now
        with pytest.raises(UsageError, match="no episode"):
            env.step(reply_text(Answer("right")))


def test_a_wrong_answer_is_0(tmp_path: Path) -> None:
    with made(tmp_path) as (make, _):
        env = make("check-3")
        env.init([])
        last = env.step(reply_text(Answer("wrong")))
        assert (last["reward"], last["done"]) == (0.0, True)


@pytest.mark.parametrize("fault", [{"fails": True}, {"fault": "judge"}, {"fault": "blocked"}])
def test_a_fault_is_no_number(tmp_path: Path, fault: dict[str, Any]) -> None:
    def episode(env: Any) -> None:
        env.init([])
        env.step(reply_text(Scroll("down")))
        env.step(reply_text(Answer("right")))

    with made(tmp_path, **fault) as (make, stand_ins):
        with pytest.raises(NoReward, match="check-3"):
            episode(make("check-3"))
        assert not stand_ins.open_now


def test_browsers_are_given_back_and_apart(tmp_path: Path) -> None:
    with made(tmp_path, size=2) as (make, stand_ins):
        one, other = make("check-1"), make("check-2")
        one.init([])
        other.init([])
        one.step(reply_text(Scroll("down")))
        assert sorted(stand_ins.steps.values()) == [0, 1]
        one.close()
        one.close()
        assert len(stand_ins.open_now) == 1
        with pytest.raises(UsageError):
            make("no such task").init([])
        make("check-3").init([])  # has the place of the one that was closed
        assert len(stand_ins.open_now) == 2


def test_rows_name_the_environment(tmp_path: Path) -> None:
    stand_in_pool(tmp_path)
    rows = skyrl_rows(str(tmp_path / "tasks.jsonl"), split="all", count=2)
    assert len(rows) == 2
    assert all(row["env_class"] == ENV_CLASS and row["task_id"].startswith("check-") for row in rows)


@pytest.mark.browser
async def test_the_example(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("WEBGYM_TASKS", "offline-small-v2")
    monkeypatch.setenv("WEBGYM_BROWSERS", "1")
    skyrl_gym.registry.pop(ENV_CLASS, None)
    async with endpoint.serve() as served:
        texts = texts_of([Scroll("down"), Answer("no idea")])
        served.replies = [{"message": {"role": "assistant", "content": text}} for text in texts]
        try:
            reward = await asyncio.to_thread(example("skyrl_episode").main, served.url("scripted"), "tiny-1")
        finally:
            await asyncio.to_thread(integration.the_browsers().close)
            integration._browsers = None
    assert reward == 0.0
    assert "failure: reward 0.0" in capsys.readouterr().out
