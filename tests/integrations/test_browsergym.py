"""BrowserGym's tasks, in its own browser, are played with our actions, and what fails is no reward."""

from __future__ import annotations

import functools
import importlib
import io
import math
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest
from PIL import Image
from tests.integrations.installed_browser import use_installed_browser

from webgym import (
    Action,
    Answer,
    GoBack,
    LeftClick,
    Navigate,
    RunConfig,
    Scroll,
    Target,
    Type,
    UsageError,
    Wait,
)
from webgym.core.action import Hover

pytest.importorskip("browsergym.core", reason="browsergym-core is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    from browsergym.core.registration import register_task
    from browsergym.core.task import AbstractBrowserTask
    from tests.integrations.browsergym_checks import (
        APPLICABLE,
        BUDGET,
        Adapter,
        Backend,
        checked,
        playwright_in,
    )

    from webgym.integrations.browsergym import BrowserGymEnv, NoReward, playwright_code

pytestmark = [pytest.mark.browser, pytest.mark.filterwarnings("ignore")]  # its own

EXAMPLES = Path(__file__).parents[2] / "examples" / "integrations"
PAGE = """<!doctype html><title>start</title>
<body style="margin:0;height:2000px;background:#fff">
<button style="position:absolute;left:100px;top:50px;width:100px;height:50px"
        onclick="document.title='pressed'">press</button>
<input style="position:absolute;left:100px;top:200px;width:100px;height:50px" value="old"
       onkeydown="if (event.key === 'Enter') document.title = this.value">
"""
BUTTON, FIELD = Target(coordinate=(300, 150)), Target(coordinate=(300, 450))


class PageTask(AbstractBrowserTask):  # type: ignore[misc, unused-ignore]
    """Done when the title, or what the user is told, is the wanted one.

    Attributes:
        scrolled: how far each episode has scrolled, in viewports.
    """

    scrolled: ClassVar[list[float]] = []

    def __init__(self, seed: int, wanted: str = "pressed", fault: str = "") -> None:
        super().__init__(seed)
        self.seed, self.wanted, self.fault = seed, wanted, fault
        self.viewport, self.slow_mo, self.timeout = {"width": 500, "height": 500}, 0, 5000
        self.number = len(self.scrolled)
        self.scrolled.append(0)

    def setup(self, page: Any) -> tuple[str, dict[str, Any]]:
        if self.fault == "setup":
            page.goto("http://127.0.0.1:9/")
        page.set_content(PAGE)
        return f"Make it {self.wanted}", {"seed": self.seed}

    def validate(self, page: Any, chat_messages: list[Any]) -> tuple[float, bool, str, dict[str, Any]]:
        if self.fault == "no_reward":
            return math.nan, True, "", {}
        if self.fault == "crash":
            page.context.browser.close()
            return 0.0, True, "", {}
        if self.fault == "judge":
            raise LookupError("no verdict")
        self.scrolled[self.number] = page.evaluate("scrollY") / 500
        said = [each["message"] for each in chat_messages if each["role"] == "assistant"]
        is_done = self.wanted in (page.title(), said[-1])
        return float(is_done), is_done, "", {"y": page.evaluate("scrollY")}


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    use_installed_browser(monkeypatch)


@pytest.fixture(scope="module", autouse=True)
def registered() -> None:
    register_task("webgym-test.page", PageTask)


@pytest.fixture
def env() -> Iterator[BrowserGymEnv]:
    with BrowserGymEnv("webgym-test.page", pre_observation_delay=0.1) as made:
        yield made


def made(**task_kwargs: Any) -> BrowserGymEnv:
    return BrowserGymEnv("webgym-test.page", task_kwargs=task_kwargs, pre_observation_delay=0.1)


def steps() -> list[int]:
    return [round(each / 0.8) for each in PageTask.scrolled]


class PageBackend(Backend):
    """The page of these tests."""

    def prepare(self, case: str) -> tuple[str, Sequence[Action | str]]:
        self.given["options"]["task_kwargs"]["fault"] = case
        return super().prepare(case)


def backend() -> PageBackend:
    actions: list[Action] = [Scroll("down"), Answer("right")]
    return PageBackend(
        "webgym-test.page", actions, steps, max_episode_steps=BUDGET, task_kwargs={"wanted": "right"}
    )


@pytest.mark.timeout(300)
def test_it_keeps_the_environments_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    adapter = Adapter()

    def drawn(seed: int) -> list[str]:
        with made() as env:
            return [env.reset(seed=each)[1]["task_info"] for each in (seed, seed + 100)]

    def rows(name: str, config: RunConfig) -> list[str]:
        return adapter.run(drawn, config.seed)

    faults = APPLICABLE - {"blocked"}  # BrowserGym's tasks do not say that
    with playwright_in(adapter, monkeypatch):
        assert checked(adapter, backend(), rows=rows, faults=faults) == []


def test_an_episode(env: BrowserGymEnv) -> None:
    first, info = env.reset(seed=7)
    assert info == {"instruction": "Make it pressed", "is_over": False, "task_info": {"seed": 7}}
    assert first.observation.title == "start"
    assert Image.open(io.BytesIO(first.image)).size == first.observation.viewport == (500, 500)
    view, reward, terminated, truncated, info = env.step(Scroll("down"))
    assert (reward, terminated, truncated) == (0.0, False, False)
    assert info["task_info"] == {"y": 400}
    assert view.observation.screenshot != first.observation.screenshot
    view, *_, info = env.step(Scroll("up"))
    assert info["task_info"] == {"y": 0}
    assert view.observation.screenshot == first.observation.screenshot
    view, reward, terminated, truncated, info = env.step(LeftClick(BUTTON))
    assert (reward, terminated, truncated, info["is_over"]) == (1.0, True, False, True)
    assert view.observation.title == "pressed"
    with pytest.raises(UsageError, match="no episode"):
        env.step(Wait(0))
    env.reset()


def test_typing_replaces_what_stands_there() -> None:
    text = 'it\'s "new" \\ é'
    with made(wanted=text) as env:
        env.reset()
        view, reward, terminated, *_ = env.step(Type(FIELD, text))
        assert (view.observation.title, reward, terminated) == (text, 1.0, True)


@pytest.mark.parametrize(("answer", "wanted"), [("42", (1.0, True, False)), ("41", (0.0, False, True))])
def test_an_answer_ends_the_episode(answer: str, wanted: tuple[float, bool, bool]) -> None:
    with made(wanted="42") as env:
        env.reset()
        _, reward, terminated, truncated, info = env.step(Answer(answer))
        assert (reward, terminated, truncated) == wanted
        assert info["is_over"]


def test_an_action_that_fails_is_told(env: BrowserGymEnv) -> None:
    env.reset()
    view, reward, *_, info = env.step(Navigate("http://127.0.0.1:9/"))
    assert (reward, info["is_over"]) == (0.0, False)
    (notice,) = view.observation.notices
    assert notice.kind == "action_failed"
    assert "ERR_" in notice.text


@pytest.mark.parametrize("fault", ["setup", "no_reward", "crash"])
def test_a_fault_is_no_reward(fault: str) -> None:
    env = made(fault=fault)
    fails = env.reset if fault == "setup" else functools.partial(env.step, Wait(0))
    if fault != "setup":
        env.reset()
    with pytest.raises(NoReward):
        fails()
    with pytest.raises(UsageError, match="no episode"):
        env.step(Wait(0))


@pytest.mark.parametrize(
    "action", [Hover(BUTTON), Scroll("left"), LeftClick(BUTTON, ("Shift",)), LeftClick(Target(element=1))]
)
def test_other_actions_are_refused(action: Action) -> None:
    with pytest.raises(UsageError):
        playwright_code(action, (500, 500))


def test_code() -> None:
    assert (
        playwright_code(LeftClick(Target(coordinate=(1000, 0))), (500, 400)) == "page.mouse.click(499, 0.0)"
    )
    assert playwright_code(Wait(99), (500, 400)) == "page.wait_for_timeout(10000.0)"
    assert playwright_code(GoBack(), (500, 400)) == "page.go_back()"
    assert playwright_code(Answer('a"'), (500, 400)) == 'send_message_to_user("a\\"")'


def test_the_example(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    assert importlib.import_module("browsergym_tasks").main("webgym-test.page", steps=2) in (0.0, 1.0)
    assert "Make it pressed" in capsys.readouterr().out
