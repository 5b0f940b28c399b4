"""The non-main processes of a training on several GPUs (``accelerate launch``): they only run updates.

The first process runs the training. The drawn steps of an iteration are on disk before its update starts, so
the other processes wait for that file and train on the same steps in the same order.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Final

from webgym.train.folder import Stage, TrainingFolder
from webgym.train.learner import Learner
from webgym.train.loop import TrainConfig
from webgym.train.objectives import make_objective

_POLL_SECONDS: Final = 0.5


def is_follower() -> bool:
    """Whether this is not the first process of the launch, which runs the training."""
    return int(os.environ.get("RANK") or 0) > 0


def follow(config: TrainConfig, out: Path) -> None:
    """Run the updates together with the first process. If that fails, the launcher ends this process.

    Args:
        config: of the training.
        out: the training's folder, on a disk common to all processes.

    Raises:
        TrainingError: as in the first process.
    """
    folder, objective = TrainingFolder(out), make_objective(config.learn.objective)
    learner = Learner(config.learn, objective)
    for number in range(1, config.loop.iterations + 1):
        while not folder.is_past(number, Stage.REPLAY):
            time.sleep(_POLL_SECONDS)
        draw = folder.draw(number)
        if draw.steps and not folder.is_past(number, Stage.UPDATE):
            learner.learn(number, draw, folder)
