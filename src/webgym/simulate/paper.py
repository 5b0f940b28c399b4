"""Compares the paper's measurements of its rollout system (§4) with the model's predictions.

The CPU seconds per step and the median and spread of the network's latency (the defaults of
:class:`~webgym.simulate.config.Costs`, rounded by hand) are fitted to the figures marked ``is_fitted``. All
other figures are predictions.

The model does not reproduce the paper's "4 to 5 times" at 128 CPUs, and no model can in which additional
processors only speed up the same work. A round of the step barrier takes at most its work divided by the
number of processors, plus its longest chain of waits; over all rounds, the work divided by 64 is at most the
48.6 minutes of the asynchronous run. So the longest chains take at least 264 - 48.6 = 215 minutes, which no
number of processors shortens, and which is 7.2 times the 30 minutes at 128 CPUs. If the baseline is only 4
to 5 times slower there, it must lose time at 64 CPUs in a way that is not in the model, such as by repeating
operations that time out in the burst after each barrier.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec

from webgym.core.plotting import MUTED, PAGE, new_figure, save, styled
from webgym.core.tables import Table, printed
from webgym.simulate.config import SCHEDULES, Costs, Schedule, System, Workload
from webgym.simulate.model import SimulationResult, simulate
from webgym.simulate.sizing import COLOURS, label, line

STRAGGLERS: Final = 0.95
"""Share of ended trajectories after which the asynchronous collector stops the rest in two minutes (paper
§4)."""

CPUS: Final = (64, 128, 256)
MANY: Final = System(cpus=768, environments=2048, browsers_per_cpu=4)
"""System of the paper's measurement with 1 to 3 GPU nodes; the number of environments is assumed."""

GPUS_PER_NODE: Final = 8


class Point(msgspec.Struct, frozen=True):
    """A figure of the paper and the model's prediction.

    Attributes:
        what: the measured quantity.
        reported: lowest and highest value that the paper reports; ``None`` if it reports none.
        simulated: the model's value.
        is_fitted: whether the model's constants were fitted to it.
    """

    what: str
    unit: str
    reported: tuple[float, float] | None
    simulated: float
    is_fitted: bool = False

    @property
    def error(self) -> float | None:
        """Relative error of the model; 0 within the paper's range; ``None`` if the paper reports no value."""
        if self.reported is None:
            return None
        low, high = self.reported
        return self.simulated / high - 1 if self.simulated > high else min(0.0, self.simulated / low - 1)


class Reproduced(msgspec.Struct, frozen=True):
    """The model's results for the comparison.

    Attributes:
        minutes: simulated wall time, by number of CPUs and schedule.
        traces: results with traces at 64 CPUs, by schedule.
        steps: steps per second at 768 CPUs, by number of GPUs.
    """

    minutes: dict[int, dict[Schedule, float]]
    traces: dict[Schedule, SimulationResult]
    steps: dict[int, float]

    def __str__(self) -> str:
        return printed([paper_table(self.points)])

    @property
    def points(self) -> Iterator[Point]:
        """The rows of the comparison."""
        at = self.minutes
        yield Point("64 CPUs, async", "min", (48.6, 48.6), at[64]["async"], is_fitted=True)
        yield Point("64 CPUs, step barrier", "min", (264.0, 264.0), at[64]["step_barrier"], is_fitted=True)
        yield Point("128 CPUs, async", "min", (30.0, 30.0), at[128]["async"], is_fitted=True)
        for cpus in at:
            reported = {64: (5.4, 5.4), 128: (4.0, 5.0)}.get(cpus)
            ratio = at[cpus]["step_barrier"] / at[cpus]["async"]
            yield Point(f"{cpus} CPUs, step barrier / async", "x", reported, ratio, is_fitted=cpus == 64)
        for cpus, by_schedule in at.items():
            ratio = by_schedule["episode_barrier"] / by_schedule["async"]
            yield Point(f"{cpus} CPUs, episode barrier / async", "x", None, ratio)
        fewest = min(self.steps)
        for gpus, rate in self.steps.items():
            if gpus > fewest:
                nodes = gpus / fewest
                yield Point(
                    f"768 CPUs, {gpus} GPUs / {fewest} GPUs", "x", (nodes, nodes), rate / self.steps[fewest]
                )


