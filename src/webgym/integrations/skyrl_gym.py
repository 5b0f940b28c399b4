"""SkyRL (tested with skyrl-gym 0.4.0): an environment with screenshots as parts of OpenAI messages::

    skyrl_gym.register(id="webgym", entry_point="webgym.integrations.skyrl_gym:WebGymEnv")

The model writes replies in the prompt's format, and each step returns the next screenshot, so an episode is
one growing conversation, as SkyRL expects. SkyRL requires a number as reward, so an episode without one
raises :class:`NoReward`.

The environment variables ``WEBGYM_TASKS`` (default ``offline-v2``) and ``WEBGYM_SPLIT`` select the tasks, and
``WEBGYM_BROWSERS`` sets the number of browsers of each process.
"""

from __future__ import annotations

import base64
import math
import os
import threading
from contextlib import AsyncExitStack
from typing import Any

from skyrl_gym.envs.base_text_env import BaseTextEnv, BaseTextEnvStepOutput

from webgym import Environment, EnvironmentPool, LoopThread, UsageError, WebGymError, task_rows

ENV_CLASS = "webgym"
"""Name of the environment in the rows of :func:`skyrl_rows`."""


class NoReward(WebGymError):
    """The website blocked the agent, or environment, policy or judge failed: it is neither a success nor a
    failure."""

    code = "no_reward"


class Browsers:
    """Browsers shared by the environments of a process, with their own event loop.

    Args:
        name: name of the tasks, as for :func:`webgym.make`.
        size: number of browsers; further episodes wait.
        options: further arguments of :class:`webgym.EnvironmentPool`.
    """

    def __init__(self, name: str = "offline-v2", *, size: int = 8, **options: Any) -> None:
        self.pool = EnvironmentPool(name, size=size, **options)
        self.loop = LoopThread(self.pool.close)

    def close(self) -> None:
        """Stop the browsers. May be called twice."""
        self.loop.close()


_lock = threading.Lock()  # SkyRL calls environments from threads
_browsers: Browsers | None = None


def the_browsers() -> Browsers:
    """The browsers of this process, created at the first call."""
    global _browsers  # SkyRL creates environments by name and has no place for shared state
    with _lock:
        if _browsers is None:
            split: Any = os.environ.get("WEBGYM_SPLIT", "train")
            size = int(os.environ.get("WEBGYM_BROWSERS", "8"))
            _browsers = Browsers(os.environ.get("WEBGYM_TASKS", "offline-v2"), size=size, split=split)
        return _browsers


class WebGymEnv(BaseTextEnv):
    """An environment for one episode.

    Args:
        env_config: SkyRL's configuration; ignored.
        extras: fields of the dataset's row, with ``task_id``.
        browsers: used instead of the process's shared ones.
    """

    def __init__(
        self, env_config: Any = None, extras: dict[str, Any] | None = None, browsers: Browsers | None = None
    ) -> None:
        super().__init__()
        self._task_id = (extras or {}).get("task_id")
        self._browsers = browsers or the_browsers()
        self._stack = AsyncExitStack()
        self._env: Environment | None = None
        self._metadata: dict[str, Any] = {}

    def init(self, prompt: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        """Start the row's task; waits while all browsers are in use.

        Args:
            prompt: prompt of the dataset's row; replaced by WebGym's.

        Returns:
            The messages of WebGym's prompt with the start page; and a dict with the task's id and
            instruction.

        Raises:
            NoReward: no browser was available, or the start page could not be opened.
            UsageError: there is no task with this id.
        """
        del prompt
        try:
            info = self._browsers.loop.run(self._begin())
        except UsageError:
            self.close()
            raise
        except WebGymError as error:
            self.close()
            raise NoReward(f"{self._task_id}: {error.message}") from error
        self.max_turns = info["budget"]
        metadata = {"task_id": info["task_id"], "instruction": info["instruction"]}
        return [_openai(message, info) for message in info["messages"]], metadata

    def step(self, action: str) -> BaseTextEnvStepOutput:
        """Carry out the action in a reply.

        Args:
            action: the model's reply.

        Returns:
            The next screenshot as a user message, and at the end the reward, 1.0 or 0.0.

        Raises:
            NoReward: the episode ended without a reward.
            UsageError: there is no episode.
        """
        if self._env is None:
            raise UsageError("there is no episode to step", hint="call init first")
        _, reward, terminated, truncated, info = self._browsers.loop.run(self._env.step(action))
        self.turns += 1
        is_over = terminated or truncated
        if is_over:
            self.close()
            self._metadata = {"outcome": str(info["outcome"])}
            if math.isnan(reward):
                failure = info["failure"]
                why = f": {failure['message']}" if failure else ""
                raise NoReward(f"{info['task_id']} ended as {info['outcome']}{why}")
        return BaseTextEnvStepOutput(
            observations=[] if is_over else [_openai(info["messages"][-1], info)],
            reward=reward if is_over else 0.0,
            done=is_over,
            metadata=dict(self._metadata),
        )

    def close(self) -> None:
        """Release the browser. May be called twice."""
        self._env = None
        self._browsers.loop.run(self._stack.aclose())

    async def _begin(self) -> dict[str, Any]:
        self._env = await self._stack.enter_async_context(self._browsers.pool.environment())
        options = {} if self._task_id is None else {"task_id": self._task_id}
        _, info = await self._env.reset(options=options)
        return info


def skyrl_rows(name: str = "offline-v2", **options: Any) -> list[dict[str, Any]]:
    """A dataset for SkyRL: rows with ``prompt``, ``env_class`` and ``task_id``.

    Args:
        name: name of the tasks, as for :func:`webgym.make`.
        options: arguments of :func:`webgym.task_rows`, such as ``count`` and ``split``.
    """
    return [
        {
            "prompt": [{"role": "user", "content": row["instruction"]}],
            "env_class": ENV_CLASS,
            "task_id": row["task_id"],
        }
        for row in task_rows(name, **options)
    ]


def _openai(message: Any, info: dict[str, Any]) -> dict[str, Any]:
    return {"role": message.role, "content": [_part(part, info["images"]) for part in message.content]}


def _part(part: Any, images: dict[str, bytes]) -> dict[str, Any]:
    text = getattr(part, "text", None)
    if text is not None:
        return {"type": "text", "text": text}
    url = f"data:image/png;base64,{base64.b64encode(images[part.screenshot]).decode()}"
    return {"type": "image_url", "image_url": {"url": url}}
