"""verifiers (tested with verifiers 0.4.0): taskset, environment and harness of its v1.

verifiers finds an environment by the name of a module that can be imported without dots, so a project that
uses this has a module of its own, such as ``webgym_tasks.py``::

    from webgym.integrations.verifiers import WebGymEnv, WebGymHarness, WebGymTaskset

    __all__ = ["WebGymEnv", "WebGymHarness", "WebGymTaskset"]

which ``PYTHONPATH=. vf-eval webgym-tasks --model …`` evaluates. The model is sent the same messages as in a
run, with WebGym's window of the history. verifiers' trace has a branch wherever that window moves; all
branches have the episode's reward. An episode without a reward ends with an error, which verifiers does not
count as a reward.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final, Literal

import verifiers.v1 as vf
from openai import AsyncOpenAI
from pydantic import Field

from webgym import EnvironmentPool, Reply, RunConfig, UsageError, task_rows
from webgym.integrations.shared import NoReward, parts, play, text_of

__all__ = ["WebGymEnv", "WebGymHarness", "WebGymTaskset"]

REWARD: Final = "webgym"
"""Name of the reward, and of the entry in the trace's ``info``."""


class WebGymTasksetConfig(vf.TasksetConfig):
    """Choice of the tasks, and settings.

    Attributes:
        tasks: name of the tasks, as for :func:`webgym.make`.
        split: of the tasks. Evaluations say ``test``: no default lets a trainer see test tasks.
        count: number of tasks, drawn as for a run.
        settings: settings of a run (:class:`webgym.RunConfig`), such as ``{"judge": {…}}``.
    """

    tasks: str = "offline-v2"
    split: Literal["train", "test", "all"] = "train"
    count: int | Literal["all"] = 20
    settings: dict[str, Any] = Field(default_factory=dict)

    def run_config(self) -> RunConfig:
        """The settings, validated."""
        return RunConfig.model_validate(self.settings)


class WebGymTask(vf.Task[vf.TaskData]):
    """A task, given by its id. The environment starts the conversation, and its judge gives the reward."""

    @property
    def key(self) -> str:
        """The id of the task, which does not depend on its position in the set."""
        return str(self.data.id)


class WebGymTaskset(vf.Taskset[WebGymTask, WebGymTasksetConfig]):
    """Tasks of WebGym, without rubrics and answers."""

    def load(self) -> Iterator[WebGymTask]:
        """The tasks, in the order in which a run draws them."""
        config = self.config
        rows = task_rows(config.tasks, split=config.split, count=config.count, config=config.run_config())
        for row in rows:
            data = vf.TaskData(id=row["task_id"], name=row["website"], description=row["instruction"])
            yield WebGymTask(data, config.task)


class WebGymHarness(vf.Harness[vf.HarnessConfig]):
    """Sends the model the environment's messages, once per turn, in this process. Earlier turns are in the
    request only as far as WebGym's window of the history contains them."""

    SUPPORTS_RESUME = True
    EXECUTES_CODE = False
    NEEDS_CONTAINER = False

    async def launch(self, *given: Any, **named: Any) -> vf.ProgramResult:
        """Not supported: the environment starts the conversation.

        Raises:
            UsageError: the task has a prompt.
        """
        raise UsageError("the harness plays only WebGym's tasks", hint="leave its environment as it is")

    async def resume(
        self,
        ctx: vf.ModelContext,
        trace: vf.Trace,
        runtime: vf.Runtime,
        endpoint: str,
        secret: str,
        mcp_urls: dict[str, str],
        data: vf.TaskData,
        messages: vf.Messages,
        tool_interception_url: str | None = None,
    ) -> vf.ProgramResult:
        """Send the request to the model; verifiers records request and reply.

        Args:
            ctx: has the model's name.
            trace: ignored.
            runtime: ignored.
            endpoint: URL of verifiers' proxy of the model's endpoint.
            secret: API key for the endpoint.
            mcp_urls: ignored.
            data: ignored.
            messages: the whole request.
            tool_interception_url: ignored.

        Raises:
            openai.OpenAIError: the model gave no reply.
        """
        request: Any = [message.model_dump(exclude_none=True) for message in messages]
        async with AsyncOpenAI(base_url=endpoint, api_key=secret, timeout=None) as client:
            await client.chat.completions.create(model=ctx.model, messages=request)
        return vf.ProgramResult(0, "", "")


