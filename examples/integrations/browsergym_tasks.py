"""Play a task of BrowserGym with random actions of WebGym's.

python browsergym_tasks.py miniwob.click-test  # MINIWOB_URL says where its pages are
"""

from __future__ import annotations

import importlib
import sys

import webgym
from webgym.integrations.browsergym import BrowserGymEnv


def main(name: str, seed: int = 0, steps: int = 10) -> float:
    """One episode; its reward. A model would be shown ``view.image`` and ``info["instruction"]``."""
    total = 0.0
    with BrowserGymEnv(name, max_episode_steps=steps) as env:
        view, info = env.reset(seed=seed)
        print(info["instruction"])
        for step in range(steps):
            action = webgym.random_action(seed=1000 * seed + step)
            view, reward, _, _, info = env.step(action)
            total += reward
            print(f"{view.observation.url}  {action}")
            if info["is_over"]:
                break
    print(f"{step + 1} steps, reward {total:g}")
    return total


if __name__ == "__main__":
    importlib.import_module(f"browsergym.{sys.argv[1].split('.')[0]}")  # makes its tasks known
    main(sys.argv[1])
