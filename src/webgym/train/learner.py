"""Turns a draw from the replay buffer into saved weights."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from webgym.core.errors import TrainingError
from webgym.core.trajectory import Step
from webgym.store.runs import RunReader
from webgym.train.config import LearnConfig
from webgym.train.folder import TrainingFolder
from webgym.train.objectives import Objective
from webgym.train.replay import ReplaySample, StepRef
from webgym.train.samples import Sample, SampleMaker
from webgym.train.update import Updater

_AGAIN: Final = "; then move {iteration} elsewhere, and --resume collects it again"
_TOKENS: Final = f"the stored tokens are not this model's: docs/training.md has the token contract{_AGAIN}"
_HINTS: Final = {
    "altered_sampling": "the objective needs replies of the full distribution: configs/train/group-is.yaml "
    f"has sampling without top-p and top-k{_AGAIN}",
    "no_logprobs": f"the objective needs log-probabilities, and the endpoint gives none{_AGAIN}",
    "too_long": "raise learn.update.cutoff_tokens in config.yaml, then resume with --resume",
    "gone": "their attempts were set aside after the draw: delete {iteration}/replay.json, and --resume "
    "draws others",
}
"""What to do about the most frequent reason; otherwise :data:`_TOKENS`."""


class Learner:
    """Trains in this process; weights and optimizer stay in memory between iterations.

    Args:
        config: replay, objective, update.
        objective: the training objective.
    """

    def __init__(self, config: LearnConfig, objective: Objective) -> None:
        self._config = config
        self._objective = objective
        self._updater: Updater | None = None
        self._latest_saved = 0

    def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        """Train on drawn steps, and save the iteration's weights.

        Raises:
            TrainingError: every step was dropped, or the loss is not finite.
        """
        try:
            return self._learn(number, draw, folder)
        except BaseException:
            self._updater = None  # its weights may be past those that were saved
            raise

    def _learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        updater = self._ready(folder)
        objective, config = self._objective, self._config.update
        maker = SampleMaker(
            updater.renderer, cutoff_tokens=config.cutoff_tokens, off_policy=objective.off_policy
        )
        samples = samples_of(draw, folder, maker)
        dropped: Counter[str] = Counter(maker.dropped)
        # Of attempts that were set aside after the draw, as those of a corrupt file are.
        if gone := len(draw.steps) - len(samples) - dropped.total():
            dropped["gone"] = gone
        if not samples:
            raise TrainingError(
                f"all {len(draw.steps)} steps were dropped: {dict(dropped)}",
                hint=_HINTS.get(dropped.most_common(1)[0][0], _TOKENS).format(
                    iteration=folder.iteration(number).relative_to(folder.path)
                ),
            )
        report = updater.update(samples, passes=self._config.replay.passes)
        updater.save(folder.weights(number))
        self._latest_saved = number
        figures = {"dropped": dict(dropped), "stored_tokens": maker.stored, "rebuilt_tokens": maker.rebuilt}
        return {**msgspec.to_builtins(report), **figures}

    def _ready(self, folder: TrainingFolder) -> Updater:
        """The updater, with the newest weights on disk."""
        latest = folder.latest_weights()
        if self._updater is None or (latest and latest[0] != self._latest_saved):
            self._updater = Updater(
                self._config.update, self._objective, self._config.model, resume=latest[1] if latest else None
            )
        return self._updater


def samples_of(draw: ReplaySample, folder: TrainingFolder, maker: SampleMaker) -> list[Sample]:
    """The samples of all drawn steps that can be trained on."""
    by_run: dict[int, dict[str, list[StepRef]]] = {}
    for ref in draw.steps:
        by_run.setdefault(ref.iteration, {}).setdefault(ref.attempt_id, []).append(ref)
    samples: list[Sample] = []
    for iteration, attempts in sorted(by_run.items()):
        reader = RunReader(folder.run(iteration))
        steps: list[tuple[StepRef, Step]] = []
        for trajectory in reader.trajectories():
            refs = attempts.get(trajectory.episode.attempt_id, ())
            steps += [(ref, trajectory.episode.steps[ref.index]) for ref in refs]
        # Independent of the order in which attempts ended: the same draw gives the same update.
        steps.sort(key=lambda pair: pair[0])
        samples += maker.make([(step, ref.advantage) for ref, step in steps], reader.image)
    return samples
