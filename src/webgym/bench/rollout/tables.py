"""Results of ``webgym bench rollout`` as tables and as a figure: medians and ranges of the rounds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median

from matplotlib.axes import Axes

from webgym.bench.rollout.measure import CellResult, Measured, by_cell, over_async
from webgym.bench.stepping import quantile
from webgym.core.errors import UsageError
from webgym.core.plotting import CATEGORIES, COLUMN, PAGE, new_figure, save, styled
from webgym.core.tables import DASH, Table


def rollout_tables(measured: Sequence[Measured]) -> Iterator[Table]:
    """A table for every part that was run."""
    results = by_cell(measured)
    parts: dict[str, list[CellResult]] = {}
    for result in results:
        parts.setdefault(result.cell.part, []).append(result)
    if "schedules" in parts:
        yield _schedules(parts["schedules"])
    if "capacity" in parts:
        yield _capacity(parts["capacity"])
    if "overload" in parts:
        yield _overload(parts["overload"])
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
