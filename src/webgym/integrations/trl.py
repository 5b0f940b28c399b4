"""TRL (tested with trl 1.16): browsers as environments of ``GRPOTrainer``::

    browsers = Browsers("offline-v2", size=16)
    trainer = GRPOTrainer(
        model="Qwen/Qwen3-VL-4B-Instruct",
        train_dataset=datasets.Dataset.from_list(browsers.rows(count=200)),
        environment_factory=browsers,
        args=GRPOConfig(max_completion_length=32768, max_tool_calling_iterations=30, ...),
    )

The seven actions are tools, and each returns the next screenshot. TRL keeps one growing conversation per
episode. The reward of an episode without one is ``None``, which TRL leaves out of the group's mean and gives
no advantage. A model that stops calling tools or runs out of tokens before it answers has failed: reward 0,
unless the judge finds that the website blocked it.
"""

from __future__ import annotations

import functools
import math
import weakref
from collections.abc import Iterable
from contextlib import AsyncExitStack
from io import BytesIO
from typing import Any, Literal, TypeAlias

from PIL import Image

from webgym import (
    Action,
    Answer,
    Environment,
    EnvironmentPool,
    GoBack,
    LeftClick,
    LoopThread,
    Navigate,
    Scroll,
    Target,
    Type,
    UsageError,
    View,
    Wait,
    WebGymError,
    task_rows,
    visible,
)

Content: TypeAlias = list[dict[str, Any]]
"""Parts of a message: an image (``image``, a PIL image) and a text (``text``)."""

PROMPT = """\
You use a web browser to carry out a task. After each of your actions you get a screenshot. Act by calling \
one tool at a time. Coordinates run from 0 to 1000: x from the left edge of the screenshot to the right, y \
from its top to its bottom. When the task is done, call `answer`; only what you say there, and what you did \
on the pages, counts.

Task: """


class BrowserTools:
    """A browser with the interface that TRL expects: ``reset``, tools and ``get_reward``. See
    :class:`Browsers`."""

    def __init__(self, browsers: Browsers) -> None:
        self._browsers = browsers
        self._stack = AsyncExitStack()
        self._env: Environment | None = None
        self._final_text = ""
        self._is_over = True
        self._reward: float | None = None

    # --- called by TRL -----------------------------------------------------------------------------------

    def reset(self, task_id: str | None = None, **row: Any) -> Content:
        """Start the row's task. If no browser is available there is no episode, and so no reward.

        Args:
            task_id: id of the task; ``None`` for the next one.
            row: other fields of the dataset's row; ignored.

        Returns:
            The start page.

        Raises:
            ConfigError: there is no task with this id.
        """
        self._is_over, self._reward = True, None
        self._browsers.begun += 1
        try:
            view = self._browsers.loop.run(self._begin(task_id))
        except WebGymError as error:
            if isinstance(error, UsageError):
                raise
            self._final_text = f"The browser failed ({error.code}); the episode is over."
            return [{"type": "text", "text": self._final_text}]
        self._is_over = False
        return _content(view)

    def get_reward(self) -> float | None:
        """1.0 or 0.0 from the judge; ``None`` for an episode without a reward."""
        if not self._is_over:  # the model stopped calling tools, or ran out of tokens
            assert self._env is not None
            self._is_over, self._reward, self._final_text = True, None, "The episode was not answered."
            self._browsers.unanswered += 1
            self._reward = _number(self._browsers.loop.run(self._env.finish())[1])
        return self._reward

    # --- tools --------------------------------------------------------------------------------------------

    def click(self, x: float, y: float) -> Content:
        """
        Click at a point of the page.

        Args:
            x: 0 (left) to 1000 (right).
            y: 0 (top) to 1000 (bottom).

        Returns:
            The page afterwards.
        """
        return self._at(x, y, lambda target: LeftClick(target))

    def type_text(self, x: float, y: float, text: str) -> Content:
        """
        Click at a field, clear it, type a text into it and press Enter.

        Args:
            x: 0 (left) to 1000 (right).
            y: 0 (top) to 1000 (bottom).
            text: What to type.

        Returns:
            The page afterwards.
        """
        return self._at(x, y, lambda target: Type(target, str(text)))

    def scroll(self, direction: Literal["up", "down"]) -> Content:
        """
        Scroll the page.

        Args:
            direction: Where to: up or down.

        Returns:
            The page afterwards.
        """
        return self._step(Scroll(direction))

    def wait(self, seconds: float) -> Content:
        """
        Wait while the page goes on.

        Args:
            seconds: How long, at most 10.

        Returns:
            The page afterwards.
        """
        return self._step(Wait(float(seconds)))

    def go_back(self) -> Content:
        """
        Go back to the page before.

        Returns:
            The page afterwards.
        """
        return self._step(GoBack())

    def navigate(self, url: str) -> Content:
        """
        Open an address.

        Args:
            url: The address.

        Returns:
            The page afterwards.
        """
        return self._step(Navigate(str(url)))

    def answer(self, text: str) -> Content:
        """
        Say what the task asks for, or that it is done. This ends the task.

        Args:
            text: The answer.

        Returns:
            Nothing more to do.
        """
        return self._step(Answer(str(text)))

    # --- internals
    # ----------------------------------------------------------------------------------------------

    async def _begin(self, task_id: str | None) -> View:
        if self._env is None:
            self._env = await self._stack.enter_async_context(self._browsers.pool.environment())
        view, _ = await self._env.reset(options={} if task_id is None else {"task_id": task_id})
        return view

    def _at(self, x: float, y: float, make_action: Any) -> Content:
        return self._step(make_action(Target(coordinate=(float(x), float(y)))))

    def _step(self, action: Action) -> Content:
        if self._is_over:
            return [{"type": "text", "text": self._final_text}]
        assert self._env is not None
        view, reward, terminated, truncated, _ = self._browsers.loop.run(self._env.step(action))
        if not (terminated or truncated):
            return _content(view)
        self._is_over = True
        self._reward = _number(reward)
        self._final_text = "The episode is over."
        return [{"type": "text", "text": self._final_text}]


