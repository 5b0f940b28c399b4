"""Compare the simulation of :mod:`webgym.simulate` with the benchmark, from which it takes service times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import mean, median
from typing import Final

import msgspec

from webgym.bench.rollout.measure import CellResult, Measured, by_cell, over_async
from webgym.bench.rollout.plan import Cell, RolloutPlan
from webgym.core.errors import ConfigError
from webgym.core.tables import Table
from webgym.simulate.config import Costs, System
from webgym.simulate.model import simulate

_SCREENSHOT_SHARE: Final = 0.25
"""Assumed share of a step's CPU time for the screenshot, which the benchmark does not measure separately."""


class Compared(msgspec.Struct, frozen=True):
    """A cell of the part ``schedules``, measured and simulated.

    Attributes:
        cpus: number of processors.
        mode: its name.
        seconds: measured wall time, the median of the rounds.
        simulated: simulated wall time, seconds.
        ratio: measured wall time over that of async with a queue per operation and as many processors.
        simulated_ratio: the same ratio of simulated times.
    """

    cpus: int
    mode: str
    seconds: float
    simulated: float
    ratio: float
    simulated_ratio: float

    @property
    def error(self) -> float:
        """Relative error of the simulated ratio."""
        return self.simulated_ratio / self.ratio - 1


def service_times(plan: RolloutPlan, results: Sequence[Measured]) -> Costs:
    """The costs of a step, from the calibration, which attempts few tasks at a time.

    The time of a step beyond its CPU time is that of the network. The CPU time of steps includes opening and
    cleaning sessions.

    Raises:
        ConfigError: the results contain no calibration.
    """
    calibration = next(
        (result for result in results if result.cell.part == "calibration" and len(result.between) > 1), None
    )
    if calibration is None:
        raise ConfigError(
            "the benchmark has no service times", hint="run its part calibration, with the same --out"
        )
    cpu = calibration.cpu_seconds / calibration.steps
    return plan.costs.model_copy(
        update={
            "open_cpu": 0.0,
            **_cpu_costs(cpu),
            "page_waits": tuple(max(0.0, seconds - cpu) for seconds in calibration.between),
            "prompt_tokens": max(1, round(calibration.read_tokens / calibration.steps)),
            "judge_seconds": 0.0,
        }
    )


def _cpu_costs(seconds: float) -> dict[str, float]:
    """The CPU time of a step, as costs of the simulation."""
    return {"act_cpu": seconds * (1 - _SCREENSHOT_SHARE), "look_cpu": seconds * _SCREENSHOT_SHARE}


def loaded_service_times(plan: RolloutPlan, measured: Sequence[Measured]) -> Costs:
    """:func:`service_times`, with the CPU time of a step when many browsers share caches and memory.

    That is the mean of the async cells; without such cells it is that of the calibration.

    Raises:
        ConfigError: the results contain no calibration.
    """
    costs = service_times(plan, measured)
    loaded = _loaded_cpu_seconds(_schedules(measured))
    return costs.model_copy(update=_cpu_costs(mean(loaded.values()))) if loaded else costs


def _schedules(measured: Sequence[Measured]) -> list[CellResult]:
    """The cells of the part ``schedules``, without rounds in which no attempt made a step."""
    return by_cell([one for one in measured if one.cell.part == "schedules" and one.steps])


def _loaded_cpu_seconds(schedules: Sequence[CellResult]) -> dict[int, float]:
    """CPU seconds of a step of the async cells, by number of processors."""
    return {
        result.cell.cpus: median(measurement.cpu_seconds / measurement.steps for measurement in result.rounds)
        for result in schedules
        if result.cell.mode == "async"
    }


def compare(plan: RolloutPlan, measured: Sequence[Measured]) -> Iterator[Compared]:
    """Simulate every cell of the part ``schedules``, with the same trajectory lengths.

    The CPU time of a step is that of the async cell with the same number of processors, as it is greater when
    many browsers share caches and memory than in the calibration.

    Raises:
        ConfigError: the results contain no calibration.
    """
    costs = service_times(plan, measured)
    schedules = _schedules(measured)
    cpu_seconds = _loaded_cpu_seconds(schedules)
    simulated = {
        result.cell: _simulated(
            result.cell, costs.model_copy(update=_cpu_costs(cpu_seconds[result.cell.cpus])), plan
        )
        for result in schedules
        if result.cell.cpus in cpu_seconds
    }
    bases = {result.cell.cpus: simulated[result.cell] for result in schedules if result.cell.mode == "async"}
    for result in schedules:
        if ratios := over_async(result, schedules):
            yield Compared(
                cpus=result.cell.cpus,
                mode=result.cell.mode,
                seconds=median(result.of("seconds")),
                simulated=simulated[result.cell],
                ratio=median(ratios),
                simulated_ratio=simulated[result.cell] / bases[result.cell.cpus],
            )


def _simulated(cell: Cell, costs: Costs, plan: RolloutPlan) -> float:
    """The simulated wall time of a cell, seconds."""
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
    """A table of measured and simulated wall times and ratios."""
    rows = [
        (
            f"{result.cpus} CPUs, {result.mode}",
            f"{result.seconds:.0f}",
            f"{result.simulated:.0f}",
            f"{result.ratio:.2f}",
            f"{result.simulated_ratio:.2f}",
            f"{result.error:+.0%}",
        )
        for result in compared
    ]
    columns = ("", "measured, s", "simulated, s", "over async, measured", "simulated", "error of the ratio")
    return Table("The simulation beside the benchmark", columns, rows)
