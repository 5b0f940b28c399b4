"""What training needs is in the store: every request, to the byte, from the stored trajectory alone."""

from __future__ import annotations

import hashlib
import io
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace
from PIL import Image
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from tests.agent.shop import task
from tests.llm.endpoint import Endpoint, serve

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig
from webgym.agent.formats import render_reply
from webgym.agent.openai_policy import OpenAIPolicy, request_of
from webgym.core.action import LeftClick, Target
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.trajectory import Episode, Trajectory
from webgym.llm.config import ChatConfig, Sampling
from webgym.store.runs import RunReader, RunWriter

SAID = render_reply(
    LeftClick(Target(coordinate=(512, 300))), "memory", description="Klick „ja“ 🎉", memory={"price": "12 €"}
)


class Copies(Endpoint):
    """Keeps what it received, to the byte."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.bodies: list[bytes] = []

    async def do_copies(self, request: Request) -> Response:
        self.bodies.append(await request.body())
        return JSONResponse(self.completion())


@pytest.fixture
async def endpoint(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Copies]:
    monkeypatch.setattr("tests.llm.endpoint.Endpoint", Copies)
    async with serve() as endpoint:
        assert isinstance(endpoint, Copies)
        yield endpoint


def screenshot(number: int, size: tuple[int, int]) -> tuple[str, bytes]:
    out = io.BytesIO()
    Image.radial_gradient("L").resize(size).rotate(9 * number).convert("RGB").save(
        out, "PNG", compress_level=1
    )
    return hashlib.sha256(out.getvalue()).hexdigest(), out.getvalue()


async def play(
    endpoint: Copies, store: RunWriter, chat: ChatConfig, *, empty: int = -1, **config: Any
) -> None:
    viewport = (690, 388)
    async with Agent(OpenAIPolicy(chat), AgentConfig(**config)) as agent:
        conversation = agent.begin(task(), 0, 15)
        steps = []
        for number in (0, 1, 1, 2, 3, 4):  # one of them twice in a row
            name, png = screenshot(number, viewport)
            await store.put_image(name, png)
            thought = "Let me see.</think>\n\n" if agent.profile.thinking == "opened" else ""
            endpoint.text = thought + SAID.replace("12 €", f"{number} €")
            endpoint.text = "" if number == empty else endpoint.text
            seen = Observation(name, "http://mugs.webgym.test/", "Mugs “ü”", viewport)
            steps.append(await conversation.turn(seen, png, 0))
    named = ("t#0.0", "t", 0, 0, 7, agent.policy.name, 0.0, 1.0)
    episode = Episode(*named, steps=tuple(steps), ending=Ending.BUDGET_SPENT)
    await store.append(Trajectory(episode, Outcome.TRUNCATED))


@pytest.mark.parametrize(
    ("model", "config"),
    [
        ("Qwen/Qwen3-VL-8B-Instruct", {}),
        ("Qwen/Qwen3-VL-8B-Thinking", {"rounds": 2}),
        ("Qwen/Qwen2.5-VL-7B-Instruct", {"image_max_side": 500}),
        ("Qwen/Qwen3-VL-8B-Instruct", {"request_tokens": 2600, "max_images": 3}),
        ("gpt-5-mini", {"prompt_format": "official"}),
        ("tiny", {"mode": "coordinates"}),
    ],
)
async def test_every_request_is_rebuilt_from_the_store(
    endpoint: Copies, tmp_path: Path, model: str, config: dict[str, Any]
) -> None:
    chat = ChatConfig(base_url=endpoint.url("copies"), model=model)
    async with await RunWriter.create(tmp_path / "run", {}, [replace(task(), id="t")]) as store:
        await play(endpoint, store, chat, empty=2, **config)
    reader = RunReader(tmp_path / "run")
    (trajectory,) = reader.trajectories()
    episode = trajectory.episode
    assert len(endpoint.bodies) == len(episode.steps) == 6
    for step, body in zip(episode.steps, endpoint.bodies, strict=True):
        assert msgspec.json.encode(request_of(step, episode.policy, reader.image)) == body
        assert "Let me see" not in str(step.messages)
        assert all(message["content"] for message in msgspec.json.decode(body)["messages"])


async def test_sampling_and_detail_are_the_profiles(endpoint: Copies, tmp_path: Path) -> None:
    async def sent(model: str, sampling: Sampling | None = None) -> dict[str, Any]:
        chat = ChatConfig(base_url=endpoint.url("copies"), model=model, sampling=sampling or Sampling())
        async with await RunWriter.create(tmp_path / model, {}, [replace(task(), id="t")]) as store:
            await play(endpoint, store, chat)
        body: dict[str, Any] = msgspec.json.decode(endpoint.bodies[-1])
        return body

    qwen = await sent("qwen3-vl")
    assert (qwen["top_k"], qwen["max_tokens"]) == (2, 3072)
    assert "detail" not in str(qwen["messages"][-1]["content"][1]["image_url"].keys())
    gpt = await sent("gpt-5", Sampling(max_tokens=99))
    assert gpt["max_completion_tokens"] == 99
    assert not {"max_tokens", "temperature", "top_p"} & gpt.keys()
    assert gpt["messages"][-1]["content"][1]["image_url"]["detail"] == "high"
    assert '"element"' in gpt["messages"][0]["content"]


async def test_how_a_memory_was_mended_is_in_the_store(endpoint: Copies, tmp_path: Path) -> None:
    chat = ChatConfig(base_url=endpoint.url("copies"), model="qwen3-vl")
    async with await RunWriter.create(tmp_path / "run", {}, [replace(task(), id="t")]) as store:
        await play(endpoint, store, chat)
    (trajectory,) = RunReader(tmp_path / "run").trajectories()
    mended = [step.revision.rewritten if step.revision else None for step in trajectory.episode.steps]
    assert mended == [None, ("price",), None, ("price",), ("price",), ("price",)]
    assert '"price": "0 €", "price (2)": "1 €"' in str(trajectory.episode.steps[-1].messages)
