"""Makes judges from settings."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

from webgym.core.errors import ConfigError, JudgeError, LLMError
from webgym.core.task import WHOLE_TASK, Task
from webgym.judge.base import Judge
from webgym.judge.config import STAGES, JudgeChoice, JudgeConfig, PanelConfig, Stage, StageConfig
from webgym.judge.custom import load_judge
from webgym.judge.offline import OfflineJudge, what_is_missing
from webgym.judge.panel import Panel
from webgym.judge.rubric import RubricJudge
from webgym.judge.without_rubric import WithoutRubric
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.completion import Completes
from webgym.llm.ledger import Ledger

JUDGE_NAMES: Final = ("offline", "rubric", "module:function")


def refuse_unjudgeable(choice: JudgeChoice, tasks: Sequence[Task]) -> None:
    """Refuse a judge that cannot judge these tasks, before anything is spent on attempting them.

    Args:
        choice: of the judge.
        tasks: that it is to judge. Whether a function of one's own can is its own affair.

    Raises:
        ConfigError: there is no such judge, it lacks what it needs, or it cannot judge some of the tasks;
            counts them and names one.
    """
    _check(choice)
    if choice.name == "rubric" and not choice.without_rubric:
        bare = [task.id for task in tasks if task.rubric == WHOLE_TASK]
        if bare:
            told = f"{len(bare):,} of {len(tasks):,} tasks: {bare[0]} has no rubric"
            raise ConfigError(
                f"the rubric judge cannot judge {told}",
                hint="give them one, or judge tasks as a whole: --without-rubric, judge.without_rubric",
            )
    if choice.name != "offline":
        return
    lacking = [(task, why) for task in tasks if (why := what_is_missing(task))]
    if lacking:
        count, of, (first, why) = len(lacking), len(tasks), lacking[0]
        raise ConfigError(
            f"the offline judge cannot judge {count:,} of {of:,} tasks: {first.id} {why}",
            hint="give a rubric judge (--judge-base-url and --judge-model), or leave these tasks out",
        )


def _check(choice: JudgeChoice) -> None:
    """Check that the judge exists and has what it needs."""
    if choice.name == "offline":
        if choice.without_rubric:
            raise ConfigError("the offline judge cannot judge without rubric", hint="choose another judge")
    elif choice.name == "rubric":
        if choice.rubric is None:
            raise ConfigError(
                "the rubric judge does not know its endpoint", hint="give its base URL and model"
            )
    elif ":" in choice.name:
        load_judge(choice.name)
    else:
        raise ConfigError(
            f"there is no judge {choice.name!r}", hint=f"choose one of {', '.join(JUDGE_NAMES)}"
        )


async def check_judge(choice: JudgeChoice) -> None:
    """Ask every model of a rubric judge for one word, before a run starts.

    Raises:
        JudgeError: an endpoint does not answer, or refuses the key or the model.
    """
    if choice.name != "rubric" or choice.rubric is None:
        return
    chats = {chat.model_dump_json(): chat for chat in map(choice.rubric.chat_of, STAGES)}
    for chat in chats.values():
        async with ChatClient(chat) as client:
            try:
                await client.complete([{"role": "user", "content": "Reply with the word yes."}])
            except LLMError as error:
                raise JudgeError(
                    f"the judge's model does not reply: {error.message}", hint=error.hint
                ) from error


@asynccontextmanager
async def open_judge(
    choice: JudgeChoice, *, cache: ReplyCache | None = None, ledger: Ledger | None = None
) -> AsyncIterator[Judge]:
    """Open the chosen judge and the clients of its models.

    Args:
        choice: which.
        cache: an open one, where replies are kept, so that no question is paid for twice; else the choice's.
        ledger: counts what is spent, by stage, and knows prices.

    Raises:
        ConfigError: there is no such judge, or it lacks what it needs.
    """
    _check(choice)
    async with _opened(choice, cache, ledger) as judge:
        yield WithoutRubric(judge) if choice.without_rubric else judge


@asynccontextmanager
async def _opened(
    choice: JudgeChoice, cache: ReplyCache | None, ledger: Ledger | None
) -> AsyncIterator[Judge]:
    if choice.name == "offline":
        yield OfflineJudge()
    elif choice.rubric is not None and choice.name == "rubric":
        async with AsyncExitStack() as stack:
            if cache is None and choice.cache is not None:
                cache = await stack.enter_async_context(ReplyCache(choice.cache))
            yield await _rubric(choice.rubric, choice.panel, stack, cache, ledger or Ledger(cache))
    else:
        yield load_judge(choice.name)


async def _rubric(
    config: JudgeConfig,
    panel: PanelConfig,
    stack: AsyncExitStack,
    cache: ReplyCache | None,
    ledger: Ledger,
) -> Judge:
    clients: dict[str, ChatClient] = {}
    models: dict[Stage, Completes] = {}
    for stage in STAGES:  # stages with the same endpoint and model share one client and its limits
        chat = config.chat_of(stage)
        key = chat.model_dump_json()
        if key not in clients:
            clients[key] = await stack.enter_async_context(ChatClient(chat, cache=cache, ledger=ledger))
        models[stage] = clients[key].labelled(stage)
    one = RubricJudge(config, models, ledger.prices)
    if panel.samples == 1:
        return one
    samples = [sample_of(config, panel, seed) for seed in range(panel.samples)]
    members = [RubricJudge(sample, models, ledger.prices) for sample in samples]
    return Panel(members, f"panel of {panel.samples} at {panel.temperature:g}: {one.name}")


def sample_of(config: JudgeConfig, panel: PanelConfig, seed: int) -> JudgeConfig:
    """The config of one member: with a seed of its own, so that it draws, and caches, its own replies."""

    def drawn(stage: StageConfig) -> StageConfig:
        body = stage.sampling.extra_body | {"seed": seed}
        update = {"temperature": panel.temperature, "extra_body": body}
        return stage.model_copy(update={"sampling": stage.sampling.model_copy(update=update)})

    return config.model_copy(update={stage: drawn(config.stage(stage)) for stage in STAGES})
