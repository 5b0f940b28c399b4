"""The demo of learning: settings of the tiny policy's training, and a summary of the result."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from webgym.core.settings import merged, read_yaml
from webgym.core.task import LEVELS
from webgym.train.figures import judged, success_line
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig

SETTINGS: Final = Path(__file__).parent / "demo.yaml"
WEIGHTS: Final = Path(__file__).parent / "weights"
"""The model included in the package; see its README.md."""

SHARE: Final = 0.65
"""Number of tasks of an iteration, relative to the number of evaluated tasks."""


def settings(weights: Path, *, seed: int, tasks: int, iterations: int | None, sessions: int) -> TrainConfig:
    """The settings of the demo's training.

    Args:
        weights: the initial weights.
        seed: of the tasks, the attempts and the learning.
        tasks: number of tasks on unseen websites, evaluated before and after.
        iterations: number of iterations; by default as in ``demo.yaml``.
        sessions: number of concurrent browser sessions.
    """
    defaults = read_yaml(SETTINGS, hint="")
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
    return TrainConfig.model_validate(merged(defaults, over))


def before_and_after(folder: Path) -> Iterator[str]:
    """Lines with the success rates on unseen websites before and after, and their 95 % intervals."""
    evaluations = TrainingFolder(folder).evaluations()
    for when, number in (("before", 0), ("after", max(evaluations))):
        figures = evaluations[number]
        if not judged(figures):
            yield f"{when:8} {success_line(figures)}"
            continue
        of_planned = figures["success_rate_of_planned"]["overall"]
        rates, (low, high) = figures["success_rate"], figures["success_interval"]["overall"]
        levels = ", ".join(f"{level} {rates[level]:.0%}" for level in LEVELS if rates.get(level) is not None)
        yield (
            f"{when:8} {rates['overall']:.1%} of {judged(figures)} judged attempts at unseen websites "
            f"(95 %: {low:.1%}-{high:.1%}; of all planned {of_planned:.1%}; "
            f"{levels})"
        )
