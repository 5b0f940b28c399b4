"""The demo of learning: how the tiny policy is trained, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from webgym.core.task import LEVELS
from webgym.settings import merged, read_yaml
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig

SETTINGS: Final = Path(__file__).parent / "demo.yaml"
WEIGHTS: Final = Path(__file__).parent / "weights"
"""The model that comes with the package; its README.md says how it was made."""

SHARE: Final = 0.65
"""Tasks of an iteration, to one on unseen websites."""


def settings(weights: Path, *, seed: int, tasks: int, iterations: int | None, sessions: int) -> TrainConfig:
    """What the demo trains by.

    Args:
        weights: that it begins with.
        seed: of the tasks, the attempts and the learning.
        tasks: on unseen websites, before and after.
        iterations: of learning; by default as in ``demo.yaml``.
        sessions: browser sessions at the same time.
    """
    held = read_yaml(SETTINGS, hint="")
    over: dict[str, Any] = {
        "seed": seed,
        "learn": {"model": str(weights), "update": {"seed": seed}},
        "rollout": {"collector": {"sessions": sessions}},
        "loop": {"tasks": max(1, round(SHARE * tasks))},
        "evaluation": {"count": tasks, "seed": seed},
        "local": {"path": str(weights), "threads": 1},
    }
    if iterations is not None:
        over["loop"] |= {"iterations": iterations, "evaluate_every": iterations}
    return TrainConfig.model_validate(merged(held, over))


def before_and_after(folder: Path) -> Iterator[str]:
    """Lines that say how often unseen tasks succeeded before and after, with 95 % intervals."""
    evaluations = TrainingFolder(folder).evaluations()
    for when, number in (("before", 0), ("after", max(evaluations))):
        found = evaluations[number]
        rates, (low, high) = found["success_rate"], found["success_interval"]["overall"]
        levels = ", ".join(f"{level} {rates[level]:.0%}" for level in LEVELS if rates.get(level) is not None)
        yield (
            f"{when:8} {rates['overall']:.1%} of {found['attempts']} attempts at unseen websites "
            f"(95 %: {low:.1%}-{high:.1%}; of all planned {found['success_rate_of_planned']['overall']:.1%}; "
            f"{levels})"
        )
