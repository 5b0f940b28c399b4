"""Train a model on tasks in browsers with TRL.

python trl_grpo.py Qwen/Qwen3-VL-4B-Instruct
"""

from __future__ import annotations

import sys
from typing import Any

from datasets import Dataset
from trl import GRPOConfig, GRPOTrainer

from webgym.integrations.trl import Browsers


def main(
    model: Any, name: str = "offline-v2", count: int = 200, trainer: Any = GRPOTrainer, **given: Any
) -> Any:
    """Returns the trainer; ``given`` is its own."""
    args = given.pop("args", None) or GRPOConfig(
        output_dir="out",
        per_device_train_batch_size=16,
        num_generations=8,
        max_completion_length=32768,
        max_tool_calling_iterations=30,
    )
    browsers = Browsers(name, size=args.per_device_train_batch_size)
    rows = Dataset.from_list(browsers.rows(count=count))
    made = trainer(model=model, args=args, train_dataset=rows, environment_factory=browsers, **given)
    try:
        made.train()
    finally:
        browsers.close()
    print(f"{browsers.begun} episodes, {browsers.unanswered} of them ended by TRL before an answer")
    return made


if __name__ == "__main__":
    main(sys.argv[1])
