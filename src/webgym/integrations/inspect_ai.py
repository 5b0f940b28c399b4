"""inspect_ai (tested with inspect_ai 0.3.285): an evaluation of WebGym's own agent with any of its models::

    from inspect_ai import eval
    from webgym.integrations.inspect_ai import webgym_task

    eval(webgym_task("offline-v2", count=50), model="openai/gpt-5", max_samples=8)

or on the command line, from a file that imports it: ``inspect eval FILE.py -T count=50 --model …``. A sample
whose website blocked the agent, or whose environment, policy or judge failed, is *unscored*, never a 0.
"""

from __future__ import annotations

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
    ModelOutput,
    get_model,
)
from inspect_ai.scorer import Metric, SampleScore, Score, Scorer, Target, metric, scorer
from inspect_ai.solver import Generate, Solver, TaskState, solver

from webgym import EnvironmentPool, Reply, task_rows
from webgym.integrations.shared import parts, play

_KEY: Final = "webgym"
_pools: dict[str, EnvironmentPool] = {}
"""Pools of running evaluations, by the key in their logs' metadata."""

_ROLES: Final[dict[str, Any]] = {
    "system": ChatMessageSystem,
    "user": ChatMessageUser,
    "assistant": ChatMessageAssistant,
}


@task
def webgym_task(
    name: str = "offline-v2",
    split: Literal["train", "test", "all"] = "test",
    count: int = 20,
    browsers: int = 4,
    **options: Any,
) -> Task:
    """An evaluation: tasks, WebGym's agent, and its judge.

    Args:
        name: name of the tasks, as for :func:`webgym.make`.
        split: of the tasks.
        count: number of tasks, drawn as for a run.
        browsers: number of concurrent episodes; should equal inspect's ``max_samples``.
        options: further arguments of :class:`webgym.EnvironmentPool`.
    """
    rows = task_rows(name, split=split, count=count, config=options.get("config"))
    samples = [
        Sample(id=row["task_id"], input=row["instruction"], metadata={"website": row["website"]})
        for row in rows
    ]
    pool = uuid.uuid4().hex
    _pools[pool] = EnvironmentPool(name, size=browsers, split=split, **options)
    return Task(
        dataset=MemoryDataset(samples, name=name),
        solver=web_agent(pool),
        scorer=web_judge(),
        metadata={_KEY: pool},
    )


@solver
def web_agent(pool: str) -> Solver:
    """Plays the sample's task, with the same messages as in a run, including its window of the history."""

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        del generate  # it would send the whole conversation, not the window of the history

        async def ask(info: dict[str, Any]) -> Reply:
            messages = _messages(info)
            state.output = await get_model().generate(messages)
            state.messages = [*messages, state.output.message]
            return Reply(state.output.completion, "external", finish_reason=_finish_reason(state.output))

        async with _pools[pool].environment() as env:
            played = await play(env, str(state.sample_id), ask)
        state.store.set(_KEY, played._asdict())
        return state

    return solve


def _finish_reason(output: ModelOutput) -> str:
    """What ended a reply. One without a token is not a model's own, whose end is a token."""
    usage = output.usage
    is_void = not output.completion and usage is not None and usage.output_tokens == 0
    return "abort" if is_void else output.stop_reason


def _messages(info: dict[str, Any]) -> list[ChatMessage]:
    chat: list[ChatMessage] = []
    for message in info["messages"]:
        content = [
            ContentText(text=value) if kind == "text" else ContentImage(image=value)
            for kind, value in parts(message, info["images"])
        ]
        chat.append(_ROLES[message.role](content=content))
    return chat


@metric
def success_rate() -> Metric:
    """Share of successes among the scored samples; NaN if there are none."""

    def rate(scores: list[SampleScore]) -> float:
        values = [sample.score.as_float() for sample in scores]
        return sum(values) / len(values) if values else math.nan

    return rate


@scorer(metrics=[success_rate()])
def web_judge() -> Scorer:
    """1 or 0 from WebGym's judge; unscored without a reward, and for a sample that was ended by a limit."""

    async def score(state: TaskState, target: Target) -> Score:
        del target  # the judge has the task's own
        result = state.store.get(_KEY)
        if result is None:
            return Score.unscored(
                explanation="a limit of inspect ended the sample before the episode was over"
            )
        if math.isnan(result["reward"]):
            return Score.unscored(explanation=f"{result['outcome']}: {result['why']}", metadata=result)
        return Score(value=result["reward"], answer=result["answer"], explanation=result["outcome"])

    return score


@hooks(name="webgym", description="Stops WebGym's browsers at the end of an evaluation.")
class StopBrowsers(Hooks):
    """Stops the browsers of an evaluation; inspect has no hook for this in the task itself."""

    async def on_task_end(self, data: TaskEnd) -> None:
        """Close the evaluation's pool."""
        pool = _pools.pop((data.log.eval.metadata or {}).get(_KEY, ""), None)
        if pool is not None:
            await pool.close()
