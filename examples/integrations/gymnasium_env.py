"""Play an episode of Gymnasium's environment with random actions.

python gymnasium_env.py
"""

from __future__ import annotations

import gymnasium

import webgym
import webgym.integrations.gymnasium  # makes the ids known


def main(name: str = "WebGym/OfflineSmall-v2", seed: int = 1, steps: int = 5) -> float:
    """Its reward; NaN if it has none."""
    env = gymnasium.make(name)
    try:
        observation, _ = env.reset(seed=seed)
        print(observation["instruction"], observation["screenshot"].shape)
        for action in [webgym.random_action(step) for step in range(steps)] + [webgym.Answer("no idea")]:
            _, reward, terminated, truncated, info = env.step(action)
            if terminated or truncated:
                break
    finally:
        env.close()
    print(f"{info['step']} steps, {info['outcome']}: reward {reward}")
    return float(reward)


if __name__ == "__main__":
    main()
