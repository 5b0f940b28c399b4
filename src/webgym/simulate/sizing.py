"""The settings of a simulation, a system's bottleneck and price, and the gain from more of each resource."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, Literal, TypeAlias

import msgspec
from matplotlib.axes import Axes
from pydantic import Field

from webgym.core.plotting import CATEGORIES, PAGE, new_figure, save, styled
from webgym.core.settings import Section, Settings, load_settings, validated
from webgym.core.tables import Table
from webgym.simulate.config import SCHEDULES, Costs, Schedule, System, Workload
from webgym.simulate.model import SimulationResult, simulate

Resource: TypeAlias = Literal["cpus", "gpus", "environments", "judges"]
RESOURCES: Final[tuple[Resource, ...]] = ("cpus", "gpus", "environments", "judges")

LARGEST: Final = 256
"""Most environments of a simulated system. A larger one is scaled down, with CPUs, GPUs and judges in
proportion, and the resulting rate is scaled up. This slightly underestimates the rate of larger systems,
which wait less."""

_GROUPS: Final = 4
"""Episodes per environment, so that the simulation has a steady middle part."""

_MORE: Final = 0.25
"""Relative increase of a resource for measuring its gain; well above the noise of a simulation."""


class Prices(Settings, allow_inf_nan=False):
    """Prices per hour, in any currency. The defaults are only examples."""

    cpu: float = Field(default=0.05, ge=0)
    """A processor with its memory."""

    gpu: float = Field(default=2.5, ge=0)
    """A GPU that serves the policy."""


class Sized(msgspec.Struct, frozen=True):
    """The steady state of a system of some size.

    Attributes:
        cpus, gpus, environments: of the system; environments are limited by the memory for browsers.
        rates: trajectories per hour, by schedule.
        cpu, gpu: utilisation of CPUs and GPUs, under the system's own schedule.
        buys: trajectories per hour that one more of each resource adds, under the system's own schedule.
        limits: elasticity: percent by which 1 % more of each resource raises the rate.
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
        """The resource of which a small increase raises the rate most."""
        return max(self.limits, key=lambda name: self.limits[name])

    @property
    def per_thousand(self) -> float:
        """Price of 1,000 trajectories."""
        return 1000 * self.per_hour / self.rates[self.schedule]


def size(system: System, costs: Costs, workload: Workload, prices: Prices) -> Sized:
    """Simulate a system of any size in its steady state, and with more of each resource."""
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
        amount = getattr(small, name)
        added = _MORE * amount if name == "gpus" else math.ceil(_MORE * amount)
        with_more = _steady(small.model_copy(update={name: amount + added}), costs, workload)
        gain = max(0.0, with_more.rate - own.rate)  # negative gains are noise: more resources never hurt here
        buys[name] = gain * hourly / added
        limits[name] = (gain / own.rate) / (added / amount)
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
    """A system of about :data:`LARGEST` environments in the same proportions, and the scale factor.

    It keeps at least one GPU, since half a batch takes more than half of a GPU's time.
    """
    scale = max(LARGEST / system.sessions, 1 / system.gpus)
    cpus = max(1, math.ceil(system.cpus * min(1.0, scale)))
    factor = cpus / system.cpus
    update = {
        "cpus": cpus,
        "gpus": system.gpus * factor,
        "environments": max(1, round(system.environments * factor)),
        "judges": max(1, round((system.judges or system.sessions) * factor)),
    }
    return system.model_copy(update=update), factor


def _steady(system: System, costs: Costs, workload: Workload) -> SimulationResult:
    result = simulate(
        system.model_copy(update={"iterations": 1, "straggler_share": 1.0}),
        costs,
        workload.model_copy(update={"trajectories": _GROUPS * system.sessions}),
    )
    return result.steady or result


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


# --- the table and the figure ---------------------------------------------------------------------------


def sizes_table(results: Sequence[Sized]) -> Table:
    """Throughput, bottleneck, gain by one more of each resource, and price, for every size of a system."""
    rows = []
    for size in results:
        ratios = (size.rates["async"] / size.rates[name] for name in ("step_barrier", "episode_barrier"))
        rows.append(
            (
                f"{size.cpus:,} / {size.gpus:g} / {size.environments:,}",
                f"{size.rates[size.schedule]:,.0f}",
                " / ".join(f"{ratio:.1f}" for ratio in ratios),
                f"{size.cpu:.0%} / {size.gpu:.0%}",
                size.bottleneck,
                *(f"{size.buys[name]:.1f}" for name in RESOURCES[:3]),
                f"{size.per_thousand:.2f}",
            )
        )
    columns = (
        "CPUs / GPUs / environments",
        "per hour",
        "async over step / episode barrier",
        "CPU / GPU use",
        "bottleneck",
        "one more CPU",
        "one more GPU",
        "one more environment",
        "price of 1,000",
    )
    return Table("Trajectories per hour in steady state, and how many one more of each adds", columns, rows)


COLOURS: Final = dict(zip(SCHEDULES, CATEGORIES, strict=False))


def draw_sizes(sizes: Sequence[Sized], path: Path) -> None:
    """Draw the throughput and the price of 1,000 trajectories for every size, in the given order.

    Raises:
        UsageError: the file cannot be written, or has no known suffix.
    """
    with styled():
        figure = new_figure(PAGE, 2.3)
        rates, prices = figure.subplots(1, 2)
        names = [f"{size.cpus:,} CPUs\n{size.gpus:g} GPUs" for size in sizes]
        positions = range(len(sizes))
        for schedule in SCHEDULES:
            line(rates, positions, [size.rates[schedule] for size in sizes], schedule)
        rates.set_yscale("log")
        label(rates, "Throughput", "", "trajectories per hour")
        prices.bar(positions, [size.per_thousand for size in sizes], color=COLOURS["async"], width=0.6)
        label(prices, "Price of 1,000 trajectories", "", "")
        for axes in (rates, prices):
            axes.set_xticks(positions, names)
        rates.legend(frameon=False)
        save(figure, path)


def line(axes: Axes, x: Sequence[float], y: Sequence[float], schedule: Schedule) -> None:
    """Draw a schedule's values in its colour."""
    axes.plot(x, y, "o-", color=COLOURS[schedule], label=schedule.replace("_", " "), markersize=3)


def label(axes: Axes, title: str, x: str, y: str) -> None:
    """Write a title and the names of the axes."""
    axes.set_title(title)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(axis="y")
