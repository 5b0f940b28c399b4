"""Gymnasium's own checks, our conformance suite, and several browsers at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from tests.integrations.engine import example

from webgym.core.action import Answer, GoBack, Scroll
from webgym.core.errors import BrowserCrashed, UsageError
from webgym.integrations.gymnasium import IDS, WebGymEnv, WebGymVectorEnv
from webgym.rollout.config import CollectorConfig
from webgym.testing import check_environment, stand_in_environment, stand_in_pool
from webgym.testing.environments import StandInBrowsers


def test_it_passes_gymnasiums_own_check() -> None:
    env = WebGymEnv(env=stand_in_environment(), render_mode="rgb_array")
    check_env(env, skip_render_check=True)
    tasks = [env.reset(seed=seed)[1]["task_id"] for seed in (3, np.int64(3))]  # type: ignore[arg-type]
    assert tasks[0] == tasks[1]
    env.close()


async def test_it_keeps_the_environments_promises() -> None:
    assert await check_environment(lambda env: WebGymEnv(env=env)) == []


def test_its_ids_are_known() -> None:
    assert set(IDS) <= gymnasium.registry.keys()


class FlakyBrowsers(StandInBrowsers):
    """Stand-ins of which some do not open; a scroll crashes them.

    Attributes:
        failures: how many of the next calls of :meth:`open` fail.
    """

    def __init__(self) -> None:
        super().__init__()
        self.fails = True
        self.failures = 0

    async def open(self, options: Any = None) -> Any:
        """Open a new session, or fail."""
        if self.failures:
            self.failures -= 1
            raise BrowserCrashed("this browser does not open")
        return await super().open(options)


@contextmanager
def flaky(folder: Path) -> Iterator[tuple[WebGymVectorEnv, FlakyBrowsers]]:
    """Three environments on such browsers."""
    browsers = FlakyBrowsers()
    given = stand_in_pool(folder) | {"browsers": browsers}
    del given["size"]
    collector = CollectorConfig(server_patience_seconds=0)
    given["config"] = given["config"].model_copy(update={"collector": collector})
    envs = WebGymVectorEnv(3, **given)
    try:
        yield envs, browsers
    finally:
        envs.close()


def test_a_fault_in_a_step_ends_its_own_episode_alone(tmp_path: Path) -> None:
    with flaky(tmp_path) as (envs, _):
        envs.reset(seed=1)
        _, rewards, terminations, truncations, infos = envs.step([Scroll("down"), GoBack(), Answer("right")])
        assert np.array_equal(rewards, [np.nan, 0.0, 1.0], equal_nan=True)
        assert (terminations.tolist(), truncations.tolist()) == ([False, False, True], [True, False, False])
        assert (infos["outcome"][0], infos["step"].tolist()) == ("environment_error", [1, 1, 1])
        _, rewards, _, _, infos = envs.step([GoBack()] * 3)
        assert (rewards.tolist(), infos["step"].tolist()) == ([0.0, 0.0, 0.0], [0, 2, 0])


def test_an_episode_that_does_not_start_is_tried_with_the_next_task(tmp_path: Path) -> None:
    with flaky(tmp_path) as (envs, browsers):
        browsers.failures = 2
        _, infos = envs.reset(seed=1)
        assert infos["step"].tolist() == [0, 0, 0]
        envs.step([Answer("wrong"), GoBack(), GoBack()])
        browsers.failures = 2
        _, _, terminations, truncations, infos = envs.step([GoBack()] * 3)
        assert infos["step"].tolist() == [0, 2, 2]
        assert not np.any(terminations | truncations)


def test_if_none_starts_the_others_return_and_the_next_step_tries_again(tmp_path: Path) -> None:
    with flaky(tmp_path) as (envs, browsers):
        space: Any = envs.observation_space
        texts = space["text"]
        assert len({id(text._char_index) for text in texts}) == 1, "copying them would take most of the start"
        assert len({id(text.np_random) for text in texts}) == 3
        envs.reset(seed=1)
        last = envs.step([Answer("wrong"), GoBack(), GoBack()])[0]
        browsers.failures = 3
        seen, rewards, terminations, truncations, infos = envs.step([GoBack(), GoBack(), Answer("right")])
        assert np.array_equal(rewards, [np.nan, 0.0, 1.0], equal_nan=True)
        assert (terminations.tolist(), truncations.tolist()) == ([False, False, True], [True, False, False])
        assert infos["outcome"].tolist() == ["environment_error", None, "success"]
        assert infos["failure"]["code"][0] == "browser_crashed"
        assert infos["failure"]["message"][0] == "this browser does not open"
        assert np.array_equal(seen["screenshot"][0], last["screenshot"][0])
        assert not np.array_equal(seen["screenshot"][1], last["screenshot"][1])
        assert seen in envs.observation_space
        assert len(browsers.open_now) == 1, "the third has answered; the second continues"
        _, _, terminations, truncations, infos = envs.step([GoBack()] * 3)
        assert infos["step"].tolist() == [0, 3, 0]
        assert not np.any(terminations | truncations)
        browsers.failures = 9
        with pytest.raises(BrowserCrashed, match="does not open"):
            envs.reset(seed=2)
        browsers.failures = 9
        assert np.isnan(envs.step([GoBack()] * 3)[1]).all()
        _, _, _, _, infos = envs.step([GoBack()] * 3)
        assert infos["step"].tolist() == [0, 0, 0]


def test_after_an_interruption_no_step_goes_on_in_another_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C loses what the call returned, such as an end; the next step would begin the next episode."""
    with flaky(tmp_path) as (envs, _):
        envs.reset(seed=1)
        run = envs._loop.run

        def interrupted(work: Any) -> None:
            run(work)
            raise KeyboardInterrupt

        for call in (lambda: envs.step([GoBack(), GoBack(), Answer("right")]), lambda: envs.reset(seed=2)):
            monkeypatch.setattr(envs._loop, "run", interrupted)
            with pytest.raises(KeyboardInterrupt):
                call()
            monkeypatch.setattr(envs._loop, "run", run)
            with pytest.raises(UsageError, match="interrupted"):
                envs.step([GoBack()] * 3)
            envs.reset(seed=1)
            assert envs.step([GoBack()] * 3)[4]["step"].tolist() == [1, 1, 1]
    with pytest.raises(UsageError, match="closed"):
        envs.step([GoBack()] * 3)  # whose coroutines would be told of as never awaited


