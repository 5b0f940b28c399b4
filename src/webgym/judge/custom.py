"""A judge of the user's own: ``--judge module:function``.

The function takes the task and the episode and, if it has a third parameter, an async function that returns a
screenshot's bytes, given its name. It may be async. It returns a :class:`webgym.core.verdict.Verdict`, a
bool, 0 or 1, or a pair of a bool and a reason. An object with ``name`` and ``judge`` is used as a judge
directly; a class, or a function without parameters, is called to create one.
"""

from __future__ import annotations

import asyncio
import importlib
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import msgspec

from webgym.core.errors import ConfigError, JudgeError
from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Judgement, Verdict
from webgym.judge.base import Judge, Pictures
from webgym.judge.blocking import find_block


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
        blocked = Judgement(False, "the attempt succeeded") if passed else find_block(task, episode)
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