class Browsers:
    """An ``environment_factory`` of ``GRPOTrainer``: creates the environments of a batch's episodes.

    Args:
        name: name of the tasks, as for :func:`webgym.make`.
        size: number of browsers: at least ``generation_batch_size`` of a process, because TRL starts all
            episodes of a generation batch at the same time.
        options: further arguments of :class:`webgym.EnvironmentPool`, except ``on_fault="raise"``.

    Attributes:
        pool: the environments.
        loop: the event loop that they run on.
        begun: number of episodes started.
        unanswered: number of episodes that TRL ended before an answer. If there are many,
            ``max_completion_length`` is too short for the screenshots.

    Raises:
        UsageError: ``on_fault`` is ``raise``.
    """

    def __init__(self, name: str = "offline-v2", *, size: int = 8, **options: Any) -> None:
        if options.get("on_fault") == "raise":
            raise UsageError("TRL would show the error to the model", hint="use on_fault='nan'")
        self.pool = EnvironmentPool(name, size=size, **options)
        self._drawn = {key: options[key] for key in ("split", "config") if key in options}
        self._name, self._size = name, size
        self._made: weakref.WeakSet[BrowserTools] = weakref.WeakSet()
        self.begun = self.unanswered = 0
        # Of what it closes, and not of this: the thread would keep this alive, and so itself.
        self.loop = LoopThread(functools.partial(_close_all, self._made, self.pool))

    def __call__(self) -> BrowserTools:
        """Create an environment.

        Raises:
            RuntimeError: there are as many environments as browsers: another one would wait forever.
        """
        if len(self._made) == self._size:
            raise RuntimeError(
                f"TRL needs more than {self._size} concurrent episodes; set Browsers(size=...) to the "
                "generation batch size of a process"
            )
        tools = BrowserTools(self)
        self._made.add(tools)
        return tools

    def rows(self, **options: Any) -> list[dict[str, Any]]:
        """A dataset: rows with ``prompt`` and ``task_id``.

        Args:
            options: arguments of :func:`webgym.task_rows`, such as ``count``; ``split`` and ``config`` are
                by default those of the browsers.
        """
        rows = task_rows(self._name, **(self._drawn | options))
        return [
            {"task_id": row["task_id"], "prompt": [{"role": "user", "content": PROMPT + row["instruction"]}]}
            for row in rows
        ]

    def close(self) -> None:
        """Stop the browsers. May be called twice."""
        self.loop.close()


async def _close_all(made: Iterable[BrowserTools], pool: EnvironmentPool) -> None:
    for tools in list(made):
        await tools._stack.aclose()
    await pool.close()


def _number(reward: float) -> float | None:
    return None if math.isnan(reward) else reward


def _content(view: View) -> Content:
    picture = Image.open(BytesIO(view.image)).convert("RGB")
    notices = " ".join(notice.text for notice in view.observation.notices)
    text = visible(f"{view.observation.url}\n{notices}".strip())
    return [{"type": "image", "image": picture}, {"type": "text", "text": text}]
