"""Gymnasium's own checks, our conformance suite, and several browsers at once."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from tests.integrations.engine import example

from webgym.core.action import Answer, Scroll
from webgym.integrations.gymnasium import IDS, WebGymEnv, WebGymVectorEnv
from webgym.testing import check_environment, stand_in_environment


def test_it_passes_gymnasiums_own_check() -> None:
    env = WebGymEnv(env=stand_in_environment(), render_mode="rgb_array")
    check_env(env, skip_render_check=True)
    env.close()


async def test_it_keeps_the_environments_promises() -> None:
    assert await check_environment(lambda env: WebGymEnv(env=env)) == []


def test_its_ids_are_known() -> None:
    assert set(IDS) <= gymnasium.registry.keys()


@pytest.mark.browser
def test_several_browsers_at_once_and_the_next_episode_after_an_end() -> None:
    envs = gymnasium.make_vec("WebGym/OfflineSmall-v1", num_envs=2)
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
