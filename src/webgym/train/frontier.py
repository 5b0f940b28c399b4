"""Preference for tasks that succeed sometimes, from which the policy learns most.

A task that always or never succeeds gives filtered behaviour cloning nothing new and a group no advantage.
The probability that two attempts at a task differ is 2 p (1 - p), so tasks are weighted in proportion to it:

    weight = floor + (1 - floor) * 4 p (1 - p)

where p is the posterior mean of the success rate of the task's bucket (by default its website and level)
under a Beta prior. The prior's mean is the success rate of the bucket's level, which is the estimate for
buckets that were never attempted; the floor keeps hopeless and mastered tasks in the draw, since both change.

    frontier = Frontier(FrontierConfig())
    sampler = Sampler(tasks, SamplerConfig(seed=7), weigh=frontier.weigh, anew=True)
    frontier.take(results)  # after each iteration
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from webgym.core.task import Task
from webgym.core.websites import site_or_text
from webgym.tasks.sampling import Stratum
from webgym.train.config import FrontierConfig


class Frontier:
    """Estimates success rates and the resulting weights of tasks.

    Args:
        config: grouping of tasks, prior, floor.
    """

    def __init__(self, config: FrontierConfig) -> None:
        self._config = config
        self._counts: defaultdict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])

    def take(self, results: Iterable[tuple[Task, float]]) -> None:
        """Add the rewards of an iteration and discount earlier ones.

        Args:
            results: task and reward (0 or 1) of every attempt that has a reward.
        """
        for counts in self._counts.values():
            counts[:] = [count * self._config.decay for count in counts]
        for task, reward in results:
            for bucket in {self._bucket(task), self._level(task)}:
                self._counts[bucket][0] += reward
                self._counts[bucket][1] += 1 - reward

    def rate(self, task: Task) -> float:
        """The posterior mean of the success rate of the task's bucket."""
        strength = sum(self._config.prior)
        level_rate = self._posterior(self._level(task), self._config.prior[0], strength)
        if self._bucket(task) == self._level(task):
            return level_rate
        return self._posterior(self._bucket(task), level_rate * strength, strength)

    def weight(self, task: Task) -> float:
        """The task's weight in the draw, from the floor to 1."""
        rate, floor = self.rate(task), self._config.floor
        return floor + (1 - floor) * 4 * rate * (1 - rate)

    def weigh(self, stratum: Stratum) -> NDArray[np.float64]:
        """The weights of a stratum's tasks, for :class:`webgym.tasks.sampling.Sampler`."""
        return np.array([self.weight(task) for task in stratum.tasks])

    def state(self) -> dict[str, Any]:
        """The state as JSON-compatible data."""
        return {bucket: list(counts) for bucket, counts in sorted(self._counts.items())}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Replace the state by one from :meth:`state`."""
        self._counts.clear()
        self._counts.update({bucket: list(counts) for bucket, counts in state.items()})

    def _posterior(self, bucket: str, successes: float, strength: float) -> float:
        won, lost = self._counts.get(bucket, (0.0, 0.0))
        return (won + successes) / (won + lost + strength)

    def _level(self, task: Task) -> str:
        return f"level {task.level}"

    def _bucket(self, task: Task) -> str:
        match self._config.by:
            case "task":
                return f"task {task.id}"
            case "website":
                return f"website {site_or_text(task.website)}"
            case "level":
                return self._level(task)
            case "website_level":
                return f"website {site_or_text(task.website)} {task.level}"
