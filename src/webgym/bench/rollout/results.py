"""Results of ``webgym bench rollout``: in their folder, in tables and figures, beside the simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import mean, median
from typing import Final

import msgspec
from matplotlib.axes import Axes

from webgym.bench.rollout.plan import PARTS, Cell, RolloutPlan
from webgym.bench.stepping import quantile
from webgym.core.errors import ConfigError, RunFolderError, UsageError
from webgym.core.outcome import Outcome
from webgym.core.plotting import CATEGORIES, COLUMN, PAGE, new_figure, save, styled
from webgym.core.tables import DASH, Table
from webgym.simulate.config import Costs, System


class Load(msgspec.Struct, frozen=True):
    """The load in an interval of about a second.

    Attributes:
        seconds: time from the start to the end of the interval.
        cpu: share of the browsers' processors that they and their server used.
        policy: share of the time in which GPUs were busy.
        requests: number of requests at the policy at the end.
        cpu_seconds: CPU time of the browsers and their server.
    """

    seconds: float
    cpu: float
    policy: float
    requests: int
    cpu_seconds: float = 0.0


class Measured(msgspec.Struct, frozen=True):
    """The result of a cell.

    Attributes:
        cell: the measurement.
        seconds: wall time.
        outcomes: number of attempts by outcome.
        steps: number of steps of all attempts.
        cpu_seconds: CPU time of the browsers and their server.
        policy_seconds: busy time of all GPUs.
        prompt_tokens: number of tokens of all requests.
        read_tokens: number of these that were not in the prefix cache.
        between: seconds from every reply to the next screenshot: the action and the loading of the page.
        loads: loads over time.
        machine_load: the machine's load average over a minute when the cell started.
    """

    cell: Cell
    seconds: float
    outcomes: dict[str, int]
    steps: int
    cpu_seconds: float
    policy_seconds: float
    prompt_tokens: int
    read_tokens: int
    between: list[float]
    loads: list[Load]
    machine_load: float

    @property
    def ended(self) -> int:
        """The number of attempts with a reward."""
        return sum(count for name, count in self.outcomes.items() if Outcome(name).is_rewarded)

    @property
    def lost(self) -> int:
        """The number of attempts that ended without a reward, before the time limit."""
        return sum(self.outcomes.values()) - self.ended - self.outcomes.get(Outcome.CANCELLED, 0)

    @property
    def lost_share(self) -> float:
        """The share of attempts that ended without a reward."""
        return self.lost / max(1, sum(self.outcomes.values()))

    @property
    def per_minute(self) -> float:
        """The number of attempts with a reward per minute."""
        return 60 * self.ended / self.seconds

    @property
    def cpu(self) -> float:
        """The mean use of the browsers' processors, between 0 and 1."""
        return self.cpu_seconds / (self.seconds * self.cell.cpus)

    @property
    def policy(self) -> float:
        """The mean use of the GPUs, between 0 and 1."""
        return self.policy_seconds / (self.seconds * self.cell.gpus)


class CellResult(msgspec.Struct, frozen=True):
    """The results of all rounds of a cell, in order."""

    rounds: list[Measured]

    @property
    def cell(self) -> Cell:
        """The cell of the first round."""
        return self.rounds[0].cell

    def of(self, name: str) -> list[float]:
        """An attribute of :class:`Measured` in every round."""
        return [float(getattr(result, name)) for result in self.rounds]


def by_cell(measured: Sequence[Measured]) -> list[CellResult]:
    """Group results by cell."""
    cells: dict[Cell, list[Measured]] = {}
    for result in measured:
        cells.setdefault(msgspec.structs.replace(result.cell, round=0), []).append(result)
    return [CellResult(sorted(rounds, key=lambda measured: measured.cell.round)) for rounds in cells.values()]


