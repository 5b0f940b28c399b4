"""SkyRL (tested with skyrl-gym 0.4.0): an environment with screenshots as parts of OpenAI messages::

    skyrl_gym.register(id="webgym", entry_point="webgym.integrations.skyrl_gym:WebGymEnv")

The model writes replies in the prompt's format, and each step returns the next screenshot, so an episode is
one growing conversation, as SkyRL expects. SkyRL requires a number as reward, so an episode without one
raises :class:`NoReward`.

The environment variables ``WEBGYM_TASKS`` (default ``offline-v2``) and ``WEBGYM_SPLIT`` select the tasks, and
``WEBGYM_BROWSERS`` sets the number of browsers of each process.
"""

from __future__ import annotations

import math
import threading
from contextlib import AsyncExitStack
from typing import Any

from skyrl_gym.envs.base_text_env import BaseTextEnv, BaseTextEnvStepOutput

from webgym import Environment, EnvironmentPool, LoopThread, UsageError, WebGymError, task_rows
from webgym.integrations.shared import NoReward as NoReward
from webgym.integrations.shared import chosen_by_environment, parts, why_none

ENV_CLASS = "webgym"
"""Name of the environment in the rows of :func:`skyrl_rows`."""


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
            _browsers = Browsers(**chosen_by_environment())
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
                raise NoReward(f"{info['task_id']} ended as {info['outcome']}: {why_none(info)}")
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
    content: list[dict[str, Any]] = [
        {"type": "text", "text": value}
        if kind == "text"
        else {"type": "image_url", "image_url": {"url": value}}
        for kind, value in parts(message, info["images"])
    ]
    return {"role": message.role, "content": content}
