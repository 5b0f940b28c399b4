"""Creates judges from settings or the user's own code, and checks that they can judge the given tasks.

A judge of the user's own is ``--judge module:function``. The function takes the task and the episode and, if
it has a third parameter, an async function that returns a screenshot's bytes, given its name. It may be
async. It returns a :class:`webgym.core.verdict.Verdict`, a bool, 0 or 1, or a pair of a bool and a reason. An
object with ``name`` and ``judge`` is used as a judge directly; a class, or a function without parameters, is
called to create one.
"""

from __future__ import annotations

import asyncio
import importlib
import inspect
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Final, cast

import msgspec

from webgym.core.errors import ConfigError, JudgeError, LLMError
from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Judgement, Verdict
from webgym.judge.base import Judge, Pictures
from webgym.judge.blocking import NOT_BLOCKED, find_block
from webgym.judge.config import (
    MODEL_JUDGES,
    STAGES,
    JudgeChoice,
    JudgeConfig,
    PanelConfig,
    Stage,
    StageConfig,
)
from webgym.judge.offline import OfflineJudge, why_unjudgeable
from webgym.judge.panel import PREFIX, Panel, WithoutRubric
from webgym.judge.published import DeepShopJudge, PublishedJudge, WebJudge, WebVoyagerJudge
from webgym.judge.rubric import RubricJudge
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.completion import Completes
from webgym.llm.ledger import Ledger

JUDGE_NAMES: Final = ("offline", *MODEL_JUDGES, "module:function")
_MODEL_JUDGES: Final[dict[str, type[RubricJudge] | type[PublishedJudge]]] = {
    "rubric": RubricJudge,
    "webjudge": WebJudge,
    "webvoyager": WebVoyagerJudge,
    "deepshop": DeepShopJudge,
}


def refuse_unjudgeable(choice: JudgeChoice, tasks: Sequence[Task]) -> None:
    """Refuse a judge that cannot judge these tasks, before anything is spent on attempting them.

    Args:
        choice: the judge and its settings.
        tasks: the tasks to be judged. They are not checked for a judge function of the user's own.

    Raises:
        ConfigError: there is no such judge, a setting that it needs is missing, or it cannot judge some of
            the tasks; the message counts them and names one.
    """
    _check(choice)
    if choice.name == "rubric" and not choice.without_rubric:
        bare = [task.id for task in tasks if task.rubric == WHOLE_TASK]
        if bare:
            raise ConfigError(
                f"the rubric judge cannot judge {len(bare):,} of {len(tasks):,} tasks: "
                f"{bare[0]} has no rubric",
                hint="give them one, or judge tasks as a whole with the setting judge.without_rubric: true",
            )
    if choice.name != "offline":
        return
    refused = [(task, reason) for task in tasks if (reason := why_unjudgeable(task))]
    if refused:
        first, reason = refused[0]
        raise ConfigError(
            f"the offline judge cannot judge {len(refused):,} of {len(tasks):,} tasks: {first.id} {reason}",
            hint="give a rubric judge (--judge-base-url and --judge-model), or leave these tasks out",
        )


def _check(choice: JudgeChoice) -> None:
    """Check that the judge exists and that no setting it needs is missing; raises ConfigError."""
    if choice.name == "offline":
        if choice.without_rubric:
            raise ConfigError("the offline judge cannot judge without rubric", hint="choose another judge")
    elif choice.name in MODEL_JUDGES:
        if choice.rubric is None:
            raise ConfigError(f"the {choice.name} judge has no endpoint", hint="give its base URL and model")
    elif ":" in choice.name:
        load_judge(choice.name)
    else:
        raise ConfigError(
            f"there is no judge {choice.name!r}", hint=f"choose one of {', '.join(JUDGE_NAMES)}"
        )


def name_of(choice: JudgeChoice) -> str:
    """The name of the judge that :func:`open_judge` opens: it covers what can change its verdicts.

    Raises:
        ConfigError: there is no such judge, or a setting that it needs is missing.
    """
    _check(choice)
    if choice.name in MODEL_JUDGES and choice.rubric is not None:
        name = _panel_name(choice.panel, _MODEL_JUDGES[choice.name](choice.rubric, {}).name)
    else:
        name = OfflineJudge.name if choice.name == "offline" else load_judge(choice.name).name
    return f"{PREFIX}{name}" if choice.without_rubric else name


def _panel_name(panel: PanelConfig, judge: str) -> str:
    return judge if panel.samples == 1 else f"panel of {panel.samples} at {panel.temperature:g}: {judge}"


