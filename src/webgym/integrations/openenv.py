"""OpenEnv (tested with openenv 0.10.0): a server whose sessions are episodes in browsers, and its client::

    app = create_app("offline-v2", size=8)        # uvicorn FILE:app

    async with WebGymClient(base_url="http://127.0.0.1:8000") as env:
        result = await env.reset(task_id="…")
        result = await env.step(WebGymAction(action={"name": "scroll", "direction": "down"}))

Screenshots are base64 with their MIME type. An episode without a reward ends with the reward ``None``, and
``outcome`` has the reason.
"""

from __future__ import annotations

import asyncio
import base64
import math
from contextlib import AsyncExitStack
from typing import Any

import msgspec
from openenv.core.client_types import StepResult
from openenv.core.env_client import EnvClient
from openenv.core.env_server import http_server, interfaces, types

from webgym import Action, Environment, EnvironmentPool, UsageError, View, visible


class WebGymAction(types.Action):
    """An action: exactly one of the two fields.

    Attributes:
        reply: a model's reply in the prompt's format, parsed as in a run.
        action: an action by name and fields, such as ``{"name": "left_click", "target": {"coordinate": [500,
            40]}}``.
    """

    reply: str | None = None
    action: dict[str, Any] | None = None


class WebGymObservation(types.Observation):
    """An observation, with ``done`` and ``reward``.

    Attributes:
        image: the screenshot, base64.
        mime_type: of the screenshot.
        url, title: of the page.
        instruction: of the task.
        task_id: of the task.
        outcome: at the end of the episode, one of the eight outcomes; else ``None``.
        notices: events that the screenshot does not show, such as a dialog that was closed.
    """

    image: str = ""
    mime_type: str = "image/png"
    url: str = ""
    title: str = ""
    instruction: str = ""
    task_id: str = ""
    outcome: str | None = None
    notices: list[str] = []  # noqa: RUF012 (a field)


class WebGymEnvironment(interfaces.Environment):
    """A session, which uses one browser of the pool from its first reset on.

    Args:
        pool: shared by all sessions of a server.
    """

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self, pool: EnvironmentPool) -> None:
        super().__init__()
        self._pool = pool
        self._stack = AsyncExitStack()
        self._env: Environment | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._state = types.State(episode_id=None, step_count=0)

    async def reset_async(
        self,
        seed: int | None = None,
        episode_id: str | None = None,
        task_id: str | None = None,
        **kwargs: Any,
    ) -> WebGymObservation:
        """Start an episode; waits while all browsers are in use.

        Args:
            seed: of the order of tasks.
            episode_id: ignored; WebGym's own id is used.
            task_id: id of the task; ``None`` for the next one.
            kwargs: ignored.
        """
        self._loop = asyncio.get_running_loop()
        if self._env is None:
            self._env = await self._stack.enter_async_context(self._pool.environment())
        options = {} if task_id is None else {"task_id": task_id}
        view, info = await self._env.reset(seed=seed, options=options)
        self._state = types.State(episode_id=self._env.episode_id, step_count=0)
        return _observation(view, info)

    async def step_async(
        self, action: WebGymAction, timeout_s: float | None = None, **kwargs: Any
    ) -> WebGymObservation:
        """Carry out an action.

        Args:
            action: a reply or an action.
            timeout_s: ignored, because the settings have limits for every operation.
            kwargs: ignored.
        """
        if self._env is None:
            raise UsageError("there is no episode to step", hint="call reset first")
        view, reward, terminated, truncated, info = await self._env.step(_converted(action))
        self._state.step_count += 1
        is_over = terminated or truncated
        return _observation(view, info, None if math.isnan(reward) else reward, is_over)

    def reset(self, seed: int | None = None, episode_id: str | None = None, **kwargs: Any) -> Any:
        """The server calls :meth:`reset_async`."""
        raise NotImplementedError("call reset_async")

    def step(self, action: Any, timeout_s: float | None = None, **kwargs: Any) -> Any:
        """The server calls :meth:`step_async`."""
        raise NotImplementedError("call step_async")

    @property
    def state(self) -> types.State:
        """The id of the episode, and the number of steps so far."""
        return self._state

    def close(self) -> None:
        """Release the browser, on the server's event loop; may be called from any thread."""
        if self._loop is not None and not self._loop.is_closed():
            asyncio.run_coroutine_threadsafe(self._stack.aclose(), self._loop)


def _converted(action: WebGymAction) -> Action | str:
    if (action.reply is None) == (action.action is None):
        raise UsageError("give either a reply or an action")
    if action.reply is not None:
        return action.reply
    try:
        converted: Action = msgspec.convert(action.action, Action)
    except msgspec.ValidationError as error:
        raise UsageError(f"invalid action: {error}") from None
    return converted


def _observation(
    view: View, info: dict[str, Any], reward: float | None = None, done: bool = False
) -> WebGymObservation:
    seen = view.observation
    return WebGymObservation(
        image=base64.b64encode(view.image).decode(),
        mime_type="image/png" if view.image.startswith(b"\x89PNG") else "image/jpeg",
        url=seen.url,
        title=visible(seen.title),
        instruction=info["instruction"],
        task_id=info["task_id"],
        notices=[visible(notice.text) for notice in seen.notices],
        outcome=str(info["outcome"]) if done else None,
        reward=reward,
        done=done,
    )


def create_app(
    name: str = "offline-v2", *, size: int = 8, pool: EnvironmentPool | None = None, **options: Any
) -> Any:
    """A FastAPI application.

    Args:
        name: name of the tasks, as for :func:`webgym.make`.
        size: number of browsers, and so of concurrent sessions.
        pool: an existing pool to use, which the caller closes; ``None`` creates one from the other arguments.
        options: further arguments of :class:`webgym.EnvironmentPool`.
    """
    shared = pool or EnvironmentPool(name, size=size, **options)
    app = http_server.create_fastapi_app(
        lambda: WebGymEnvironment(shared), WebGymAction, WebGymObservation, max_concurrent_envs=size
    )
    if pool is None:
        app.router.add_event_handler("shutdown", shared.close)
    return app


class WebGymClient(EnvClient[WebGymAction, WebGymObservation, types.State]):
    """A client of a server made by :func:`create_app`, with typed observations that include screenshots."""

    def _step_payload(self, action: WebGymAction) -> dict[str, Any]:
        payload: dict[str, Any] = action.model_dump(exclude_none=True)
        return payload

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[WebGymObservation]:
        outcome = {"reward": payload.get("reward"), "done": payload.get("done", False)}
        observation = WebGymObservation(**{**payload.get("observation", {}), **outcome})
        return StepResult(observation=observation, **outcome)

    def _parse_state(self, payload: dict[str, Any]) -> types.State:
        return types.State(**payload)