def over_async(result: CellResult, results: Sequence[CellResult]) -> list[float]:
    """Wall time of a cell over that of async with a queue per operation and as many processors, by round.

    Rounds with another number of steps than that of async, which are other work, have no ratio.
    """
    bases = {
        (measured.cell.round, measured.cell.cpus, measured.steps): measured.seconds
        for other in results
        if other.cell.mode == "async"
        for measured in other.rounds
    }
    pairs = (
        (measured.seconds, bases.get((measured.cell.round, measured.cell.cpus, measured.steps)))
        for measured in result.rounds
    )
    return [seconds / base for seconds, base in pairs if base]


# --- the folder of the results --------------------------------------------------------------------------


PLAN: Final = "plan.json"
"""File of the plan."""


def file_of(folder: Path, cell: Cell) -> Path:
    """The file of a cell's result."""
    return folder / f"{cell.name}.json"


def read_bench(folder: Path) -> tuple[RolloutPlan, list[Measured]]:
    """Read a plan and its results so far.

    Raises:
        RunFolderError: the folder contains no benchmark.
    """
    try:
        plan = msgspec.json.decode((folder / PLAN).read_bytes(), type=RolloutPlan)
        files = (file_of(folder, cell) for cell in plan.cells(PARTS))
        return plan, [msgspec.json.decode(f.read_bytes(), type=Measured) for f in files if f.exists()]
    except (OSError, ValueError) as error:
        raise RunFolderError(
            f"{folder} contains no results of webgym bench rollout: {error}", hint="give its --out folder"
        ) from error


def begin(plan: RolloutPlan, folder: Path, *, new: bool = True) -> list[Measured]:
    """Make the folder of the benchmark, or read the results that it contains.

    Args:
        plan: of the benchmark.
        folder: of the results.
        new: whether the folder may be made.

    Raises:
        RunFolderError: the folder contains another plan, or something else, or cannot be written.
    """
    if new and not (folder / PLAN).exists():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / PLAN).write_bytes(msgspec.json.format(msgspec.json.encode(plan)))
        except OSError as error:
            reason = f"{folder} cannot be written: {error.strerror}"
            raise RunFolderError(reason, hint="give another --out") from error
    stored, results = read_bench(folder)
    if stored != plan:
        raise RunFolderError(
            f"{folder} contains another plan", hint="give the same options, or another --out"
        )
    return results


# --- tables: medians and ranges of the rounds -----------------------------------------------------------


def rollout_tables(measured: Sequence[Measured]) -> Iterator[Table]:
    """A table for every part that was run."""
    parts: dict[str, list[CellResult]] = {}
    for result in by_cell(measured):
        parts.setdefault(result.cell.part, []).append(result)
    for part, table in (("schedules", _schedules), ("capacity", _capacity), ("overload", _overload)):
        if part in parts:
            yield table(parts[part])
    if "calibration" in parts:
        yield _calibration(parts["calibration"][0].rounds[0])


def _spread(values: Sequence[float], written: str) -> str:
    """The median, with the range if there are several values; ``written`` is a format specification."""
    middle = format(median(values), written)
    if len(values) == 1:
        return middle
    return f"{middle} ({format(min(values), written)}–{format(max(values), written)})"


def _schedules(results: Sequence[CellResult]) -> Table:
    rows = [
        (
            f"{result.cell.cpus} CPUs, {result.cell.mode}",
            _spread(result.of("seconds"), ".0f"),
            _spread(ratios, ".2f") if (ratios := over_async(result, results)) else DASH,
            _spread(result.of("per_minute"), ".1f"),
            f"{1 - median(result.of('cpu')):.0%}",
            f"{1 - median(result.of('policy')):.0%}",
            f"{max(result.of('lost_share')):.1%}",
            f"{max(result.of('machine_load')):.1f}",
        )
        for result in results
    ]
    columns = (
        "", "wall, s", "over async", "per minute", "CPU idle", "policy idle", "no reward, most", "load, most",
    )  # fmt: skip
    cell, steps = results[0].cell, results[0].rounds[0].steps
    title = f"Schedules: {cell.trajectories} trajectories, {steps} steps, {cell.sessions} environments"
    return Table(title, columns, rows)


