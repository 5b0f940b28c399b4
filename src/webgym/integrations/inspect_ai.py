"""inspect_ai (tested with inspect_ai 0.3.285): an evaluation of WebGym's own agent with any of its models::

    from inspect_ai import eval
    from webgym.integrations.inspect_ai import webgym_task

    eval(webgym_task("offline-v1", count=50), model="openai/gpt-5", max_samples=8)

or on the command line, from a file that imports it: ``inspect eval FILE.py -T count=50 --model …``. A sample
whose website blocked the agent, or whose environment, policy or judge failed, is *unscored*, never a 0.
"""

from __future__ import annotations

import base64
import math
import uuid
from typing import Any, Final, Literal

from inspect_ai import Task, task
from inspect_ai.dataset import MemoryDataset, Sample
from inspect_ai.hooks import Hooks, TaskEnd, hooks
from inspect_ai.model import (
    ChatMessage,
    ChatMessageAssistant,
    ChatMessageSystem,
    ChatMessageUser,
    ContentImage,
    ContentText,
    get_model,
)
from inspect_ai.scorer import Metric, SampleScore, Score, Scorer, Target, metric, scorer
from inspect_ai.solver import Generate, Solver, TaskState, solver

from webgym import EnvironmentPool, UsageError, WebGymError, task_rows

_KEY: Final = "webgym"
_pools: dict[str, EnvironmentPool] = {}
"""Of evaluations that run, by the name that their logs carry."""

_ROLES: Final[dict[str, Any]] = {
    "system": ChatMessageSystem,
    "user": ChatMessageUser,
    "assistant": ChatMessageAssistant,
}


@task
def webgym_task(
    name: str = "offline-v1",
    split: Literal["train", "test", "all"] = "test",
    count: int = 20,
    browsers: int = 4,
    **given: Any,
) -> Task:
    """Tasks, WebGym's agent, and its judge.

    Args:
        name: of the tasks, as for :func:`webgym.make`.
        split: of the tasks.
        count: how many, drawn as for a run.
        browsers: episodes at the same time; as many as inspect's ``max_samples``.
        given: more of :class:`webgym.EnvironmentPool`'s arguments.
    """
    rows = task_rows(name, split=split, count=count, config=given.get("config"))
    samples = [
        Sample(id=row["task_id"], input=row["instruction"], metadata={"website": row["website"]})
        for row in rows
    ]
    pool = uuid.uuid4().hex
    _pools[pool] = EnvironmentPool(name, size=browsers, split=split, **given)
    return Task(
        dataset=MemoryDataset(samples, name=name),
        solver=web_agent(pool),
        scorer=web_judge(),
        metadata={_KEY: pool},
    )


@solver
def web_agent(pool: str) -> Solver:
    """Plays the sample's task: the messages are those of a run, with its window of history."""

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        del generate  # of the conversation, which a window is not
        told = {"outcome": "environment_error", "reward": math.nan, "why": ""}
        async with _pools[pool].environment() as env:
            try:
                _, info = await env.reset(options={"task_id": str(state.sample_id)})
            except UsageError:
                raise
            except WebGymError as error:
                state.store.set(_KEY, told | {"why": error.message})
                return state
            reward = math.nan
            while not info["is_over"]:
                asked = _messages(info)
                state.output = await get_model().generate(asked)
                state.messages = [*asked, state.output.message]
                _, reward, _, _, info = await env.step(state.output.completion)
        failure = info["failure"]
        told = {
            "outcome": str(info["outcome"]),
            "reward": reward,
            "why": failure["message"] if failure else "",
            "answer": info["trajectory"].episode.answer or "",
        }
        state.store.set(_KEY, told)
        return state

    return solve


def _messages(info: dict[str, Any]) -> list[ChatMessage]:
    made = []
    for message in info["messages"]:
        content: list[ContentText | ContentImage] = []
        for part in message.content:
            text = getattr(part, "text", None)
            content.append(
                ContentImage(image=_data_url(info["images"][part.screenshot]))
                if text is None
                else ContentText(text=text)
            )
        made.append(_ROLES[message.role](content=content))
    return made


def _data_url(image: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"


@metric
def success_rate() -> Metric:
    """Share of successes among the samples that have a score; NaN where none has."""

    def rate(scores: list[SampleScore]) -> float:
        found = [each.score.as_float() for each in scores]
        return sum(found) / len(found) if found else math.nan

    return rate


@scorer(metrics=[success_rate()])
def web_judge() -> Scorer:
    """1 or 0 by WebGym's judge; unscored where there is no reward, also for a sample that a limit ended."""

    async def score(state: TaskState, target: Target) -> Score:
        del target  # the judge knows it
        told = state.store.get(_KEY)
        if told is None:
            return Score.unscored(
                explanation="a limit of inspect ended the sample before the episode was over"
            )
        if math.isnan(told["reward"]):
            return Score.unscored(explanation=f"{told['outcome']}: {told['why']}", metadata=told)
        return Score(value=told["reward"], answer=told["answer"], explanation=told["outcome"])

    return score


@hooks(name="webgym", description="Stops WebGym's browsers at the end of an evaluation.")
class StopBrowsers(Hooks):
    """inspect has no end of a task in a task itself."""

    async def on_task_end(self, data: TaskEnd) -> None:
        """Close the evaluation's pool."""
        pool = _pools.pop((data.log.eval.metadata or {}).get(_KEY, ""), None)
        if pool is not None:
            await pool.close()