def test_what_it_takes_and_what_is_refused_before_any_environment_acts(tmp_path: Path) -> None:
    with flaky(tmp_path) as (envs, _):
        with pytest.raises(UsageError, match="call reset first"):
            envs.step([GoBack()] * 3)
        envs.reset(seed=1)
        with pytest.raises(UsageError, match="int is not an action"):
            envs.step([GoBack(), GoBack(), 7])
        with pytest.raises(UsageError, match="2 actions for 3"):
            envs.step([GoBack()] * 2)
        assert envs.step([GoBack()] * 3)[4]["step"].tolist() == [1, 1, 1]
        drawn = [list(envs.reset(seed=seed)[1]["task_id"]) for seed in (3, np.int64(3), np.arange(3, 6))]  # type: ignore[arg-type]
        assert drawn[0] == drawn[1] == drawn[2]
        assert set(envs.reset(options={"task_id": "check-7"})[1]["task_id"]) == {"check-7"}
        with pytest.raises(UsageError, match="unknown option"):
            envs.reset(options={"taskid": "check-7"})
    with pytest.raises(UsageError, match="on_fault"):
        WebGymVectorEnv(3, on_fault="raise")


@pytest.mark.browser
def test_several_browsers_at_once_and_the_next_episode_after_an_end() -> None:
    envs = gymnasium.make_vec("WebGym/OfflineSmall-v2", num_envs=2)
    assert isinstance(envs.unwrapped, WebGymVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    try:
        observation, infos = envs.reset(seed=3)
        assert observation["screenshot"].shape == (2, 128, 192, 3)
        assert observation in envs.observation_space
        first = list(infos["task_id"])
        _, rewards, terminations, _, infos = envs.step([Answer("no idea"), Scroll("down")])
        assert rewards.tolist() == [0.0, 0.0]
        assert terminations.tolist() == [True, False]
        assert infos["outcome"][0] == "failure"
        _, rewards, terminations, _, infos = envs.step([Scroll("down"), Scroll("down")])
        assert not np.any(terminations)
        assert infos["step"].tolist() == [0, 2]
        assert infos["task_id"][0] != first[0]
        assert infos["task_id"][1] == first[1]
    finally:
        envs.close()


@pytest.mark.browser
def test_the_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert example("gymnasium_env").main(steps=1) == 0.0
    assert "2 steps, failure: reward 0.0" in capsys.readouterr().out
