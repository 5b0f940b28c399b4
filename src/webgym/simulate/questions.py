"""The settings of ``webgym simulate``, and the system sizes to simulate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from webgym.core.settings import Section, load_settings, validated
from webgym.simulate.config import Costs, System, Workload
from webgym.simulate.sizing import Prices, Sized, size

ENVIRONMENTS_PER_CPU: Final = 4
"""Default number of environments per CPU: the paper's 256 at 64 CPUs."""


class Questions(Section):
    """Settings of a simulation; every key has a default."""

    costs: Costs = Costs()
    system: System = System()
    workload: Workload = Workload()
    prices: Prices = Prices()

    def over(self, costs: Costs, workload: Workload) -> Questions:
        """These settings with other defaults of costs and workload.

        A distribution of the network's waits in these settings replaces default ``page_waits``.
        """
        given = self.costs.model_dump(exclude_unset=True)
        if not given.keys().isdisjoint({"page_seconds", "page_sigma", "page_longest"}):
            given = {"page_waits": (), **given}
        update = {
            "costs": costs.model_copy(update=given),
            "workload": workload.model_copy(update=self.workload.model_dump(exclude_unset=True)),
        }
        return self.model_copy(update=update)

    def sizes(
        self, cpus: Sequence[int], gpus: Sequence[float], environments: int | None = None
    ) -> Iterator[System]:
        """The systems with every combination of the numbers of CPUs and GPUs.

        Raises:
            ConfigError: a number is out of range.
        """
        given = self.system.model_fields_set
        for cpu_count in cpus or [self.system.cpus]:
            for gpu_count in gpus or [self.system.gpus]:
                configured = environments or (self.system.environments if "environments" in given else None)
                update = {
                    "cpus": cpu_count,
                    "gpus": gpu_count,
                    "environments": configured or ENVIRONMENTS_PER_CPU * cpu_count,
                }
                yield validated(System, self.system.model_dump() | update)

    def answer(self, system: System) -> Sized:
        """Simulate a system of this size."""
        return size(system, self.costs, self.workload, self.prices)


def read_questions(files: Sequence[Path]) -> Questions:
    """The settings from YAML files, each overriding those before it.

    Raises:
        ConfigError: a file cannot be read, or a setting is unknown or out of range.
    """
    return load_settings(Questions, files, hint="see docs/simulate.md for an example")
