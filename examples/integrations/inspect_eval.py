"""Evaluate a model with inspect_ai.

python inspect_eval.py openai/gpt-5
"""

from __future__ import annotations

import sys
from typing import Any

from inspect_ai import eval as evaluate

from webgym.integrations.inspect_ai import webgym_task


def main(
    model: Any, name: str = "offline-small-v2", count: int = 8, browsers: int = 4, **given: Any
) -> float:
    """The success rate of the samples that have a score; NaN if none has."""
    task = webgym_task(name, count=count, browsers=browsers)
    [log] = evaluate(task, model=model, max_samples=browsers, **given)
    if log.results is None:
        sys.exit(f"no evaluation: {log.error.message if log.error else log.status}")
    rate = log.results.scores[0].metrics["success_rate"].value
    print(f"{log.results.scores[0].scored_samples} of {count} samples have a score: success rate {rate:.2f}")
    return float(rate)


if __name__ == "__main__":
    main(sys.argv[1])