class WebGymEnvConfig(vf.EnvConfig):
    """Settings of the environment.

    Attributes:
        player: the model; its harness must not be changed, and it does not use a sandbox.
        browsers: number of concurrent episodes; further ones wait.
    """

    player: vf.AgentConfig = vf.AgentConfig(runtime=vf.SubprocessConfig())
    browsers: int = Field(8, ge=1)


class WebGymEnv(vf.Env[WebGymEnvConfig]):
    """Plays episodes in browsers that are shared by all episodes of an evaluation."""

    _pool: EnvironmentPool | None = None

    async def start(self) -> None:
        """Create the pool of browsers, which start with the first episode."""
        taskset = self.config.taskset
        assert isinstance(taskset, WebGymTasksetConfig)
        self._pool = EnvironmentPool(
            taskset.tasks, size=self.config.browsers, split=taskset.split, config=taskset.run_config()
        )

    async def stop(self) -> None:
        """Stop the browsers."""
        pool, self._pool = self._pool, None
        if pool is not None:
            await pool.close()

    async def setup(self, agents: Any) -> None:
        """Check the harness.

        Args:
            agents: the agents of the episode: ``player``.

        Raises:
            UsageError: it is another harness, which would send more than the window of the history.
        """
        if not isinstance(agents.player.harness, WebGymHarness):
            raise UsageError(
                "WebGym's tasks are played with its own harness", hint="leave player.harness out"
            )

    async def run(self, task: vf.Task, agents: Any) -> None:
        """Play an episode, and record its reward at the end.

        Args:
            task: a task of :class:`WebGymTaskset`.
            agents: the agents of the episode: ``player``.

        Raises:
            NoReward: the episode has no reward, or verifiers ended it.
            WebGymError: no browser was available.
        """
        assert self._pool is not None
        async with self._pool.environment() as env, agents.player.interaction(task) as interaction:

            async def ask(info: dict[str, Any]) -> Reply:
                messages = [_message(message, info["images"]) for message in info["messages"]]
                segment = await interaction.turn(messages)
                if segment.terminated:
                    error = interaction.trace.last_error
                    why = error.message if error else interaction.trace.stop_condition
                    raise NoReward(f"verifiers ended the episode after {info['step']} steps: {why}")
                ended = _finish_reason(segment.last_reply, interaction.trace.calls[-1])
                return Reply(segment.last_reply, "external", finish_reason=ended)

            played = await play(env, task.data.id, ask)
        if math.isnan(played.reward):
            raise NoReward(f"the episode ended as {played.outcome}: {played.why}")
        trace = interaction.trace
        trace.info[REWARD] = {"outcome": played.outcome, "answer": played.answer or None}
        trace.record_metric("steps", played.steps)
        trace.record_reward(REWARD, played.reward)


def _finish_reason(text: str, call: Any) -> str:
    """What ended a reply. One without a token is not a model's own, whose end is a token; and verifiers has
    no word for one that neither the model nor its token limit ended."""
    is_void = not text and call.usage is not None and call.usage.completion_tokens == 0
    return "abort" if is_void else call.finish_reason or "unknown"


def _message(message: Any, images: dict[str, bytes]) -> vf.Message:
    if message.role == "assistant":  # its content is only text
        return vf.AssistantMessage(content=text_of(message))
    content: list[vf.ContentPart] = [
        vf.TextContentPart(text=value)
        if kind == "text"
        else vf.ImageUrlContentPart(image_url=vf.ImageUrlSource(url=value))
        for kind, value in parts(message, images)
    ]
    return vf.SystemMessage(content=content) if message.role == "system" else vf.UserMessage(content=content)