def reproduce(costs: Costs, workload: Workload) -> Reproduced:
    """Simulate the paper's measurements: 1,800 trajectories, 256 environments, 24 GPUs."""
    minutes: dict[int, dict[Schedule, float]] = {}
    traces: dict[Schedule, SimulationResult] = {}
    for count in CPUS:
        minutes[count] = {}
        for schedule in SCHEDULES:
            system = System(cpus=count, schedule=schedule, straggler_share=STRAGGLERS)
            result = simulate(system, costs, workload, trace_seconds=10.0)
            minutes[count][schedule] = result.seconds / 60
            if count == CPUS[0]:
                traces[schedule] = result
    steps = {}
    for nodes in (1, 2, 3):
        system = MANY.model_copy(update={"gpus": nodes * GPUS_PER_NODE})
        many = workload.model_copy(update={"trajectories": 3 * MANY.sessions})
        result = simulate(system, costs, many)
        steps[nodes * GPUS_PER_NODE] = (result.steady or result).rate
    return Reproduced(minutes, traces, steps)


def paper_table(points: Iterable[Point]) -> Table:
    """The paper's figures beside those of the model, with relative errors."""
    rows = []
    for point in points:
        paper = "–"
        if point.reported is not None:
            low, high = point.reported
            paper = f"{low:g}" if low == high else f"{low:g}–{high:g}"
        error = "–" if point.error is None else f"{point.error:+.1%}"
        kind = "fitted" if point.is_fitted else "predicted"
        rows.append((point.what, paper, f"{point.simulated:.1f}", point.unit, error, kind))
    return Table("The paper's rollout system, simulated", ("", "paper", "model", "", "error", ""), rows)


_SHOWN_SECONDS: Final = 600.0
"""Length of the drawn part of a utilisation trace."""


def draw_paper(reproduced: Reproduced, path: Path) -> None:
    """Draw the time over CPUs, the utilisation at 64 CPUs, and the throughput over GPUs.

    Raises:
        UsageError: the file cannot be written, or has no known suffix.
    """
    with styled():
        figure = new_figure(PAGE, 2.1)
        times, traces, gpus = figure.subplots(1, 3)
        for schedule in SCHEDULES:
            minutes = [at[schedule] for at in reproduced.minutes.values()]
            line(times, list(reproduced.minutes), minutes, schedule)
        paper_points = [(64, 48.6), (128, 30.0), (64, 264.0)]
        times.plot(*zip(*paper_points, strict=True), "x", color="black", label="paper")
        label(times, "Wall time of 1,800 trajectories", "CPUs", "minutes")
        times.set_xticks(list(reproduced.minutes))
        times.set_ylim(0)
        for schedule in ("async", "step_barrier"):
            trace = reproduced.traces[schedule].trace
            if trace is not None:
                shown = [at for at in trace.seconds if at <= _SHOWN_SECONDS]
                traces.plot(shown, trace.cpu[: len(shown)], color=COLOURS[schedule], linewidth=0.8)
        label(traces, "Processors at work, 64 CPUs", "seconds", "share")
        gpus.plot(
            list(reproduced.steps),
            list(reproduced.steps.values()),
            "o-",
            color=COLOURS["async"],
            markersize=3,
        )
        first = min(reproduced.steps)
        linear = [reproduced.steps[first] * count / first for count in reproduced.steps]
        gpus.plot(list(reproduced.steps), linear, ":", color=MUTED, label="linear")
        label(gpus, "Throughput, 768 CPUs", "GPUs", "steps per second")
        gpus.set_ylim(0)
        times.legend(frameon=False, loc="center right")
        gpus.legend(frameon=False)
        save(figure, path)
