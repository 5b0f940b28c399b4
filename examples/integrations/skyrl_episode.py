"""Play an episode of SkyRL's environment with a model behind an endpoint.

python skyrl_episode.py http://127.0.0.1:8000/v1 MODEL
"""

from __future__ import annotations

import sys

import httpx
import skyrl_gym

from webgym.integrations.skyrl_gym import NoReward, skyrl_rows

skyrl_gym.register(id="webgym", entry_point="webgym.integrations.skyrl_gym:WebGymEnv")


def main(url: str, model: str, name: str = "offline-small-v2") -> float | None:
    """Its reward; none if it has none. ``WEBGYM_TASKS`` names the same tasks."""
    [row] = skyrl_rows(name, count=1)
    env = skyrl_gym.make("webgym", env_config={}, extras=row)
    try:
        messages, told = env.init(row["prompt"])
        print(told["instruction"])
        while True:
            asked = {"model": model, "messages": messages}
            answered = httpx.post(f"{url}/chat/completions", json=asked, timeout=300).raise_for_status()
            reply = answered.json()["choices"][0]["message"]["content"]
            step = env.step(reply)
            if step["done"]:
                print(f"{step['metadata']['outcome']}: reward {step['reward']}")
                return float(step["reward"])
            messages += [{"role": "assistant", "content": reply}, *step["observations"]]
    except NoReward as error:
        print(f"no reward: {error}")
        return None
    finally:
        env.close()


if __name__ == "__main__":
    main(*sys.argv[1:3])
