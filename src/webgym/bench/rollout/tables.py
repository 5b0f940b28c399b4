"""What ``webgym bench rollout`` found, as tables and as one figure: medians of the rounds and ranges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median

from webgym.bench.rollout.measure import Measured, Repeated, over_async, repeated
from webgym.plotting import CATEGORIES, PAGE, new_figure, save, styled
from webgym.tables import Table


def rollout_tables(found: Sequence[Measured]) -> Iterator[Table]:
    """One table for every part that was measured."""
    cells = repeated(found)
    parts = {each.cell.part: [one for one in cells if one.cell.part == each.cell.part] for each in cells}
    if "schedules" in parts:
        yield _schedules(parts["schedules"])
    if "capacity" in parts:
        yield _capacity(parts["capacity"])
    if "overload" in parts:
        yield _overload(parts["overload"])
    if "calibration" in parts:
        yield _calibration(parts["calibration"][0].rounds[0])


def _spread(values: Sequence[float], written: str) -> str:
    """The median, and the range where there is one."""
    middle = format(median(values), written)
    if len(values) == 1:
        return middle
    return f"{middle} ({format(min(values), written)}–{format(max(values), written)})"


def _schedules(cells: Sequence[Repeated]) -> Table:
    rows = [
        (
            f"{one.cell.cpus} CPUs, {one.cell.mode}",
            _spread(one.of("seconds"), ".0f"),
            _spread(ratios, ".2f") if (ratios := over_async(one, cells)) else "–",
            _spread(one.of("per_minute"), ".1f"),
            f"{1 - median(one.of('cpu')):.0%}",
            f"{1 - median(one.of('policy')):.0%}",
            f"{max(one.of('crashed')):.1%}",
            f"{max(one.of('machine_load')):.1f}",
        )
        for one in cells
    ]
    columns = (
        "", "wall, s", "over async", "per minute", "CPU idle", "policy idle", "crashed, most", "load, most",
    )  # fmt: skip
    cell, steps = cells[0].cell, cells[0].rounds[0].steps
    title = f"Schedules: {cell.trajectories} trajectories, {steps} steps, {cell.sessions} environments"
    return Table(title, columns, rows)


def _capacity(cells: Sequence[Repeated]) -> Table:
    rows = [
        (
            f"{one.cell.gpus} GPUs",
            _spread(one.of("seconds"), ".0f"),
            _spread(one.of("per_minute"), ".1f"),
            f"{1 - median(one.of('policy')):.0%}",
        )
        for one in cells
    ]
    title = f"Throughput against policy capacity, each GPU {cells[0].cell.slow:g} times slower, async"
    return Table(title, ("", "wall, s", "per minute", "policy idle"), rows)


def _overload(cells: Sequence[Repeated]) -> Table:
    rows = [
        (
            one.cell.queues.replace("_", " "),
            _spread(one.of("ended"), ".0f"),
            _spread(one.of("crashed"), ".1%"),
            _spread(one.of("steps"), ".0f"),
            f"{1 - median(one.of('cpu')):.0%}",
        )
        for one in cells
    ]
    cell = cells[0].cell
    title = f"Overload: {cell.sessions} environments on {cell.cpus} CPUs, after {cell.seconds:g} s"
    return Table(title, ("queues", "finished", "crashed", "steps", "CPU idle"), rows)


def _calibration(one: Measured) -> Table:
    ordered = sorted(one.between)
    half, tail = (ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.95))
    rows = [
        ("CPU seconds of a step", f"{one.cpu_seconds / one.steps:.3f}"),
        ("from reply to next look, median / 95 %, s", f"{half:.2f} / {tail:.2f}"),
        ("prompt tokens of a step", f"{one.prompt_tokens / one.steps:.0f}"),
        ("of them not in the prefix cache", f"{one.read_tokens / one.steps:.0f}"),
    ]
    return Table("Service times: one episode at a time", ("", "measured"), rows)


def draw_rollout(found: Sequence[Measured], path: Path) -> None:
    """As the paper's figures: wall time and CPU use against processors, both resources over time with the
    fewest processors, throughput against policy capacity, and what ends under overload.

    Raises:
        UsageError: the file cannot be written, or has no known suffix.
    """
    cells = repeated(found)
    with styled():
        figure = new_figure(PAGE, 4.4)
        times, uses, overload, cpu, policy, capacity = figure.subplots(2, 3).flat
        schedules = [one for one in cells if one.cell.part == "schedules"]
        modes = list(dict.fromkeys(one.cell.mode for one in schedules))
        for mode, colour in zip(modes, CATEGORIES, strict=False):
            own = [one for one in schedules if one.cell.mode == mode]
            cpus = [one.cell.cpus for one in own]
            seconds = [one.of("seconds") for one in own]
            middles = [median(each) for each in seconds]
            beyond = (
                [middle - min(each) for middle, each in zip(middles, seconds, strict=True)],
                [max(each) - middle for middle, each in zip(middles, seconds, strict=True)],
            )
            times.errorbar(cpus, middles, beyond, fmt="o-", label=mode, color=colour)
            uses.plot(cpus, [median(one.of("cpu")) for one in own], "o-", color=colour)
            loads = min(own, key=lambda one: one.cell.cpus).rounds[0].loads
            moments = [load.seconds for load in loads]
            cpu.plot(moments, [load.cpu for load in loads], color=colour, lw=0.7)
            policy.plot(moments, [load.policy for load in loads], color=colour, lw=0.7)
        if schedules:
            times.legend(frameon=False)
            times.set_ylim(0)
        times.set(title="Wall time", xlabel="CPUs", ylabel="seconds")
        uses.set(title="CPU use", xlabel="CPUs", ylabel="share", ylim=(0, 1.05))
        cpu.set(title="CPU use, fewest CPUs", xlabel="seconds", ylabel="share", ylim=(0, 1.05))
        policy.set(title="Policy use, fewest CPUs", xlabel="seconds", ylabel="share", ylim=(0, 1.05))
        slow = [one for one in cells if one.cell.part == "capacity"]
        capacity.plot([one.cell.gpus for one in slow], [median(one.of("per_minute")) for one in slow], "o-")
        capacity.set(title="Policy capacity", xlabel="GPUs", ylabel="trajectories per minute")
        many = [one for one in cells if one.cell.part == "overload"]
        names = [one.cell.queues.replace("_", " ") for one in many]
        ended = [median(one.of("ended")) for one in many]
        overload.bar(names, ended, label="finished")
        crashed = [median([each.crashes for each in one.rounds]) for one in many]
        overload.bar(names, crashed, bottom=ended, label="crashed", color=CATEGORIES[3])
        if many:
            overload.legend(frameon=False)
        overload.set(title="Overload", ylabel="attempts")
        for panel, measured in ((capacity, slow), (overload, many)):
            panel.set_visible(bool(measured))
        save(figure, path)
