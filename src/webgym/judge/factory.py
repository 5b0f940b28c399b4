"""From what a person chose to a judge that is open."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

from pydantic import BaseModel, ConfigDict, Field

from webgym.core.errors import ConfigError
from webgym.judge.asking import Model
from webgym.judge.base import Judge
from webgym.judge.config import STAGES, JudgeConfig, PanelConfig, Stage, StageConfig
from webgym.judge.custom import load_judge
from webgym.judge.offline import OfflineJudge
from webgym.judge.panel import Panel
from webgym.judge.rubric import RubricJudge
from webgym.llm.client import ChatClient

JUDGE_NAMES: Final = ("offline", "rubric", "module:function")


class JudgeChoice(BaseModel):
    """Which judge."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    name: str = "offline"
    """``offline`` (for the offline web's tasks), ``rubric`` (a model), or ``module:function`` (your own)."""

    rubric: JudgeConfig | None = None
    """Of the rubric judge: models and rules."""

    panel: PanelConfig = Field(default_factory=PanelConfig)
    """Of the rubric judge: several samples by majority."""


@asynccontextmanager
async def open_judge(choice: JudgeChoice) -> AsyncIterator[Judge]:
    """The judge that was chosen, with its models open.

    Raises:
        ConfigError: there is no such judge, or it lacks what it needs.
    """
    if choice.name == "offline":
        yield OfflineJudge()
    elif choice.name == "rubric":
        if choice.rubric is None:
            raise ConfigError(
                "the rubric judge does not know its endpoint", hint="give --judge-base-url and --judge-model"
            )
        async with _rubric(choice.rubric, choice.panel) as judge:
            yield judge
    elif ":" in choice.name:
        yield load_judge(choice.name)
    else:
        raise ConfigError(
            f"there is no judge {choice.name!r}", hint=f"choose one of {', '.join(JUDGE_NAMES)}"
        )


@asynccontextmanager
async def _rubric(config: JudgeConfig, panel: PanelConfig) -> AsyncIterator[Judge]:
    async with AsyncExitStack() as stack:
        clients: dict[str, ChatClient] = {}
        models: dict[Stage, Model] = {}
        for stage in STAGES:  # stages with the same endpoint and model share one client and its limits
            chat = config.chat_of(stage)
            key = chat.model_dump_json()
            if key not in clients:
                clients[key] = await stack.enter_async_context(ChatClient(chat))
            models[stage] = clients[key]
        if panel.samples == 1:
            yield RubricJudge(config, models)
        else:
            members = [RubricJudge(sample_of(config, panel, seed), models) for seed in range(panel.samples)]
            yield Panel(members, f"panel of {panel.samples}: {RubricJudge(config, models).name}")


def sample_of(config: JudgeConfig, panel: PanelConfig, seed: int) -> JudgeConfig:
    """The config of one member: with a seed of its own, so that it draws, and caches, its own replies."""

    def drawn(stage: StageConfig) -> StageConfig:
        body = stage.sampling.extra_body | {"seed": seed}
        update = {"temperature": panel.temperature, "extra_body": body}
        return stage.model_copy(update={"sampling": stage.sampling.model_copy(update=update)})

    return config.model_copy(update={stage: drawn(config.stage(stage)) for stage in STAGES})
