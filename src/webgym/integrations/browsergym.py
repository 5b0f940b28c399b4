"""BrowserGym's tasks with WebGym's views and actions (tested with browsergym-core 0.14.3)::

    import browsergym.miniwob  # makes its tasks known

    with BrowserGymEnv("miniwob.click-test") as env:
        view, info = env.reset(seed=7)
        view, reward, terminated, truncated, info = env.step(LeftClick(Target(coordinate=(120, 300))))

Browser, page and reward are BrowserGym's. What fails is raised: an episode that was broken off has no reward.
BrowserGym drives Playwright from one thread, so an environment stays in the thread that made it.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from typing import Any, Final, Self

import gymnasium
import msgspec
from browsergym.core.observation import extract_screenshot
from PIL import Image

from webgym import (
    Action,
    Answer,
    GoBack,
    LeftClick,
    Navigate,
    Observation,
    Scroll,
    Target,
    Type,
    UsageError,
    View,
    Wait,
    WebGymError,
)

_GRID: Final = 1000
_LONGEST_WAIT: Final = 10.0  # seconds
_SCROLLED: Final = 0.8
"""Share of the viewport by which a scroll moves on."""


class NoReward(WebGymError):
    """Browser, page or task failed, or gave no number: no success, and no failure."""

    code = "no_reward"


class BrowserGymEnv:
    """One task of BrowserGym, one episode after another.

    An :class:`~webgym.Answer` is sent to the user in BrowserGym's chat, and ends the episode as it does in
    WebGym, whether the task waits for one or not.

    Args:
        name: of the task, without ``browsergym/``.
        given: arguments of ``browsergym.core.env.BrowserEnv``, such as ``task_kwargs`` and ``headless``.
    """

    def __init__(self, name: str, **given: Any) -> None:
        self.name = name
        self._env = gymnasium.make(
            f"browsergym/{name}",
            disable_env_checker=True,
            action_mapping=None,  # actions are the code of `playwright_code`
            use_raw_page_output=True,  # the page itself, into which nothing is written
            **given,
        )
        self._page: Any = None
        self._instruction = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[View, dict[str, Any]]:
        """Begin an episode; one that is not over is abandoned.

        Args:
            seed: of the task, for BrowserGym; 0 if not given.
            options: not looked at.

        Returns:
            The start page; and a dict of ``instruction``, ``is_over`` and ``task_info`` (BrowserGym's).

        Raises:
            NoReward: the browser, or the task, did not come up.
        """
        with self._faults():
            seen, told = self._env.reset(seed=seed or 0)
            view = _view(seen)
        self._instruction, self._page = seen["goal"], seen["page"]
        return view, self._info(told, is_over=False)

    def step(self, action: Action) -> tuple[View, float, bool, bool, dict[str, Any]]:
        """Act.

        Args:
            action: one of the paper's seven, at a coordinate.

        Returns:
            view: the page afterwards; ``observation.notices`` says why an action could not be carried out.
            reward: BrowserGym's, of this step.
            terminated: the task is over.
            truncated: it is not, but the episode is: it was answered, or has taken as many steps as it may.
            info: as of :meth:`reset`.

        Raises:
            UsageError: there is no episode, or it is over, or the action is none of the seven.
            NoReward: browser, page or task failed; the episode is over.
        """
        if self._page is None:
            raise UsageError("there is no episode to step", hint="call reset first")
        size = self._page.viewport_size
        code = playwright_code(action, (size["width"], size["height"]))
        with self._faults():
            seen, reward, terminated, truncated, told = self._env.step(code)
            view = _view(seen)
        if reward is None or not math.isfinite(reward):
            raise NoReward(f"the task {self.name} gave the reward {reward}")
        truncated = not terminated and (truncated or isinstance(action, Answer))
        is_over = terminated or truncated
        self._page = None if is_over else seen["page"]
        return view, float(reward), terminated, truncated, self._info(told, is_over=is_over)

    def close(self) -> None:
        """Stop the browser. Safe to call twice."""
        self._page = None
        self._env.close()

    @contextmanager
    def _faults(self) -> Iterator[None]:
        self._page = None  # nobody goes on from an episode that broke off
        try:
            yield
        except Exception as error:  # of Playwright, or of code that did not think of it
            said = " ".join(str(error).split())[:300]
            raise NoReward(f"the task {self.name} broke off: {said}") from error

    def _info(self, told: dict[str, Any], *, is_over: bool) -> dict[str, Any]:
        return {"instruction": self._instruction, "is_over": is_over, "task_info": told["task_info"]}


def _view(seen: dict[str, Any]) -> View:
    page, held = seen["page"], BytesIO()
    picture = Image.fromarray(extract_screenshot(page)).convert("RGB")
    picture.save(held, "PNG")
    image, error = held.getvalue(), seen["last_action_error"]
    described = {
        "screenshot": hashlib.sha256(image).hexdigest(),
        "url": page.url,
        "title": page.title(),
        "viewport": picture.size,
        "notices": [{"kind": "action_failed", "text": error}] if error else [],
    }
    return View(msgspec.convert(described, Observation), image)


def playwright_code(action: Action, viewport: tuple[int, int]) -> str:
    """What BrowserGym runs for an action.

    Args:
        action: one of the paper's seven.
        viewport: width and height, CSS pixels.

    Raises:
        UsageError: it is another one, or it names a marked element.
    """
    width, height = viewport
    match action:
        case LeftClick(target=target, modifiers=()):
            return f"page.mouse.click({_point(target, viewport)})"
        case Type(target=target, text=text, enter=True):
            return (
                f"page.mouse.click({_point(target, viewport)})\n"
                "page.keyboard.press('Control+a')\n"
                "page.keyboard.press('Delete')\n"
                f"page.keyboard.type({_literal(text)})\n"
                "page.keyboard.press('Enter')"
            )
        case Scroll(direction="up" | "down" as direction, target=target):
            point = f"{width / 2}, {height / 2}" if target is None else _point(target, viewport)
            way = _SCROLLED * height if direction == "down" else -_SCROLLED * height
            return f"page.mouse.move({point})\npage.mouse.wheel(0, {way})"
        case Wait(time=seconds):
            return f"page.wait_for_timeout({1000 * max(0.0, min(seconds, _LONGEST_WAIT))})"
        case GoBack():
            return "page.go_back()"
        case Navigate(url=url):
            return f"page.goto({_literal(url)})"
        case Answer(text=text):
            return f"send_message_to_user({_literal(text)})"
    raise UsageError(f"{action} is not one of the seven actions", hint="give one without further fields")


def _point(target: Target, viewport: tuple[int, int]) -> str:
    if target.coordinate is None:
        raise UsageError("BrowserGym's pages have no marks", hint="give a coordinate")
    across, down = (
        min(value / _GRID * size, size - 1) for value, size in zip(target.coordinate, viewport, strict=True)
    )
    return f"{across}, {down}"


def _literal(text: str) -> str:
    return json.dumps(text)  # a string of JSON is one of Python
