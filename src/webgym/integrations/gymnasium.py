"""Gymnasium (extra ``gymnasium``; tested with gymnasium 1.4). Importing this module registers the ids::

import gymnasium
import webgym.integrations.gymnasium

env = gymnasium.make("WebGym/Offline-v2", split="train")
envs = gymnasium.make_vec("WebGym/Offline-v2", num_envs=8)  # all browsers act concurrently
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import AsyncExitStack
from copy import copy, deepcopy
from functools import cache
from io import BytesIO
from typing import Any, Final, TypeAlias

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from PIL import Image

from webgym import (
    Action,
    Environment,
    LoopThread,
    Reply,
    SyncEnvironment,
    UsageError,
    View,
    WebGymError,
    make,
    make_many,
    random_action,
    visible,
)

IDS: Final = {
    "WebGym/Offline-v2": "offline-v2",
    "WebGym/OfflineSmall-v2": "offline-small-v2",
    "WebGym/OfflineCross-v2": "offline-cross-v2",
}
"""Environments by their Gymnasium ids. The same id always has the same websites and tasks."""

Observation: TypeAlias = dict[str, Any]
_Taken: TypeAlias = tuple[View | None, float, bool, bool, dict[str, Any]]
_RESETS: Final = 3
"""How many tasks a vector environment tries to start in a call."""
_LONGEST: Final = 2**20
_CHARACTERS: Final = "".join(map(chr, (*range(0xD800), *range(0xE000, 0x10000))))
_REPLACED: Final = "\ufffd"


class ActionSpace(gymnasium.Space[Any]):
    """The inputs of ``step``: actions, and models' replies, which may be any text. Samples are actions."""

    def __init__(self, seed: int | None = None) -> None:
        super().__init__((), None, seed)

    @property
    def is_np_flattenable(self) -> bool:
        """Always false."""
        return False

    def sample(self, mask: Any | None = None, probability: Any | None = None) -> Action:
        """A random action; mask and probability are ignored."""
        return random_action(int(self.np_random.integers(2**31)))

    def contains(self, x: Any) -> bool:
        """Whether ``step`` accepts it."""
        return isinstance(x, str | Reply | Action)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ActionSpace)

    def __hash__(self) -> int:
        return hash(ActionSpace)


class _AnyText(gymnasium.spaces.Text):
    """Texts of any characters. Copies share the tables of all characters: a table's copy takes 0.1 s, and a
    vector environment copies the space for each of its environments."""

    def __deepcopy__(self, memo: dict[int, Any]) -> _AnyText:
        made = copy(self)
        made._np_random = deepcopy(self._np_random, memo)
        return made


@cache
def _any_text() -> _AnyText:
    return _AnyText(_LONGEST, min_length=0, charset=_CHARACTERS)


def _spaces(env: Environment) -> tuple[gymnasium.spaces.Dict, ActionSpace]:
    width, height = env.config.attempt.viewport
    text = deepcopy(_any_text())
    spaces = {
        "screenshot": gymnasium.spaces.Box(0, 255, (height, width, 3), np.uint8),
        "instruction": text,
        "text": text,
    }
    return gymnasium.spaces.Dict(spaces), ActionSpace()


def _observation(view: View, instruction: str) -> Observation:
    pixels = np.asarray(Image.open(BytesIO(view.image)).convert("RGB"))
    return {
        "screenshot": pixels,
        "instruction": _plain(instruction),
        "text": _plain(visible(view.observation.text or "")),
    }


def _plain(text: str) -> str:
    return "".join(character if character <= "\uffff" else _REPLACED for character in text)[:_LONGEST]


class WebGymEnv(gymnasium.Env[Observation, Any]):
    """An environment with one browser. Observations are a dict of ``screenshot`` (height x width x 3, RGB),
    ``instruction`` and ``text`` (visible in the viewport); actions are models' replies or those of
    :mod:`webgym.core.action`.

    An episode without a reward (blocked, or an error of environment, policy or judge) ends with a reward of
    NaN, ``truncated``, and ``info["outcome"]``.

    Args:
        name: name of the tasks, as for :func:`webgym.make`.
        render_mode: ``rgb_array`` or ``None``.
        options: further arguments of :func:`webgym.make`.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012 (as in gymnasium)

    def __init__(self, name: str = "offline-v2", render_mode: str | None = None, **options: Any) -> None:
        env = options.pop("env", None) or make(name, **options)
        self.render_mode = render_mode
        self.observation_space, self.action_space = _spaces(env)
        self._env = SyncEnvironment(env)
        self._view: View | None = None
        self._instruction = ""

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """See :meth:`webgym.Environment.reset`."""
        seed = None if seed is None else int(seed)  # such as numpy's
        super().reset(seed=seed)
        self._view, info = self._env.reset(seed=seed, options=options)
        self._instruction = info["instruction"]
        return _observation(self._view, self._instruction), info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """See :meth:`webgym.Environment.step`."""
        self._view, reward, terminated, truncated, info = self._env.step(action)
        return _observation(self._view, self._instruction), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The last screenshot."""
        if self.render_mode is None or self._view is None:
            return None
        pixels: NDArray[np.uint8] = _observation(self._view, "")["screenshot"]
        return pixels

    def close(self) -> None:
        """Release the browser."""
        self._env.close()


