"""What limits a system, what one more of each thing would buy, and what it costs."""

from __future__ import annotations

import math
from typing import Final, Literal, TypeAlias

import msgspec
from pydantic import Field

from webgym.settings import Settings
from webgym.simulate.config import SCHEDULES, Costs, Schedule, System, Workload
from webgym.simulate.model import Found, simulate

Resource: TypeAlias = Literal["cpus", "gpus", "environments", "judges"]
RESOURCES: Final[tuple[Resource, ...]] = ("cpus", "gpus", "environments", "judges")

LARGEST: Final = 256
"""Environments of the system that is simulated in place of a larger one. CPUs, GPUs and judges shrink by the
same factor, and its rate grows by it. A larger pool waits a little less, so this errs on the slow side."""

_GROUPS: Final = 4
"""Episodes per environment: the middle of the simulation is then steady."""

_MORE: Final = 0.25
"""How much more of a resource is tried, to see what it buys: well above the noise of a simulation."""


class Prices(Settings):
    """What things cost, in one currency per hour. The defaults are examples, not anybody's offer."""

    cpu: float = Field(default=0.05, ge=0)
    """A processor with its memory."""

    gpu: float = Field(default=2.5, ge=0)
    """A GPU that serves the policy."""


class Sized(msgspec.Struct, frozen=True):
    """One size of a system in its steady state.

    Attributes:
        cpus, gpus, environments: of the system; environments as far as browsers' memory allows.
        rates: trajectories per hour, by schedule.
        cpu, gpu: share of what each could do, under the system's own schedule.
        buys: trajectories per hour that one more of each resource adds, under the system's own schedule.
        limits: by how many percent one percent more of each resource raises the rate.
        per_hour: price of the system.
    """

    cpus: int
    gpus: float
    environments: int
    rates: dict[Schedule, float]
    cpu: float
    gpu: float
    buys: dict[Resource, float]
    limits: dict[Resource, float]
    per_hour: float
    schedule: Schedule

    @property
    def bottleneck(self) -> Resource:
        """Of which a little more would help most."""
        return max(self.limits, key=lambda name: self.limits[name])

    @property
    def per_thousand(self) -> float:
        """Price of 1,000 trajectories."""
        return 1000 * self.per_hour / self.rates[self.schedule]


def size(system: System, costs: Costs, workload: Workload, prices: Prices) -> Sized:
    """Simulate a system of any size in its steady state, and with some more of each resource."""
    small, factor = scaled(system)
    own = _steady(small, costs, workload)
    hourly = 3600 / workload.mean_steps
    rates = {system.schedule: own.rate * hourly / factor}
    for schedule in SCHEDULES:
        if schedule not in rates:
            other = small.model_copy(update={"schedule": schedule})
            rates[schedule] = _steady(other, costs, workload).rate * hourly / factor
    buys: dict[Resource, float] = {}
    limits: dict[Resource, float] = {}
    for name in RESOURCES:
        has = getattr(small, name)
        added = _MORE * has if name == "gpus" else math.ceil(_MORE * has)
        with_more = _steady(small.model_copy(update={name: has + added}), costs, workload)
        gain = max(0.0, with_more.rate - own.rate)  # below nothing is noise: more of a thing never hurts here
        buys[name] = gain * hourly / added
        limits[name] = (gain / own.rate) / (added / has)
    return Sized(
        cpus=system.cpus,
        gpus=system.gpus,
        environments=system.sessions,
        rates=rates,
        cpu=own.cpu,
        gpu=own.gpu,
        buys=buys,
        limits=limits,
        per_hour=system.cpus * prices.cpu + system.gpus * prices.gpu,
        schedule=system.schedule,
    )


def scaled(system: System) -> tuple[System, float]:
    """A system of about :data:`LARGEST` environments in the same proportions, and the factor.

    It keeps one GPU at least, for half a batch is not half of a GPU's work.
    """
    least = max(LARGEST / system.sessions, 1 / system.gpus)
    cpus = max(1, math.ceil(system.cpus * min(1.0, least)))
    factor = cpus / system.cpus
    update = {
        "cpus": cpus,
        "gpus": system.gpus * factor,
        "environments": max(1, round(system.environments * factor)),
        "judges": max(1, round((system.judges or system.sessions) * factor)),
    }
    return system.model_copy(update=update), factor


def _steady(system: System, costs: Costs, workload: Workload) -> Found:
    found = simulate(
        system.model_copy(update={"iterations": 1, "straggler_share": 1.0}),
        costs,
        workload.model_copy(update={"trajectories": _GROUPS * system.sessions}),
    )
    return found.steady or found
