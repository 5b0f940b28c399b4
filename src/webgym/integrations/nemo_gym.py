"""NeMo Gym (tested with nemo-gym 0.7.0): an agent server whose ``/run`` is an episode in a browser. In a
project of NeMo Gym's, ``responses_api_agents/webgym/app.py`` is::

    from webgym.integrations.nemo_gym import WebGymAgent

    if __name__ == "__main__":
        WebGymAgent.run_webserver()

The model server is asked with the messages of a run, and so with WebGym's window of history. NeMo Gym has no
reward but a number: an episode without one is masked (``mask_sample``), its word for a reward that measures
nothing, and ``failure_kind`` says which: ``webgym:blocked``, ``webgym:environment_error``,
``webgym:policy_error`` or ``webgym:judge_error``.
"""

from __future__ import annotations

import base64
import math
from typing import Any, Literal

from fastapi import Body
from nemo_gym.base_resources_server import BaseRunRequest, BaseVerifyResponse
from nemo_gym.base_responses_api_agent import BaseResponsesAPIAgentConfig, SimpleResponsesAPIAgent
from nemo_gym.config_types import ModelServerRef
from nemo_gym.openai_utils import NeMoGymResponse, NeMoGymResponseCreateParamsNonStreaming
from nemo_gym.server_utils import get_response_json, raise_for_status
from pydantic import ConfigDict, PrivateAttr

from webgym import EnvironmentPool, UsageError, WebGymError, task_rows


class WebGymAgentConfig(BaseResponsesAPIAgentConfig):
    """Of the agent server.

    Attributes:
        model_server: that is asked.
        tasks: their name, as for :func:`webgym.make`.
        split: of the tasks.
        browsers: of this server, and so its episodes at the same time; further ones wait.
    """

    model_server: ModelServerRef
    tasks: str = "offline-v1"
    split: Literal["train", "test", "all"] = "train"
    browsers: int = 8


class WebGymRunRequest(BaseRunRequest):
    """A row of :func:`nemo_gym_rows`."""

    model_config = ConfigDict(extra="allow")
    task_id: str


class WebGymRunResponse(BaseVerifyResponse):
    """An episode.

    Attributes:
        task_id: of its task.
        outcome: one of eight.
        steps: that it took.
    """

    task_id: str
    outcome: str
    steps: int


class WebGymAgent(SimpleResponsesAPIAgent):
    """Plays whole episodes."""

    ray_enabled = False
    config: WebGymAgentConfig
    _pool: EnvironmentPool | None = PrivateAttr(None)

    def pool(self) -> EnvironmentPool:
        """Of this server, made when it is first asked for; it stays until the server ends."""
        if self._pool is None:
            config = self.config
            self._pool = EnvironmentPool(config.tasks, size=config.browsers, split=config.split)
        return self._pool

    async def responses(self, body: NeMoGymResponseCreateParamsNonStreaming = Body()) -> NeMoGymResponse:  # noqa: B008
        """Not here: the messages come from the browser.

        Raises:
            UsageError: always.
        """
        raise UsageError("the agent plays whole episodes", hint="post to /run")

    async def run(self, body: WebGymRunRequest = Body()) -> WebGymRunResponse:  # noqa: B008
        """Play the row's task.

        Args:
            body: the row; its ``responses_create_params`` are those of every request, but for the input.

        Returns:
            The reward, and all replies as the output of one response.

        Raises:
            UsageError: there is no such task.
            aiohttp.ClientError: the model server failed; NeMo Gym counts a failed rollout, and no reward.
        """
        reward, replies = math.nan, list[NeMoGymResponse]()
        async with self.pool().environment() as env:
            try:
                _, info = await env.reset(options={"task_id": body.task_id})
            except UsageError:
                raise
            except WebGymError as error:
                told = {"task_id": body.task_id, "outcome": "environment_error", "steps": 0}
                return _told(body, replies, math.nan, error.message, told)
            while not info["is_over"]:
                replies.append(await self._ask(body, info))
                _, reward, _, _, info = await env.step(_text(replies[-1]))
        why = info["failure"]["message"] if info["failure"] else "the website kept the agent out"
        told = {"task_id": body.task_id, "outcome": str(info["outcome"]), "steps": info["step"]}
        return _told(body, replies, reward, why, told)

    async def _ask(self, body: WebGymRunRequest, info: dict[str, Any]) -> NeMoGymResponse:
        said = [_message(message, info["images"]) for message in info["messages"]]
        asked = await self.server_client.post(
            server_name=self.config.model_server.name,
            url_path=self.url_path_for_run("/v1/responses", body),
            json=body.responses_create_params.model_copy(update={"input": said}),
        )
        await raise_for_status(asked)
        return NeMoGymResponse.model_validate(await get_response_json(asked))


def _told(
    body: WebGymRunRequest,
    replies: list[NeMoGymResponse],
    reward: float,
    why: str,
    told: dict[str, Any],
) -> WebGymRunResponse:
    if math.isnan(reward):  # it has to be a number: the mask says that it is none
        told |= {"mask_sample": True, "failure_kind": f"webgym:{told['outcome']}", "failure_reason": why}
        reward = 0.0
    said: Any = {"id": "none", "created_at": 0, "model": "none", "object": "response"}
    said |= {"parallel_tool_calls": False, "tool_choice": "none", "tools": []}
    if replies:
        said = replies[-1].model_dump()
    said["output"] = [item.model_dump() for reply in replies for item in reply.output]
    params = body.responses_create_params
    return WebGymRunResponse(responses_create_params=params, response=said, reward=reward, **told)


def _text(reply: NeMoGymResponse) -> str:
    messages = [item for item in reply.output if item.type == "message"]
    return "".join(
        part.text for message in messages for part in message.content if part.type == "output_text"
    )


def _message(message: Any, images: dict[str, bytes]) -> dict[str, Any]:
    if message.role == "assistant":  # its content is text alone
        return {"role": "assistant", "content": "".join(part.text for part in message.content)}
    return {"role": message.role, "content": [_part(part, images) for part in message.content]}


def _part(part: Any, images: dict[str, bytes]) -> dict[str, Any]:
    text = getattr(part, "text", None)
    if text is not None:
        return {"type": "input_text", "text": text}
    url = f"data:image/png;base64,{base64.b64encode(images[part.screenshot]).decode()}"
    return {"type": "input_image", "image_url": url, "detail": "auto"}


def nemo_gym_rows(name: str = "offline-v1", *, agent: str = "webgym", **given: Any) -> list[dict[str, Any]]:
    """A dataset for NeMo Gym: rows with ``responses_create_params``, ``task_id`` and ``agent_ref``.

    Args:
        name: of the tasks, as for :func:`webgym.make`.
        agent: name of the agent server.
        given: arguments of :func:`webgym.task_rows`, such as ``count`` and ``split``.
    """
    return [
        {
            "responses_create_params": {"input": [{"role": "user", "content": row["instruction"]}]},
            "task_id": row["task_id"],
            "agent_ref": {"type": "responses_api_agents", "name": agent},
        }
        for row in task_rows(name, **given)
    ]