class WebGymVectorEnv(gymnasium.vector.VectorEnv[Observation, Sequence[Any], NDArray[Any]]):
    """Several environments that act concurrently. Autoreset is *next step*: the step after the end of an
    episode starts the next one and ignores its action.

    An environment's fault does not end the episodes of others. In a step, it ends its own episode as in
    :class:`WebGymEnv`; if no episode starts, the next task is tried, up to three in all. If none of them
    starts in a step, that is an episode without a reward that is over at once: NaN, ``truncated``, the last
    observation (black if there is none), ``info["outcome"]`` and ``info["failure"]``. The next step tries
    again.

    Args:
        num_envs: number of browsers.
        name: name of the tasks, as for :func:`webgym.make`.
        options: further arguments of :func:`webgym.make`, except ``on_fault="raise"``.

    Raises:
        UsageError: ``on_fault`` is ``raise``.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, num_envs: int = 1, name: str = "offline-v2", **options: Any) -> None:
        if options.get("on_fault") == "raise":
            raise UsageError(
                "on_fault='raise' would lose what the other environments return", hint="use on_fault='nan'"
            )
        self.num_envs = num_envs
        opened = AsyncExitStack()
        self._loop = LoopThread(opened.aclose)
        self._envs = self._loop.run(opened.enter_async_context(make_many(num_envs, name, **options)))
        self.single_observation_space, self.single_action_space = _spaces(self._envs[0])
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        blank: Observation = {
            "screenshot": np.zeros(self.single_observation_space["screenshot"].shape or (), np.uint8),
            "instruction": "",
            "text": "",
        }
        self._seen = [blank] * num_envs
        self._is_over = np.zeros(num_envs, bool)
        self._is_lost = False
        """Whether a call was interrupted, so that nobody knows what it returned."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode in each environment. An integer seed is increased by one for each environment.
        ``options`` are those of :meth:`webgym.Environment.reset`, the same for each.

        Raises:
            WebGymError: no episode started in one of them; they did in the others.
        """
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + index for index in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise UsageError(f"{len(seeds)} seeds for {self.num_envs} environments")
        begun = self._in_all(lambda index: self._begin(index, seeds[index], options))
        observations, *_, infos = self._results(begun)
        return observations, infos

    def step(
        self, actions: Sequence[Any]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Carry out one action in each environment, concurrently.

        Raises:
            UsageError: there is no episode, or one of these is no action, and none was carried out; or the
                last call was interrupted, as by Ctrl-C, and what it returned is lost.
        """
        if self._is_lost:
            raise UsageError("the last call was interrupted: its results are lost", hint="call reset")
        if len(actions) != self.num_envs:
            raise UsageError(f"{len(actions)} actions for {self.num_envs} environments")
        for action, is_over in zip(actions, self._is_over, strict=True):
            if not is_over and action not in self.single_action_space:
                raise UsageError(f"{type(action).__name__} is not an action")
        return self._results(self._in_all(lambda index: self._act(index, actions[index])))

    def _in_all(self, work: Callable[[int], Coroutine[Any, Any, _Taken]]) -> list[_Taken]:
        """Run ``work`` for each environment concurrently to its end; then raise the first error, if any."""

        async def run() -> list[_Taken]:
            tasks = [asyncio.create_task(work(index)) for index in range(self.num_envs)]
            await asyncio.gather(*tasks, return_exceptions=True)
            return [task.result() for task in tasks]

        self._is_lost = True
        try:
            taken = self._loop.run(run())
        except WebGymError:
            self._is_lost = False
            raise
        self._is_lost = False
        return taken

    async def _begin(
        self, index: int, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> _Taken:
        """Start an episode; after a fault, with the next task."""
        self._is_over[index] = True  # until one has started
        for left in reversed(range(_RESETS)):
            try:
                view, info = await self._envs[index].reset(seed=seed, options=options)
                break
            except WebGymError as error:
                if isinstance(error, UsageError) or not left:
                    raise
                seed = None  # the order of tasks continues
        self._is_over[index] = False
        return view, 0.0, False, False, info

    async def _act(self, index: int, action: Any) -> _Taken:
        if self._is_over[index]:
            try:
                return await self._begin(index)
            except UsageError:
                raise
            except WebGymError as error:  # raised, it would lose what the others return
                failure = {"code": error.code, "message": error.message}
                return None, math.nan, False, True, {"outcome": "environment_error", "failure": failure}
        env = self._envs[index]
        self._is_over[index] = bool(env.episode_id)  # a step that raises or is cancelled ends the episode
        taken = await env.step(action)
        self._is_over[index] = taken[2] or taken[3]
        return taken

    def _results(
        self, taken: Sequence[_Taken]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        infos: dict[str, Any] = {}
        for index, (view, *_, info) in enumerate(taken):
            if view is not None:
                self._seen[index] = _observation(view, info["instruction"])
            infos = self._add_info(infos, info, index)
        _, rewards, terminations, truncations, _ = zip(*taken, strict=True)
        batch: Observation = {
            "screenshot": np.stack([seen["screenshot"] for seen in self._seen]),
            "instruction": tuple(seen["instruction"] for seen in self._seen),
            "text": tuple(seen["text"] for seen in self._seen),
        }
        return batch, np.array(rewards), np.array(terminations), np.array(truncations), infos

    def close_extras(self, **kwargs: Any) -> None:
        """Release the browsers."""
        self._loop.close()


for _id, _name in IDS.items():
    gymnasium.register(
        _id,
        entry_point=f"{__name__}:WebGymEnv",
        vector_entry_point=f"{__name__}:WebGymVectorEnv",
        kwargs={"name": _name},
        nondeterministic=True,  # depends on the timing of pages
    )
