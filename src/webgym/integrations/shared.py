"""What several adapters share: whole episodes, messages for chat APIs, choices by environment variables."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Awaitable, Callable, Iterator, Mapping
from typing import Any, NamedTuple

from webgym import Environment, Reply, UsageError, WebGymError


class NoReward(WebGymError):
    """The website blocked the agent, or environment, policy or judge failed: it is neither a success nor a
    failure."""

    code = "no_reward"


class Ended(NamedTuple):
    """How an episode ended.

    Attributes:
        outcome: one of the eight outcomes.
        reward: 1.0 or 0.0; NaN for an episode without one.
        why: why there is no reward; empty if there is one.
        steps: number of steps.
        answer: the agent's; empty if there is none.
    """

    outcome: str
    reward: float
    why: str = ""
    steps: int = 0
    answer: str = ""


async def play(env: Environment, task_id: str, ask: Callable[[dict[str, Any]], Awaitable[Reply]]) -> Ended:
    """Play an episode of a task to its end.

    Args:
        env: the environment.
        task_id: id of the task.
        ask: returns the model's reply to ``messages`` and ``images`` of the given ``info``.

    Raises:
        UsageError: there is no task with this id.
        Exception: of ``ask``.
    """
    try:
        _, info = await env.reset(options={"task_id": task_id})
    except UsageError:
        raise
    except WebGymError as error:
        return Ended("environment_error", math.nan, error.message)
    reward = math.nan
    while not info["is_over"]:
        _, reward, _, _, info = await env.step(await ask(info))
    return Ended(
        str(info["outcome"]),
        reward,
        why_none(info) if math.isnan(reward) else "",
        info["step"],
        info["trajectory"].episode.answer or "",
    )


def why_none(info: Mapping[str, Any]) -> str:
    """Why an episode that is over has no reward."""
    failure = info["failure"]
    return str(failure["message"]) if failure else "the website blocked the agent"


def parts(message: Any, images: Mapping[str, bytes]) -> Iterator[tuple[str, str]]:
    """The parts of a message: ``("text", text)`` and ``("image", data URL)``."""
    for part in message.content:
        text = getattr(part, "text", None)
        yield ("image", data_url(images[part.screenshot])) if text is None else ("text", text)


def text_of(message: Any) -> str:
    """The text of a message without pictures, such as an assistant's."""
    return "".join(part.text for part in message.content)


def data_url(image: bytes) -> str:
    """A screenshot as a URL."""
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"


def chosen_by_environment() -> dict[str, Any]:
    """Arguments of a pool, for frameworks that leave no other place for them: ``WEBGYM_TASKS`` and
    ``WEBGYM_SPLIT`` select the tasks, ``WEBGYM_BROWSERS`` is the number of browsers of each process."""
    split: str = os.environ.get("WEBGYM_SPLIT", "train")
    size = int(os.environ.get("WEBGYM_BROWSERS", "8"))
    return {"name": os.environ.get("WEBGYM_TASKS", "offline-v2"), "split": split, "size": size}
