"""What ``webgym simulate`` is asked: settings of a file, and the sizes to look at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from webgym.settings import Section, load_settings
from webgym.simulate.config import Costs, System, Workload
from webgym.simulate.sizing import Prices, Sized, size

ENVIRONMENTS_PER_CPU: Final = 4
"""Where nobody says how many: the paper's 256 at 64 CPUs."""


class Questions(Section):
    """Settings of a simulation; every key has a default."""

    costs: Costs = Costs()
    system: System = System()
    workload: Workload = Workload()
    prices: Prices = Prices()

    def sizes(
        self, cpus: Sequence[int], gpus: Sequence[float], environments: int | None = None
    ) -> Iterator[System]:
        """Systems of these sizes, each number of CPUs with each number of GPUs."""
        given = self.system.model_fields_set
        for many in cpus or [self.system.cpus]:
            for cards in gpus or [self.system.gpus]:
                told = environments or (self.system.environments if "environments" in given else None)
                update = {"cpus": many, "gpus": cards, "environments": told or ENVIRONMENTS_PER_CPU * many}
                yield self.system.model_copy(update=update)

    def answer(self, system: System) -> Sized:
        """What a system of this size does."""
        return size(system, self.costs, self.workload, self.prices)


def read_questions(files: Sequence[Path]) -> Questions:
    """The settings of YAML files, each laid over those before it.

    Raises:
        ConfigError: a file cannot be read, or a setting is unknown or out of range.
    """
    return load_settings(Questions, files, hint="see docs/simulate.md for an example")
