"""Evaluate a model on WebGym's tasks with verifiers, which imports this module by its name.

cd examples/integrations && python verifiers_tasks.py http://127.0.0.1:8000/v1 MODEL
"""

from __future__ import annotations

import asyncio
import sys
from typing import Any

from verifiers.v1 import Episode
from verifiers.v1.cli.eval.runner import run_eval
from verifiers.v1.configs.cli.eval import EvalConfig

from webgym.integrations.verifiers import WebGymEnv, WebGymHarness, WebGymTaskset

__all__ = ["WebGymEnv", "WebGymHarness", "WebGymTaskset"]


async def main(url: str, model: str, out: str = "outputs", browsers: int = 4, **tasks: Any) -> list[Episode]:
    """Play, and print the success rate of the episodes that have a reward."""
    config = EvalConfig(
        env={"taskset": {"id": "verifiers_tasks", **tasks}, "browsers": browsers},
        model=model,
        client={"base_url": url, "api_key_var": "OPENAI_API_KEY"},
        max_concurrent=browsers,
        output_dir=out,
        push=False,
        rich=None,
    )
    episodes: list[Episode] = await run_eval(config)
    rewards = [episode.traces[0].reward for episode in episodes if episode.ok]
    rate = f"success rate {sum(rewards) / len(rewards):.2f}" if rewards else "no success rate"
    print(f"{len(rewards)} of {len(episodes)} episodes have a reward: {rate}")
    return episodes


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:3], count=8))
