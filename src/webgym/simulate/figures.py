"""Draws the figures of ``webgym simulate``; the file's suffix sets the format."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes

from webgym.core.plotting import CATEGORIES, MUTED, PAGE, new_figure, save, styled
from webgym.simulate.config import SCHEDULES, Schedule
from webgym.simulate.paper import Reproduced
from webgym.simulate.sizing import Sized

NAMES: Final[dict[Schedule, str]] = {
    "async": "async",
    "step_barrier": "step barrier",
    "episode_barrier": "episode barrier",
}
COLOURS: Final = dict(zip(SCHEDULES, CATEGORIES, strict=False))

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
            _line(times, list(reproduced.minutes), minutes, schedule)
        paper_points = [(64, 48.6), (128, 30.0), (64, 264.0)]
        times.plot(*zip(*paper_points, strict=True), "x", color="black", label="paper")
        _label(times, "Wall time of 1,800 trajectories", "CPUs", "minutes")
        times.set_xticks(list(reproduced.minutes))
        times.set_ylim(0)
        for schedule in ("async", "step_barrier"):
            trace = reproduced.traces[schedule].trace
            if trace is not None:
                shown = [at for at in trace.seconds if at <= _SHOWN_SECONDS]
                traces.plot(shown, trace.cpu[: len(shown)], color=COLOURS[schedule], linewidth=0.8)
        _label(traces, "Processors at work, 64 CPUs", "seconds", "share")
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
        _label(gpus, "Throughput, 768 CPUs", "GPUs", "steps per second")
        gpus.set_ylim(0)
        times.legend(frameon=False, loc="center right")
        gpus.legend(frameon=False)
        save(figure, path)


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
            _line(rates, positions, [size.rates[schedule] for size in sizes], schedule)
        rates.set_yscale("log")
        _label(rates, "Throughput", "", "trajectories per hour")
        prices.bar(positions, [size.per_thousand for size in sizes], color=COLOURS["async"], width=0.6)
        _label(prices, "Price of 1,000 trajectories", "", "")
        for axes in (rates, prices):
            axes.set_xticks(positions, names)
        rates.legend(frameon=False)
        save(figure, path)


def _line(axes: Axes, x: Sequence[float], y: Sequence[float], schedule: Schedule) -> None:
    axes.plot(x, y, "o-", color=COLOURS[schedule], label=NAMES[schedule], markersize=3)


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(axis="y")