def _capacity(results: Sequence[CellResult]) -> Table:
    rows = [
        (
            f"{result.cell.gpus} GPUs",
            _spread(result.of("seconds"), ".0f"),
            _spread(result.of("per_minute"), ".1f"),
            f"{1 - median(result.of('policy')):.0%}",
        )
        for result in results
    ]
    title = f"Throughput against policy capacity, each GPU {results[0].cell.slow:g} times slower, async"
    return Table(title, ("", "wall, s", "per minute", "policy idle"), rows)


def _overload(results: Sequence[CellResult]) -> Table:
    rows = [
        (
            result.cell.queues.replace("_", " "),
            _spread(result.of("ended"), ".0f"),
            _spread(result.of("lost_share"), ".1%"),
            _spread(result.of("steps"), ".0f"),
            f"{1 - median(result.of('cpu')):.0%}",
        )
        for result in results
    ]
    cell = results[0].cell
    title = f"Overload: {cell.sessions} environments on {cell.cpus} CPUs, after {cell.seconds:g} s"
    return Table(title, ("queues", "finished", "no reward", "steps", "CPU idle"), rows)


def _calibration(result: Measured) -> Table:
    def of_a_step(amount: float, written: str) -> str:
        return format(amount / result.steps, written) if result.steps else DASH

    half, tail = (f"{quantile(result.between, share):.2f}" for share in (0.5, 0.95))
    rows = [
        ("CPU seconds of a step", of_a_step(result.cpu_seconds, ".3f")),
        ("from reply to next look, median / 95 %, s", f"{half} / {tail}" if result.between else DASH),
        ("prompt tokens of a step", of_a_step(result.prompt_tokens, ".0f")),
        ("of them not in the prefix cache", of_a_step(result.read_tokens, ".0f")),
        ("attempts without a reward", f"{result.lost_share:.1%}"),
    ]
    return Table("Service times: a few episodes at a time", ("", "measured"), rows)


def draw_rollout(measured: Sequence[Measured], path: Path) -> None:
    """Draw results like the paper's figures.

    These are wall time and CPU use by number of processors, use of CPU and policy over time with the fewest
    processors, throughput by policy capacity, and outcomes under overload.

    Raises:
        UsageError: the file cannot be written, or has an unknown suffix, or there are no results but those of
            the calibration.
    """
    results = by_cell(measured)
    with styled():
        slow = [result for result in results if result.cell.part == "capacity"]
        many = [result for result in results if result.cell.part == "overload"]
        schedules = [result for result in results if result.cell.part == "schedules"]
        if not schedules:
            panels = [(draw, own) for draw, own in ((_draw_overload, many), (_draw_capacity, slow)) if own]
            if not panels:
                raise UsageError(
                    "there is nothing to draw", hint="measure the part schedules, capacity or overload"
                )
            figure = new_figure(COLUMN * len(panels), 2.4)
            for number, (draw, own) in enumerate(panels, 1):
                draw(figure.add_subplot(1, len(panels), number), own)
            save(figure, path)
            return
        figure = new_figure(PAGE, 4.4)
        columns = 3 if slow or many else 2
        panels = figure.subplots(2, columns)
        (times, uses), (cpu, policy) = panels[:, :2]
        modes = list(dict.fromkeys(result.cell.mode for result in schedules))
        for mode, colour in zip(modes, CATEGORIES, strict=False):
            own = [result for result in schedules if result.cell.mode == mode]
            cpus = [result.cell.cpus for result in own]
            seconds = [result.of("seconds") for result in own]
            middles = [median(values) for values in seconds]
            beyond = (
                [middle - min(values) for middle, values in zip(middles, seconds, strict=True)],
                [max(values) - middle for middle, values in zip(middles, seconds, strict=True)],
            )
            times.errorbar(cpus, middles, beyond, fmt="o-", label=mode, color=colour)
            uses.plot(cpus, [median(result.of("cpu")) for result in own], "o-", color=colour)
            loads = min(own, key=lambda result: result.cell.cpus).rounds[0].loads
            moments = [load.seconds for load in loads]
            cpu.plot(moments, _smoothed([load.cpu for load in loads]), color=colour, lw=1)
            policy.plot(moments, _smoothed([load.policy for load in loads]), color=colour, lw=1)
        for panel in (times, uses):
            panel.set_xticks(sorted({result.cell.cpus for result in schedules}))
        times.legend(frameon=False)
        times.set_ylim(0)
        times.set(title="Wall time", xlabel="CPUs", ylabel="seconds")
        uses.set(title="CPU use", xlabel="CPUs", ylabel="share", ylim=(0, 1.05))
        cpu.set(title="CPU use, fewest CPUs", xlabel="seconds", ylabel="share", ylim=(0, 1.05))
        policy.set(title="Policy use, fewest CPUs", xlabel="seconds", ylabel="share", ylim=(0, 1.05))
        if columns == 3:
            overload, capacity = panels[:, 2]
            for panel, draw, own in ((overload, _draw_overload, many), (capacity, _draw_capacity, slow)):
                panel.set_visible(bool(own))
                draw(panel, own)
        save(figure, path)


