"""The simulation of :mod:`webgym.simulate` beside the benchmark, with service times measured in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from statistics import mean, median, stdev
from typing import Final

import msgspec

from webgym.bench.rollout.measure import Measured, over_async, repeated
from webgym.bench.rollout.plan import Cell, RolloutPlan
from webgym.core.errors import ConfigError
from webgym.simulate.config import Costs, System
from webgym.simulate.model import simulate
from webgym.tables import Table

_LOOK: Final = 0.25
"""Share of a step's CPU time that goes into the screenshot; the benchmark does not tell them apart."""
_LEAST_SECONDS: Final = 0.001


class Compared(msgspec.Struct, frozen=True):
    """One cell of the schedules, measured and simulated.

    Attributes:
        seconds, simulated: wall time, the median of the rounds.
        ratio, simulated_ratio: over async with a queue per operation, at the same number of processors.
    """

    cpus: int
    mode: str
    seconds: float
    simulated: float
    ratio: float
    simulated_ratio: float

    @property
    def error(self) -> float:
        """Of the simulated ratio, relative."""
        return self.simulated_ratio / self.ratio - 1


def service_times(plan: RolloutPlan, found: Sequence[Measured]) -> Costs:
    """What a step takes, from the cell in which one episode at a time was played.

    What a step waits beyond its CPU time is the network: a log-normal whose logarithms have the same mean and
    spread. Sessions are opened and cleaned within the CPU time of the steps.

    Raises:
        ConfigError: there is no such cell.
    """
    calm = next((one for one in found if one.cell.part == "calibration" and len(one.between) > 1), None)
    if calm is None:
        raise ConfigError(
            "the benchmark has no service times", hint="measure its part calibration, in the same --out"
        )
    cpu = calm.cpu_seconds / calm.steps
    waits = [math.log(max(_LEAST_SECONDS, seconds - cpu)) for seconds in calm.between]
    return plan.costs.model_copy(
        update={
            "open_cpu": 0.0,
            **_cpu(cpu),
            "page_seconds": math.exp(mean(waits)),
            "page_sigma": stdev(waits),
            "page_longest": max(calm.between),
            "prompt_tokens": max(1, round(calm.read_tokens / calm.steps)),
            "judge_seconds": 0.0,
        }
    )


def _cpu(seconds: float) -> dict[str, float]:
    """Of a step, as the simulation takes it."""
    return {"act_cpu": seconds * (1 - _LOOK), "look_cpu": seconds * _LOOK}


def compare(plan: RolloutPlan, found: Sequence[Measured]) -> Iterator[Compared]:
    """Simulate every cell of the schedules, with the same lengths of trajectories.

    A step takes more CPU time where many browsers share caches and memory than with one episode at a time:
    it is that of the async cell with the same number of processors.

    Raises:
        ConfigError: the benchmark has no service times.
    """
    costs = service_times(plan, found)
    cells = [one for one in repeated(found) if one.cell.part == "schedules"]
    per_step = {
        one.cell.cpus: median(each.cpu_seconds / each.steps for each in one.rounds)
        for one in cells
        if one.cell.mode == "async"
    }
    simulated = {
        one.cell: _simulated(one.cell, costs.model_copy(update=_cpu(per_step[one.cell.cpus])), plan)
        for one in cells
        if one.cell.cpus in per_step
    }
    bases = {one.cell.cpus: simulated[one.cell] for one in cells if one.cell.mode == "async"}
    for one in cells:
        if ratios := over_async(one, cells):
            yield Compared(
                cpus=one.cell.cpus,
                mode=one.cell.mode,
                seconds=median(one.of("seconds")),
                simulated=simulated[one.cell],
                ratio=median(ratios),
                simulated_ratio=simulated[one.cell] / bases[one.cell.cpus],
            )


def _simulated(cell: Cell, costs: Costs, plan: RolloutPlan) -> float:
    """Seconds."""
    system = System(
        cpus=cell.cpus,
        gpus=cell.gpus,
        environments=cell.sessions,
        browsers_per_cpu=cell.sessions,
        schedule=cell.schedule,
        queues=cell.queues,
        refills=cell.refills,
    )
    return simulate(system, costs, plan.workload).seconds


def comparison_table(compared: Sequence[Compared]) -> Table:
    """The simulation's wall times and ratios beside the benchmark's."""
    rows = [
        (
            f"{one.cpus} CPUs, {one.mode}",
            f"{one.seconds:.0f}",
            f"{one.simulated:.0f}",
            f"{one.ratio:.2f}",
            f"{one.simulated_ratio:.2f}",
            f"{one.error:+.0%}",
        )
        for one in compared
    ]
    columns = ("", "measured, s", "simulated, s", "over async, measured", "simulated", "error of the ratio")
    return Table("The simulation beside the benchmark", columns, rows)