async def check_judge(choice: JudgeChoice) -> None:
    """Send every model of a judge that asks one a short request, to check the endpoints before a run starts.

    Raises:
        JudgeError: an endpoint does not answer, or refuses the key or the model.
    """
    if choice.name not in MODEL_JUDGES or choice.rubric is None:
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
        choice: the judge and its settings.
        cache: an open cache of replies; ``None`` opens the file that ``choice`` names, if any.
        ledger: adds up tokens and dollars, by stage; ``None`` creates one.

    Yields:
        The judge, usable until the context ends.

    Raises:
        ConfigError: there is no such judge, or a setting that it needs is missing.
    """
    _check(choice)
    async with _open_unwrapped(choice, cache, ledger) as judge:
        yield WithoutRubric(judge) if choice.without_rubric else judge


@asynccontextmanager
async def _open_unwrapped(
    choice: JudgeChoice, cache: ReplyCache | None, ledger: Ledger | None
) -> AsyncIterator[Judge]:
    if choice.name == "offline":
        yield OfflineJudge()
    elif choice.rubric is not None and choice.name in MODEL_JUDGES:
        async with AsyncExitStack() as stack:
            if cache is None and choice.cache is not None:
                cache = await stack.enter_async_context(ReplyCache(choice.cache))
            yield await _model_judge(choice, choice.rubric, stack, cache, ledger or Ledger(cache))
    else:
        yield load_judge(choice.name)


async def _model_judge(
    choice: JudgeChoice, config: JudgeConfig, stack: AsyncExitStack, cache: ReplyCache | None, ledger: Ledger
) -> Judge:
    kind, panel = _MODEL_JUDGES[choice.name], choice.panel
    clients: dict[str, ChatClient] = {}
    models: dict[Stage, Completes] = {}
    for stage in STAGES:  # stages with the same endpoint and model share one client and its limits
        chat = config.chat_of(stage)
        key = chat.model_dump_json()
        if key not in clients:
            clients[key] = await stack.enter_async_context(ChatClient(chat, cache=cache, ledger=ledger))
        models[stage] = clients[key].labelled(stage)
    judge = kind(config, models, ledger.prices)
    if panel.samples == 1:
        return judge
    samples = [member_config(config, panel, seed) for seed in range(panel.samples)]
    members = [kind(sample, models, ledger.prices) for sample in samples]
    return Panel(members, _panel_name(panel, judge.name))


def member_config(config: JudgeConfig, panel: PanelConfig, seed: int) -> JudgeConfig:
    """The config of one panel member, whose seed makes the model sample, and the cache keep, separate
    replies."""

    def drawn(stage: StageConfig) -> StageConfig:
        body = stage.sampling.extra_body | {"seed": seed}
        update = {"temperature": panel.temperature, "extra_body": body}
        return stage.model_copy(update={"sampling": stage.sampling.model_copy(update=update)})

    return config.model_copy(update={stage: drawn(config.stage(stage)) for stage in STAGES})


class FunctionJudge:
    """Wraps a function of the user's own as a :class:`webgym.judge.base.Judge`.

    Args:
        function: takes the task, the episode and perhaps the screenshots; see the module's docstring.
        name: the judge's name, recorded in every verdict.
    """

    def __init__(self, function: Callable[..., Any], name: str) -> None:
        self._function = function
        self._name = name
        self._takes_pictures = _parameters(function) >= 3

    @property
    def name(self) -> str:
        """The name that was given."""
        return self._name

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`.

        A function that is not async runs in a thread.

        Raises:
            JudgeError: the function raised, or returned something that is not a verdict.
        """
        arguments = (task, episode, pictures) if self._takes_pictures else (task, episode)
        try:
            if inspect.iscoroutinefunction(self._function):
                result = await self._function(*arguments)
            else:
                result = await asyncio.to_thread(_called, self._function, *arguments)
                if inspect.isawaitable(result):
                    result = await result
        except JudgeError:
            raise
        except Exception as error:
            raise JudgeError(f"{self._name} failed: {type(error).__name__}: {error}") from error
        return self._verdict(result, task, episode)

    def _verdict(self, result: Any, task: Task, episode: Episode) -> Verdict:
        if isinstance(result, Verdict):
            return msgspec.structs.replace(result, judge=self._name)
        reason = ""
        if isinstance(result, tuple) and len(result) == 2 and isinstance(result[1], str):
            result, reason = result
        if not isinstance(result, bool | int) or result not in (0, 1):
            raise JudgeError(
                f"{self._name} returned {str(result)[:80]!r}",
                hint="return a Verdict, a bool, or (bool, reason); raise JudgeError when in doubt",
            )
        passed = bool(result) and episode.answer is not None
        blocked = NOT_BLOCKED if passed else find_block(task, episode)
        response = Judgement(bool(result), reason or f"{self._name} says so")
        return Verdict(self._name, None if blocked.passed else int(passed), (), blocked, response)


def _called(function: Callable[..., Any], *arguments: object) -> Any:
    """Call a function in a thread, whose future would wait for ever on a StopIteration."""
    try:
        return function(*arguments)
    except StopIteration as error:
        raise RuntimeError(f"StopIteration: {error}") from error


def _parameters(function: Callable[..., Any]) -> int:
    """The number of positional parameters of a function; 3 for ``*args``."""
    kinds = [parameter.kind for parameter in inspect.signature(function).parameters.values()]
    if inspect.Parameter.VAR_POSITIONAL in kinds:
        return 3
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(kind in positional for kind in kinds)


def load_judge(where: str) -> Judge:
    """Import the judge that ``module:name`` names; the working directory is searched as well.

    Raises:
        ConfigError: it cannot be imported, or is not a judge.
    """
    module_name, _, name = where.partition(":")
    hint = "give module:function, as in my_judges:strict"
    if not module_name or not name:
        raise ConfigError(f"{where!r} does not name a judge", hint=hint)
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        target: Any = importlib.import_module(module_name)
        for part in name.split("."):
            target = getattr(target, part)
        if inspect.isclass(target) or (inspect.isfunction(target) and _parameters(target) == 0):
            target = target()
    except Exception as error:  # a module's own code runs here, and may raise anything
        raise ConfigError(f"cannot load {where}: {type(error).__name__}: {error}", hint=hint) from error
    if hasattr(target, "judge") and hasattr(target, "name"):
        return cast(Judge, target)
    if callable(target) and _parameters(target) >= 2:
        return FunctionJudge(target, where)
    raise ConfigError(f"{where} is not a judge", hint="a judge takes a task and an episode")
