"""What ``webgym bench rollout`` found, as tables and as one figure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from webgym.bench.rollout.measure import Measured
from webgym.bench.tables import Table
from webgym.plotting import CATEGORIES, PAGE, new_figure, save, styled


def rollout_tables(found: Sequence[Measured]) -> Iterator[Table]:
    """One table for every part that was measured."""
    parts = {one.cell.part: [each for each in found if each.cell.part == one.cell.part] for one in found}
    if "schedules" in parts:
        yield _schedules(parts["schedules"])
    if "capacity" in parts:
        yield _capacity(parts["capacity"])
    if "overload" in parts:
        yield _overload(parts["overload"])
    if "calibration" in parts:
        yield _calibration(parts["calibration"][0])


def _schedules(cells: Sequence[Measured]) -> Table:
    bases = {one.cell.cpus: one.seconds for one in cells if one.cell.mode == "async"}
    rows = []
    for one in cells:
        base = bases.get(one.cell.cpus)
        rows.append(
            (
                f"{one.cell.cpus} CPUs, {one.cell.mode}",
                f"{one.seconds:.0f}",
                f"{one.seconds / base:.2f}" if base else "–",
                f"{one.per_minute:.1f}",
                f"{1 - one.cpu:.0%}",
                f"{1 - one.policy:.0%}",
                f"{one.crashed:.1%}",
                f"{one.machine_load:.1f}",
            )
        )
    columns = ("", "wall, s", "over async", "per minute", "CPU idle", "policy idle", "crashed", "load before")
    cell = cells[0].cell
    title = (
        f"Schedules: {cell.trajectories} trajectories, {cells[0].steps} steps, {cell.sessions} environments"
    )
    return Table(title, columns, rows)


def _capacity(cells: Sequence[Measured]) -> Table:
    rows = [
        (f"{one.cell.gpus} GPUs", f"{one.seconds:.0f}", f"{one.per_minute:.1f}", f"{1 - one.policy:.0%}")
        for one in cells
    ]
    title = f"Throughput against policy capacity, each GPU {cells[0].cell.slow:g} times slower, async"
    return Table(title, ("", "wall, s", "per minute", "policy idle"), rows)


def _overload(cells: Sequence[Measured]) -> Table:
    rows = [
        (
            one.cell.queues.replace("_", " "),
            str(one.ended),
            f"{one.crashed:.1%}",
            str(one.steps),
            f"{1 - one.cpu:.0%}",
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
    """Time against processors, processors over time, throughput against policy capacity, overload.

    Raises:
        UsageError: the file cannot be written, or has no known suffix.
    """
    with styled():
        figure = new_figure(PAGE, 2.1)
        times, traces, capacity, overload = figure.subplots(1, 4)
        cells = [one for one in found if one.cell.part == "schedules"]
        modes = list(dict.fromkeys(one.cell.mode for one in cells))
        for mode, colour in zip(modes, CATEGORIES, strict=False):
            own = [one for one in cells if one.cell.mode == mode]
            times.plot(
                [one.cell.cpus for one in own], [one.seconds for one in own], "o-", label=mode, color=colour
            )
            scarce = min(own, key=lambda one: one.cell.cpus)
            loads = scarce.loads
            traces.plot([load.seconds for load in loads], [load.cpu for load in loads], color=colour, lw=0.7)
        if cells:
            times.legend(frameon=False)
            times.set_ylim(0)
        times.set(title="Wall time", xlabel="CPUs", ylabel="seconds")
        traces.set(title="CPU use, fewest CPUs", xlabel="seconds", ylabel="share")
        slow = [one for one in found if one.cell.part == "capacity"]
        capacity.plot([one.cell.gpus for one in slow], [one.per_minute for one in slow], "o-")
        capacity.set(title="Policy capacity", xlabel="GPUs", ylabel="trajectories per minute")
        many = [one for one in found if one.cell.part == "overload"]
        overload.bar([one.cell.queues.replace("_", " ") for one in many], [one.ended for one in many])
        overload.set(title="Overload", ylabel="finished")
        save(figure, path)
