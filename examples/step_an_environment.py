"""Step an environment yourself: eight browsers at once, random actions, a reward from the judge at the end.

.venv/bin/python examples/step_an_environment.py
"""

from __future__ import annotations

import asyncio

import webgym


async def play(env: webgym.Environment, seed: int) -> float:
    """One episode. A model would be shown ``info["messages"]`` and ``info["images"]`` and reply with text."""
    _, info = await env.reset(seed=seed)
    reward = 0.0
    while not info["is_over"]:
        action = webgym.random_action(seed=100 * seed + info["step"])
        _, reward, _, _, info = await env.step(action)
    print(f"{info['outcome']:10} {info['step']:2} steps  {info['instruction']}")
    return reward


async def main() -> None:
    """Eight episodes, all at the same time."""
    async with webgym.make_many(8, "offline-small-v2") as envs:
        rewards = await asyncio.gather(*(play(env, seed) for seed, env in enumerate(envs)))
    print(f"{len(rewards)} attempts, {sum(rewards):g} of them successful")


if __name__ == "__main__":
    asyncio.run(main())
