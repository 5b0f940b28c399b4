"""What AReaL's trainer gets of an episode.

In training, the workflow goes to ``PPOTrainer.train``, and the engine is AReaL's.
"""

from __future__ import annotations

from typing import Any

from areal.api.cli_args import GenerationHyperparameters

import webgym
from webgym.integrations.areal import WebGymWorkflow


async def main(
    engine: Any, tokenizer: Any, processor: Any, name: str = "offline-small-v2"
) -> dict[str, Any] | None:
    """Tensors of an episode; none if it has no reward.

    Args:
        engine: an ``InferenceEngine`` of AReaL.
        tokenizer, processor: of the model.
        name: of the tasks.
    """
    [row] = webgym.task_rows(name, count=1)
    workflow = WebGymWorkflow(GenerationHyperparameters(), tokenizer, processor, name=name, size=1)
    async with workflow.pool:
        found = await workflow.arun_episode(engine, row)
    if found is None:
        print(f"nothing to train on: {workflow.dropped}")
        return None
    print(
        f"{len(found['rewards'])} rows of {found['input_ids'].shape[1]} tokens, reward {found['rewards'][0]}"
    )
    return found
