"""A warm start: clone the successes of stored runs before the first iteration (``webgym train --from RUN``).

The runs may be of another policy: a larger model, the scripted policy, or one of other people's. Their
replies are learned as texts, tokenized anew, from the requests that were stored with them; so those should be
like the requests that the training will make.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from webgym.core.errors import TrainingError
from webgym.core.task import Task
from webgym.inference.local import LocalConfig
from webgym.store.runs import RunReader
from webgym.tasks.split import refuse_leaks
from webgym.train.config import ReplayConfig
from webgym.train.loop import Tell, TrainConfig
from webgym.train.objectives import FilteredBC
from webgym.train.replay import Replay
from webgym.train.samples import Sample, SampleMaker
from webgym.train.update import Updater


def warm_start(
    config: TrainConfig, runs: Sequence[Path], tasks: Sequence[Task], folder: Path, tell: Tell
) -> TrainConfig:
    """Train on every step of the successes of runs that changed something, with ``learn.update`` and
    ``learn.replay.passes``. In a launch of several processes all of them call this.

    Args:
        config: of the training.
        runs: run folders.
        tasks: of the training; its test tasks may not be given away.
        folder: of the new weights. If it exists, it is what an earlier start made.
        tell: called with a line about it.

    Returns:
        The settings of a training from those weights.

    Raises:
        ConfigError: a run has test tasks, or tasks that leak them.
        TrainingError: there is nothing to train on, or the loss is not finite.
    """
    learn = config.learn
    if not folder.exists():
        updater, objective = Updater(learn.update, FilteredBC(), learn.model), FilteredBC()
        maker = SampleMaker(updater.renderer, cutoff_tokens=learn.update.cutoff_tokens)
        selection = ReplayConfig(steps=None, repetition_penalty=learn.replay.repetition_penalty)
        samples: list[Sample] = []
        for path in runs:
            run, replay = RunReader(path), Replay(selection, objective)
            refuse_leaks(list(run.tasks.values()), [task for task in tasks if task.split == "test"])
            replay.add(0, run)
            for ref in replay.draw().steps:
                step = run.trajectory(ref.attempt_id).episode.steps[ref.index]
                as_text = msgspec.structs.replace(
                    step, reply=msgspec.structs.replace(step.reply, tokens=None)
                )
                samples += maker.make([(as_text, 1.0)], run.image)
        if not samples:
            raise TrainingError(
                f"there is nothing to start from in {', '.join(map(str, runs))}",
                hint=f"no successful step could be used: {dict(maker.dropped) or 'none succeeded'}",
            )
        report = updater.update(samples, passes=learn.replay.passes)
        updater.save(folder)
        tell(f"warm start: {report.samples} steps x {learn.replay.passes}, loss {report.loss:.3g}; {folder}")
    local = config.local or LocalConfig(path=learn.model)
    if local.path == learn.model:
        local = local.model_copy(update={"path": str(folder)})
    started: dict[str, Any] = {"learn": learn.model_copy(update={"model": str(folder)})}
    return config.model_copy(update=started if config.vllm else started | {"local": local})