def _smoothed(values: Sequence[float]) -> list[float]:
    """Means over ten seconds around each sample: the bursts of a barrier are shorter, and hide each other."""
    around = [values[max(0, place - 5) : place + 5] for place in range(len(values))]
    return [sum(window) / len(window) for window in around]


def _draw_overload(panel: Axes, many: Sequence[CellResult]) -> None:
    """Attempts with and without a reward, by queues."""
    names = [result.cell.queues.replace("_", " ") for result in many]
    ended = [median(result.of("ended")) for result in many]
    lost = [median(result.of("lost")) for result in many]
    panel.bar(names, ended, label="finished")
    panel.bar(names, lost, bottom=ended, label="no reward", color=CATEGORIES[3])
    panel.legend(frameon=False)
    panel.set(title="Overload", ylabel="attempts")


def _draw_capacity(panel: Axes, slow: Sequence[CellResult]) -> None:
    """Throughput by number of GPUs."""
    gpus = [result.cell.gpus for result in slow]
    panel.plot(gpus, [median(result.of("per_minute")) for result in slow], "o-", clip_on=False)
    panel.set_xticks(gpus)
    panel.set_ylim(0)
    panel.set(title="Policy capacity", xlabel="GPUs", ylabel="trajectories per minute")


# --- the simulation beside them -------------------------------------------------------------------------


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
    loaded = _loaded_cpu_seconds(_comparable(measured))
    return costs.model_copy(update=_cpu_costs(mean(loaded.values()))) if loaded else costs


def _comparable(measured: Sequence[Measured]) -> list[CellResult]:
    """The cells of the part ``schedules``, without rounds in which no attempt made a step."""
    return by_cell([one for one in measured if one.cell.part == "schedules" and one.steps])


def _loaded_cpu_seconds(schedules: Sequence[CellResult]) -> dict[int, float]:
    """CPU seconds of a step of the async cells, by number of processors."""
    return {
        result.cell.cpus: median(measurement.cpu_seconds / measurement.steps for measurement in result.rounds)
        for result in schedules
        if result.cell.mode == "async"
    }


def beside_simulation(plan: RolloutPlan, measured: Sequence[Measured]) -> Iterator[Compared]:
    """Simulate every cell of the part ``schedules``, with the same trajectory lengths.

    The CPU time of a step is that of the async cell with the same number of processors, as it is greater when
    many browsers share caches and memory than in the calibration.

    Raises:
        ConfigError: the results contain no calibration.
    """
    costs = service_times(plan, measured)
    schedules = _comparable(measured)
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
    from webgym.simulate.model import simulate  # needs the extra simulate

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
