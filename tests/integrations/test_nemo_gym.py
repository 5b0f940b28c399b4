"""NeMo Gym runs episodes of its agent server, and masks those without a reward."""

from __future__ import annotations

import asyncio
import json
import warnings
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, ClassVar
from unittest.mock import MagicMock

import httpx
import pytest
from tests.integrations.engine import example, texts_of

import webgym
from webgym import Action, Answer, RunConfig, Scroll
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool

pytest.importorskip("nemo_gym", reason="nemo-gym is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    from nemo_gym.server_utils import ServerClient

    from webgym.integrations.nemo_gym import (
        WebGymAgent,
        WebGymAgentConfig,
        WebGymRunRequest,
        WebGymRunResponse,
        nemo_gym_rows,
    )

pytestmark = pytest.mark.filterwarnings("ignore")  # its own


class ModelServer:
    """What NeMo Gym's client of servers gets from a model: one text after another."""

    def __init__(self, texts: Sequence[str], **last: Any) -> None:
        self.texts, self.last = list(texts), last
        self.requests: list[dict[str, Any]] = []

    async def post(self, *, server_name: str, url_path: str, json: Any, **given: Any) -> Any:
        assert (server_name, url_path) == ("model", "/v1/responses")
        text = self.texts[min(len(self.requests), len(self.texts) - 1)]
        self.requests.append(json.model_dump())
        return Answered(text, **(self.last if len(self.requests) >= len(self.texts) else {}))


class SilentModelServer(ModelServer):
    """Never answers."""

    def __init__(self) -> None:
        super().__init__([])
        self.asked = asyncio.Event()

    async def post(self, **given: Any) -> Any:
        self.asked.set()
        await asyncio.Event().wait()


class Answered:
    """An answer of that client."""

    ok, status = True, 200
    cookies: ClassVar[dict[str, str]] = {}

    def __init__(self, text: str, **more: Any) -> None:
        content = [{"type": "output_text", "text": text, "annotations": []}]
        message = {
            "id": "m",
            "type": "message",
            "role": "assistant",
            "status": "completed",
            "content": content,
        }
        self._said = {
            "id": "r",
            "created_at": 0,
            "model": "tiny",
            "object": "response",
            "output": [message],
            "parallel_tool_calls": False,
            "tool_choice": "auto",
            "tools": [],
            **more,
        }

    async def read(self) -> bytes:
        return json.dumps(self._said).encode()


def agent(pool: webgym.EnvironmentPool, model: ModelServer) -> WebGymAgent:
    config = WebGymAgentConfig(
        host="127.0.0.1",
        port=1,
        entrypoint="app.py",
        name="webgym",
        model_server={"type": "responses_api_models", "name": "model"},
    )
    client = MagicMock(spec=ServerClient)
    client.global_config_dict = {}
    client.post = model.post
    made = WebGymAgent(config=config, server_client=client)
    made._pool = pool
    return made


def row(task_id: str) -> dict[str, Any]:
    return {"responses_create_params": {"input": []}, "task_id": task_id}


async def ran(made: WebGymAgent, task_id: str) -> dict[str, Any]:
    """The server's answer to ``/run``."""
    transport = httpx.ASGITransport(made.setup_webserver())
    async with httpx.AsyncClient(transport=transport, base_url="http://agent.test") as http:
        answered = await http.post("/run", json=row(task_id))
    assert answered.status_code == 200, answered.text
    return answered.json()


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    async with webgym.EnvironmentPool(**given) as pool:

        async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
            told = await ran(agent(pool, ModelServer(texts_of(actions))), task_id)
            return Told([] if told["mask_sample"] else [told["reward"]])

        async def begin(task_id: str) -> asyncio.Future[WebGymRunResponse]:
            # The handler alone: NeMo Gym's web server holds every request until it is answered.
            model = SilentModelServer()
            body = WebGymRunRequest.model_validate(row(task_id))
            running = asyncio.ensure_future(agent(pool, model).run(body))
            await model.asked.wait()
            return running

        yield Adapted(play, begin)


async def test_it_keeps_the_environments_promises() -> None:
    def rows(name: str, config: RunConfig) -> list[str]:
        return [row["task_id"] for row in nemo_gym_rows(name, split="all", count=6, config=config)]

    assert await check_adapter(adapter, rows=rows) == []


async def test_an_episode(tmp_path: Path) -> None:
    model = ModelServer(texts_of([Scroll("down"), Answer("right")]))
    async with webgym.EnvironmentPool(**stand_in_pool(tmp_path)) as pool:
        told = await ran(agent(pool, model), "check-3")
    assert (told["reward"], told["outcome"], told["steps"]) == (1.0, "success", 2)
    assert (told["mask_sample"], told["failure_kind"]) == (False, None)
    assert [item["content"][0]["text"] for item in told["response"]["output"]] == model.texts
    parts = [part for message in model.requests[0]["input"][1:] for part in message["content"]]
    [picture] = [part for part in parts if part["type"] == "input_image"]
    assert picture["image_url"].startswith("data:image/png;base64,")


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        ({"fails": True}, "webgym:environment_error"),
        ({"fault": "judge"}, "webgym:judge_error"),
        ({"fault": "blocked"}, "webgym:blocked"),
    ],
)
async def test_a_fault_is_masked(tmp_path: Path, fault: dict[str, Any], kind: str) -> None:
    model = ModelServer(texts_of([Scroll("down"), Answer("right")]))
    async with webgym.EnvironmentPool(**stand_in_pool(tmp_path, **fault)) as pool:
        told = await ran(agent(pool, model), "check-3")
    assert (told["mask_sample"], told["failure_kind"]) == (True, kind)
    assert told["failure_reason"]


@pytest.mark.parametrize(
    ("ended", "outcome"),
    [
        ({"status": "incomplete", "incomplete_details": {"reason": "content_filter"}}, "policy_error"),
        ({"status": "failed"}, "policy_error"),
        ({"status": "incomplete", "incomplete_details": {"reason": "max_output_tokens"}}, "truncated"),
    ],
)
async def test_a_reply_that_the_model_did_not_end_is_no_step_of_its_own(
    tmp_path: Path, ended: dict[str, Any], outcome: str
) -> None:
    model = ModelServer([*texts_of([Scroll("down")]), ""], **ended)
    async with webgym.EnvironmentPool(**stand_in_pool(tmp_path)) as pool:
        told = await ran(agent(pool, model), "check-3")
    assert (told["outcome"], told["mask_sample"]) == (outcome, outcome == "policy_error")


@pytest.mark.browser
async def test_the_example_in_a_real_browser(tmp_path: Path) -> None:
    served = example("nemo_gym_agent")
    served.main(str(tmp_path / "rows.jsonl"), "offline-small-v2", count=1)
    row = json.loads((tmp_path / "rows.jsonl").read_text())
    model = ModelServer(texts_of([Scroll("down"), Answer("no idea")]))
    async with webgym.EnvironmentPool("offline-small-v2", size=1) as pool:
        told = await ran(agent(pool, model), row["task_id"])
    assert (told["reward"], told["outcome"]) == (0.0, "failure")
    assert served.WebGymAgent is WebGymAgent
