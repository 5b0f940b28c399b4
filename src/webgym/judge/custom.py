"""A judge that is any function: ``--judge module:function``.

The function takes the task and the episode and, if it has a third parameter, a function that gives a
screenshot's bytes by its name. It may be async. It returns a :class:`webgym.core.verdict.Verdict`, or a bool,
0 or 1, or one of these with a reason as a pair. An object with a ``judge`` method is a judge as it is, and a
class or a function without parameters makes one.
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
    """A function as a judge.

    Args:
        function: see the module.
        name: stands in every verdict.
    """

    def __init__(self, function: Callable[..., Any], name: str) -> None:
        self._function = function
        self._name = name
        self._takes_pictures = _parameters(function) >= 3

    @property
    def name(self) -> str:
        """As given."""
        return self._name

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`.

        Whatever the function raises, or returns that is no verdict, is a JudgeError. A function that is not
        async runs in a thread.
        """
        given = (task, episode, pictures) if self._takes_pictures else (task, episode)
        try:
            if inspect.iscoroutinefunction(self._function):
                found = await self._function(*given)
            else:
                found = await asyncio.to_thread(self._function, *given)
                if inspect.isawaitable(found):
                    found = await found
        except JudgeError:
            raise
        except Exception as error:
            raise JudgeError(f"{self._name} failed: {type(error).__name__}: {error}") from error
        return self._verdict(found, task, episode)

    def _verdict(self, found: Any, task: Task, episode: Episode) -> Verdict:
        if isinstance(found, Verdict):
            return msgspec.structs.replace(found, judge=self._name)
        reason = ""
        if isinstance(found, tuple) and len(found) == 2 and isinstance(found[1], str):
            found, reason = found
        if not isinstance(found, bool | int) or found not in (0, 1):
            raise JudgeError(
                f"{self._name} returned {str(found)[:80]!r}",
                hint="return a Verdict, a bool, or (bool, reason); raise JudgeError when in doubt",
            )
        passed = bool(found) and episode.answer is not None
        blocked = Judgement(False, "the attempt succeeded") if passed else find_block(task, episode)
        response = Judgement(bool(found), reason or f"{self._name} says so")
        return Verdict(self._name, None if blocked.passed else int(passed), (), blocked, response)


def _parameters(function: Callable[..., Any]) -> int:
    """How many arguments a function takes by position."""
    kinds = [parameter.kind for parameter in inspect.signature(function).parameters.values()]
    if inspect.Parameter.VAR_POSITIONAL in kinds:
        return 3
    by_place = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(kind in by_place for kind in kinds)


def load_judge(where: str) -> Judge:
    """The judge that ``module:name`` names; the working folder is looked into as well.

    Raises:
        ConfigError: there is no such thing, or it is no judge.
    """
    module_name, _, name = where.partition(":")
    hint = "give module:function, as in my_judges:strict"
    if not module_name or not name:
        raise ConfigError(f"{where!r} does not name a judge", hint=hint)
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        found: Any = importlib.import_module(module_name)
        for part in name.split("."):
            found = getattr(found, part)
    except Exception as error:  # a module's own code runs here, and may raise anything
        raise ConfigError(f"cannot load {where}: {type(error).__name__}: {error}", hint=hint) from error
    if inspect.isclass(found) or (inspect.isfunction(found) and _parameters(found) == 0):
        found = found()
    if hasattr(found, "judge") and hasattr(found, "name"):
        return cast(Judge, found)
    if callable(found) and _parameters(found) >= 2:
        return FunctionJudge(found, where)
    raise ConfigError(f"{where} is not a judge", hint="a judge takes a task and an episode")
