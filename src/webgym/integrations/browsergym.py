"""BrowserGym's tasks with WebGym's observations and actions (tested with browsergym-core 0.14.3)::

    import browsergym.miniwob  # registers its tasks

    with BrowserGymEnv("miniwob.click-test") as env:
        view, info = env.reset(seed=7)
        view, reward, terminated, truncated, info = env.step(LeftClick(Target(coordinate=(120, 300))))

Browser, page and reward are BrowserGym's. Failures raise exceptions: an interrupted episode has no reward.
BrowserGym uses Playwright from one thread, so an environment must be used in the thread that created it.
"""

from __future__ import annotations

import hashlib
import json
import math
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BytesIO
from typing import Any, Final, ParamSpec, Self, TypeVar

import greenlet
import gymnasium
import msgspec
import psutil
from browsergym.core.observation import extract_screenshot
from PIL import Image
from playwright.sync_api import Error

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
)
from webgym.integrations.shared import NoReward as NoReward

P = ParamSpec("P")
T = TypeVar("T")

_GRID: Final = 1000
_LONGEST_WAIT: Final = 10.0  # seconds
_SCROLLED: Final = 0.8
"""Scroll distance as a fraction of the viewport."""


class ClosedWhenDropped(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Ends the browsers of an environment of BrowserGym that is garbage-collected instead of closed.

    Playwright holds every browser that it has started, and only the thread that started it may close it,
    but garbage is collected in any thread. So the browsers' processes are killed.

    Args:
        env: an environment of BrowserGym, as it is or wrapped.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self._processes: list[psutil.Process] = []
        weakref.finalize(self, _kill, self._processes).atexit = False  # Playwright ends with the interpreter

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode, in new browsers: one for the page and one for the chat."""
        try:
            return _apart(self.env.reset, seed=seed, options=options)
        finally:
            self._processes[:] = _apart(_main_processes, self.unwrapped)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Carry out an action."""
        return _apart(self.env.step, action)

    def close(self) -> None:
        """Close the browsers. May be called twice."""
        super().close()
        self._processes.clear()


def _apart(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a function on a stack of its own.

    Playwright keeps the stack of its latest call, and with it the variables of all callers: an environment
    that they have dropped would not be collected.
    """
    result: T = greenlet.greenlet(function).switch(*args, **kwargs)
    return result


def _main_processes(env: Any) -> list[psutil.Process]:
    """Those of the environment's browsers that run."""
    found, ours = [], {process.pid: process for process in psutil.Process().children(recursive=True)}
    for browser in [owner.browser for owner in (env, env.chat) if owner and owner.browser]:
        with suppress(Error):
            session = browser.new_browser_cdp_session()
            processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
            session.detach()
            numbers = [each["id"] for each in processes if each["type"] == "browser"]
            found += [ours[number] for number in numbers if number in ours]  # in this namespace of processes
    return found


def _kill(processes: list[psutil.Process]) -> None:
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.kill()


class BrowserGymEnv:
    """An environment for one task of BrowserGym.

    An :class:`~webgym.Answer` is sent to the user in BrowserGym's chat, and ends the episode as in WebGym,
    even if the task does not expect one.

    Args:
        name: name of the task, without ``browsergym/``.
        options: arguments of ``browsergym.core.env.BrowserEnv``, such as ``task_kwargs`` and ``headless``.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.name = name
        self._env = ClosedWhenDropped(
            gymnasium.make(
                f"browsergym/{name}",
                disable_env_checker=True,
                action_mapping=None,  # actions are the code of `playwright_code`
                use_raw_page_output=True,  # the page itself, without BrowserGym's marks
                **options,
            )
        )
        self._page: Any = None
        self._instruction = ""
        self._crashed: list[Any] = []  # pages

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[View, dict[str, Any]]:
        """Start an episode; one in progress is abandoned.

        Args:
            seed: of the task, for BrowserGym; 0 if not given.
            options: ignored.

        Returns:
            The start page; and a dict of ``instruction``, ``is_over`` and ``task_info`` (BrowserGym's).

        Raises:
            NoReward: the browser or the task could not be started.
        """
        with self._faults():
            raw, env_info = self._env.reset(seed=seed or 0)
            view = _apart(_first_view, raw, self._crashed)
        self._instruction, self._page = raw["goal"], raw["page"]
        return view, self._info(env_info, is_over=False)

    def step(self, action: Action) -> tuple[View, float, bool, bool, dict[str, Any]]:
        """Carry out an action.

        Args:
            action: one of the paper's seven, at a coordinate.

        Returns:
            view: the page after the action; ``observation.notices`` has the reason if the action failed.
            reward: BrowserGym's, of this step.
            terminated: whether the task is finished.
            truncated: whether the episode ended without that: by an answer, or by the limit of steps.
            info: as from :meth:`reset`.

        Raises:
            UsageError: there is no episode, or it is over, or the action is none of the seven.
            NoReward: browser, page or task failed; the episode is over.
        """
        if self._page is None:
            raise UsageError("there is no episode to step", hint="call reset first")
        size = self._page.viewport_size
        code = playwright_code(action, (size["width"], size["height"]))
        with self._faults():
            raw, reward, terminated, truncated, env_info = self._env.step(code)
            view = _apart(_view, raw)
        if reward is None or not math.isfinite(reward):
            raise NoReward(f"the task {self.name} gave the reward {reward}")
        truncated = not terminated and (truncated or isinstance(action, Answer))
        is_over = terminated or truncated
        self._page = None if is_over else raw["page"]
        return view, float(reward), terminated, truncated, self._info(env_info, is_over=is_over)

    def close(self) -> None:
        """Stop the browser. May be called twice."""
        self._page = None
        self._env.close()

    @contextmanager
    def _faults(self) -> Iterator[None]:
        self._page = None  # an interrupted episode cannot be continued
        self._crashed.clear()
        try:
            yield
            if self._crashed:
                raise RuntimeError("the page crashed")
        except Exception as error:  # of Playwright or of the task
            reason = " ".join(str(error).split())[:300]
            raise NoReward(f"the task {self.name} failed: {reason}") from error

    def _info(self, env_info: dict[str, Any], *, is_over: bool) -> dict[str, Any]:
        return {"instruction": self._instruction, "is_over": is_over, "task_info": env_info["task_info"]}


def _first_view(raw: dict[str, Any], crashed: list[Any]) -> View:
    """Look at the page; from now on, pages that crash are closed and added to the list."""

    def watch(page: Any) -> None:
        page.on("crash", close)

    def close(page: Any) -> None:
        crashed.append(page)
        page.close()  # calls that wait for it never end otherwise; BrowserGym goes on with an empty page

    watch(raw["page"])
    raw["page"].context.on("page", watch)
    return _view(raw)


def _view(raw: dict[str, Any]) -> View:
    page, buffer = raw["page"], BytesIO()
    picture = Image.fromarray(extract_screenshot(page)).convert("RGB")
    picture.save(buffer, "PNG")
    image, error = buffer.getvalue(), raw["last_action_error"]
    fields = {
        "screenshot": hashlib.sha256(image).hexdigest(),
        "url": page.url,
        "title": page.title(),
        "viewport": picture.size,
        "notices": [{"kind": "action_failed", "text": error}] if error else [],
    }
    return View(msgspec.convert(fields, Observation), image)


def playwright_code(action: Action, viewport: tuple[int, int]) -> str:
    """The Python code that BrowserGym runs for an action.

    Args:
        action: one of the paper's seven.
        viewport: width and height, CSS pixels.

    Raises:
        UsageError: it is another action, or its target is a marked element.
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
            distance = _SCROLLED * height if direction == "down" else -_SCROLLED * height
            return f"page.mouse.move({point})\npage.mouse.wheel(0, {distance})"
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
