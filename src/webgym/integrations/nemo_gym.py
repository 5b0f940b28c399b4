"""NeMo Gym (tested with nemo-gym 0.7.0): an agent server whose ``/run`` is an episode in a browser. In a
project of NeMo Gym's, ``responses_api_agents/webgym/app.py`` is::

    from webgym.integrations.nemo_gym import WebGymAgent

    if __name__ == "__main__":
        WebGymAgent.run_webserver()

The model server is sent the same messages as in a run, with WebGym's window of the history. NeMo Gym requires
a number as reward, so an episode without a reward is masked (``mask_sample``), and ``failure_kind`` has the
reason: ``webgym:blocked``, ``webgym:environment_error``, ``webgym:policy_error`` or ``webgym:judge_error``.
"""

from __future__ import annotations

import math
from typing import Any, Literal

from fastapi import Body
from nemo_gym.base_resources_server import BaseRunRequest, BaseVerifyResponse
from nemo_gym.base_responses_api_agent import BaseResponsesAPIAgentConfig, SimpleResponsesAPIAgent
from nemo_gym.config_types import ModelServerRef
from nemo_gym.openai_utils import NeMoGymResponse, NeMoGymResponseCreateParamsNonStreaming
from nemo_gym.server_utils import get_response_json, raise_for_status
from pydantic import ConfigDict, PrivateAttr

from webgym import EnvironmentPool, Reply, UsageError, task_rows
from webgym.integrations.shared import Ended, parts, play, text_of


class WebGymAgentConfig(BaseResponsesAPIAgentConfig):
    """Settings of the agent server.

    Attributes:
        model_server: the model server.
        tasks: name of the tasks, as for :func:`webgym.make`.
        split: of the tasks.
        browsers: number of browsers, and so of concurrent episodes; further ones wait.
    """

    model_server: ModelServerRef
    tasks: str = "offline-v2"
    split: Literal["train", "test", "all"] = "train"
    browsers: int = 8


class WebGymRunRequest(BaseRunRequest):
    """A request to play an episode: a row of :func:`nemo_gym_rows`."""

    model_config = ConfigDict(extra="allow")
    task_id: str


class WebGymRunResponse(BaseVerifyResponse):
    """The result of an episode.

    Attributes:
        task_id: of its task.
        outcome: one of the eight outcomes.
        steps: number of steps.
    """

    task_id: str
    outcome: str
    steps: int


class WebGymAgent(SimpleResponsesAPIAgent):
    """An agent server that plays whole episodes."""

    ray_enabled = False
    config: WebGymAgentConfig
    _pool: EnvironmentPool | None = PrivateAttr(None)

    def pool(self) -> EnvironmentPool:
        """The browsers of this server, created at the first call and kept until the server ends."""
        if self._pool is None:
            config = self.config
            self._pool = EnvironmentPool(config.tasks, size=config.browsers, split=config.split)
        return self._pool

    async def responses(self, body: NeMoGymResponseCreateParamsNonStreaming = Body()) -> NeMoGymResponse:  # noqa: B008
        """Not supported: the messages come from the browser.

        Raises:
            UsageError: always.
        """
        raise UsageError("the agent plays whole episodes", hint="post to /run")

    async def run(self, body: WebGymRunRequest = Body()) -> WebGymRunResponse:  # noqa: B008
        """Play the row's task.

        Args:
            body: the row; its ``responses_create_params`` are used for every request, except the input.

        Returns:
            The reward, and all replies as the output of one response.

        Raises:
            UsageError: there is no task with this id.
            aiohttp.ClientError: the model server failed; NeMo Gym counts a failed rollout without a reward.
        """
        replies = list[NeMoGymResponse]()

        async def ask(info: dict[str, Any]) -> Reply:
            replies.append(await self._ask(body, info))
            return Reply(_text(replies[-1]), "external", finish_reason=_finish_reason(replies[-1]))

        async with self.pool().environment() as env:
            return _response(body, replies, await play(env, body.task_id, ask))

    async def _ask(self, body: WebGymRunRequest, info: dict[str, Any]) -> NeMoGymResponse:
        messages = [_message(message, info["images"]) for message in info["messages"]]
        response = await self.server_client.post(
            server_name=self.config.model_server.name,
            url_path=self.url_path_for_run("/v1/responses", body),
            json=body.responses_create_params.model_copy(update={"input": messages}),
        )
        await raise_for_status(response)
        return NeMoGymResponse.model_validate(await get_response_json(response))


def _response(body: WebGymRunRequest, replies: list[NeMoGymResponse], played: Ended) -> WebGymRunResponse:
    fields: dict[str, Any] = {"task_id": body.task_id, "outcome": played.outcome, "steps": played.steps}
    reward = played.reward
    if math.isnan(reward):  # NeMo Gym requires a number; the mask excludes it
        kind = f"webgym:{played.outcome}"
        fields |= {"mask_sample": True, "failure_kind": kind, "failure_reason": played.why}
        reward = 0.0
    combined: Any = {"id": "none", "created_at": 0, "model": "none", "object": "response"}
    combined |= {"parallel_tool_calls": False, "tool_choice": "none", "tools": []}
    if replies:
        combined = replies[-1].model_dump()
    combined["output"] = [item.model_dump() for reply in replies for item in reply.output]
    params = body.responses_create_params
    return WebGymRunResponse(responses_create_params=params, response=combined, reward=reward, **fields)


def _finish_reason(reply: NeMoGymResponse) -> str:
    if reply.incomplete_details is not None and reply.incomplete_details.reason:
        return reply.incomplete_details.reason
    return "stop" if reply.status in (None, "completed") else reply.status


def _text(reply: NeMoGymResponse) -> str:
    messages = [item for item in reply.output if item.type == "message"]
    return "".join(
        part.text for message in messages for part in message.content if part.type == "output_text"
    )


def _message(message: Any, images: dict[str, bytes]) -> dict[str, Any]:
    if message.role == "assistant":  # its content is only text
        return {"role": "assistant", "content": text_of(message)}
    content = [
        {"type": "input_text", "text": value}
        if kind == "text"
        else {"type": "input_image", "image_url": value, "detail": "auto"}
        for kind, value in parts(message, images)
    ]
    return {"role": message.role, "content": content}


def nemo_gym_rows(name: str = "offline-v2", *, agent: str = "webgym", **options: Any) -> list[dict[str, Any]]:
    """A dataset for NeMo Gym: rows with ``responses_create_params``, ``task_id`` and ``agent_ref``.

    Args:
        name: name of the tasks, as for :func:`webgym.make`.
        agent: name of the agent server.
        options: arguments of :func:`webgym.task_rows`, such as ``count`` and ``split``.
    """
    return [
        {
            "responses_create_params": {"input": [{"role": "user", "content": row["instruction"]}]},
            "task_id": row["task_id"],
            "agent_ref": {"type": "responses_api_agents", "name": agent},
        }
        for row in task_rows(name, **options)
    ]
